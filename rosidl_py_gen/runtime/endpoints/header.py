"""What both ends of a service share: whose a request or reply is, on the wire, who cannot be talked to, who listens.

Two kinds of peers know that differently. Cyclone's put a header of 16 bytes between the 4 encapsulation bytes and the
message: a number of the client and one of the request. Others, as Fast DDS, have it beside the message, and the
transport gives and takes it as an `Identity`: a GUID of the client and the number of the request. Up here both are a
client and a number, and the type of the client tells which kind it is.

Source: protocol.md 5.1 to 5.4, fastdds.md 4 and 5.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import TYPE_CHECKING, Protocol, TypeAlias

from rosidl_py_gen.errors import DecodeError, RosidlError
from rosidl_py_gen.runtime.transport.matching import without_best_available
from rosidl_py_gen.runtime.transport.port import IDENTITY_BYTES, identity_of

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.graph.state import Graph
    from rosidl_py_gen.runtime.transport.discovered import EndpointFound
    from rosidl_py_gen.runtime.transport.port import Payload, Writer
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

ClientId: TypeAlias = "int | bytes"
"""Of a peer on Cyclone its number, of others a GUID: that of the client, its reply reader or its request writer."""

HEADER_BYTES = 16
_LITTLE = struct.Struct("<Qq")
_BIG = struct.Struct(">Qq")
_MASK = 2**64 - 1
_FILL = (b"", b"\0\0\0", b"\0\0", b"\0")
_LARGE_BYTES = 1024
"""From here on a view costs less than one more copy."""


class IntrospectionState(IntEnum):
    """How much is published of what passes a client or server."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2


class Tap(Protocol):
    """Who is told of what passes a client or server, if anybody is; see `introspection.py`."""

    def sent(self, client_gid: bytes, sequence: int, message: bytes) -> None:
        """The endpoint has written."""

    def received(self, client_gid: bytes, sequence: int, message: bytes) -> None:
        """Something has come for the endpoint."""


class ForeignServiceError(RosidlError):
    """The peer's middleware puts other bytes on the wire for services; one side has to change it."""


class ServerLostError(RosidlError, ConnectionError):
    """The server went away before it answered, or told an error in place of a response; the request may or may not have
    been handled. A server that was killed is missed when its lease is over, on DDS after 10 s, on Fast DDS 20.
    """


class CallTimeoutError(RosidlError, TimeoutError):
    """No response came in time; the request may or may not have been handled."""


def carrier_qos(qos: QoSProfile) -> QoSProfile:
    """The profile of a service's endpoints: as asked for, but nothing is ever dropped for depth.

    An overwritten request or response is a call that never returns, and any number of calls may be under way. History
    takes no part in matching, so peers with keep-last 10 (the ROS default) connect all the same.
    """
    return without_best_available(qos).keep_all()


def with_header(message: Payload, client: int, sequence: int) -> bytes:
    """Put the header into an encoded message, which is little-endian; filled up as DDS wants it, in the same copy."""
    rest = message[4:] if len(message) < _LARGE_BYTES else memoryview(message)[4:]
    return b"".join((message[:4], _LITTLE.pack(client & _MASK, sequence), rest, _FILL[len(message) & 3]))


def header_of(data: Payload) -> tuple[ClientId, int, int]:
    """Client, number of the request, and where the message begins; raises `DecodeError` when the bytes are too few."""
    identity = identity_of(data)
    if identity is not None:
        return *identity, 4 + IDENTITY_BYTES
    if len(data) < 4 + HEADER_BYTES:
        raise DecodeError("service header", len(data), f"expected at least {4 + HEADER_BYTES} bytes, found {len(data)}")
    client, sequence = (_LITTLE if data[1] & 1 else _BIG).unpack_from(data, 4)
    return client, sequence, 4 + HEADER_BYTES


def message_of(data: Payload, begin: int) -> bytes:
    """The plain message, copied."""
    rest = data[begin:] if len(data) < _LARGE_BYTES else memoryview(data)[begin:]
    return b"".join((data[:2], b"\0\0", rest))


def send(writer: Writer, message: bytes, client: ClientId, sequence: int, timeout_s: float | None = None) -> bool:
    """Write a request or reply for that client, in the way of its kind; see `Writer.write`."""
    if isinstance(client, bytes):
        return writer.write(message, (client, sequence), timeout_s)
    return writer.write(with_header(message, client, sequence))


def request_gid(client: ClientId, handle: int) -> bytes:
    """How a server names whom a request came from: of a client on Cyclone its number and its writer's handle here."""
    if isinstance(client, bytes):
        return client
    return (client & _MASK).to_bytes(8, "little") + (handle & _MASK).to_bytes(8, "little")


def foreign_reason(graph: Graph, endpoint: EndpointFound | None, service: str, role: str, refusal: str | None) -> str:
    """What to tell a person about a service peer that cannot be talked to."""
    node = "a node" if endpoint is None else graph.describe_node(endpoint)
    return (
        f"{role} of service {service} is {node} on Fast DDS. Topics work with it, services do not here: {refusal}. "
        "Use the cyclonedds wheel for Linux x86-64 that this version was made for, or start that node with "
        "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp"
    )
