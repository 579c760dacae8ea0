"""What both ends of a service share: the 16-byte header on the wire, names, and who cannot be talked to.

Source: protocol.md 5.1 to 5.4. The header sits between the 4 encapsulation bytes and the message; 16 is a multiple of
8, so the message is aligned as if it were not there.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import DecodeError, RosidlError
from rosidl_py_gen.runtime.qos import without_best_available
from rosidl_py_gen.runtime.transport import FAST_DDS_VENDOR

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.graph import Endpoint, Graph
    from rosidl_py_gen.runtime.qos import QoSProfile
    from rosidl_py_gen.runtime.transport import Payload

HEADER_BYTES = 16
_LITTLE = struct.Struct("<Qq")
_BIG = struct.Struct(">Qq")
_MASK = 2**64 - 1


class ForeignServiceError(RosidlError):
    """The peer's middleware puts other bytes on the wire for services; one side has to change it."""


class CallTimeoutError(RosidlError, TimeoutError):
    """No response came in time; the request may or may not have been handled."""


def carrier_qos(qos: QoSProfile) -> QoSProfile:
    """The profile of a service's endpoints: as asked for, but nothing is ever dropped for depth.

    An overwritten request or response is a call that never returns, and any number of calls may be under way. History
    takes no part in matching, so peers with keep-last 10 (the ROS default) connect all the same.
    """
    return without_best_available(qos).keep_all()


def add_header(message: bytes, guid: int, sequence: int) -> bytes:
    """Put the header into an encoded message, which is little-endian."""
    return b"".join((message[:4], _LITTLE.pack(guid & _MASK, sequence), message[4:]))


def split_header(data: Payload) -> tuple[int, int, bytes]:
    """Client id, sequence number and the plain message; raises `DecodeError` when the bytes are too few."""
    if len(data) < 4 + HEADER_BYTES:
        raise DecodeError("service header", len(data), f"expected at least {4 + HEADER_BYTES} bytes, found {len(data)}")
    order = _LITTLE if data[1] & 1 else _BIG
    guid, sequence = order.unpack_from(data, 4)
    return guid, sequence, b"".join((data[:4], data[4 + HEADER_BYTES :]))


def is_foreign(guid: bytes) -> bool:
    """Whether an endpoint belongs to Fast DDS, whose service payloads differ (protocol.md 5.3)."""
    return guid.startswith(FAST_DDS_VENDOR)


def foreign_words(graph: Graph, endpoint: Endpoint, service: str, role: str) -> str:
    """What to tell a person about a service peer that cannot be talked to."""
    return (
        f"{role} of service {service} is {graph.describe_node(endpoint.info)} on Fast DDS. Topics work with it, "
        "services do not: rmw_fastrtps sends another request header, which Cyclone DDS can neither read nor write. "
        "Start that node with RMW_IMPLEMENTATION=rmw_cyclonedds_cpp"
    )
