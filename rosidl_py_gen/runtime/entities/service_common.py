"""What both ends of a service share: their errors, who listens, and the profile of what carries them."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.transport.qos_matching import without_best_available

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.graph.graph import Graph
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.service_api import IncompatiblePeer


class IntrospectionState(IntEnum):
    """How much is published of what passes a client or server."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2


class IncompatibleServiceError(RosidlError):
    """The peer's middleware puts other bytes on the wire for services; one side has to change it."""


class ServerLostError(RosidlError, ConnectionError):
    """The server went away before it answered, or told an error in place of a response; the request may or may not have
    been handled. A server that was killed is missed when its lease is over, on DDS after 10 s, on Fast DDS 20.
    """


class CallTimeoutError(RosidlError, TimeoutError):
    """No response came in time; the request may or may not have been handled."""


def service_endpoint_qos(qos: QoSProfile) -> QoSProfile:
    """The profile of a service's endpoints: as asked for, but nothing is ever dropped for depth.

    An overwritten request or response is a call that never returns, and any number of calls may be under way. History
    takes no part in matching, so peers with keep-last 10 (the ROS default) connect all the same.
    """
    return without_best_available(qos).keep_all()


def incompatible_peer_text(graph: Graph, refused: IncompatiblePeer, service: str, role: str) -> str:
    """What to tell a person about a service peer that cannot be talked to."""
    endpoint = graph.endpoints.get(refused.guid)
    node = "a node" if endpoint is None else graph.describe_node(endpoint)
    return (
        f"{role} of service {service} is {node} on Fast DDS. Topics work with it, services do not here: "
        f"{refused.reason}. "
        "Another libddsc may do (ROSIDL_LIBDDSC names one), or start that node with "
        "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp"
    )
