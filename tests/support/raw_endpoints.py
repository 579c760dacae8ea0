"""Readers and writers with names of DDS, for tests that inspect bytes or announce invalid data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, EndpointSpec, TopicKey
from rosidl_py_gen.runtime.transport.dds.names import ros_type, topic_key_of, wire_name
from rosidl_py_gen.runtime.transport.memory import MemoryParticipant
from support.inner_state import participant_of, scope_of

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.api import Reader, Writer

DEEP = QoSProfile().keep_all()


def topic_name(name: str) -> str:
    """Return the name of a topic in DDS."""
    return wire_name(TopicKey("topic", name))


def request_name(name: str) -> str:
    """Return the name of a service's requests in DDS."""
    return wire_name(TopicKey("request", name))


def reply_name(name: str) -> str:
    """Return the name of a service's replies in DDS."""
    return wire_name(TopicKey("reply", name))


def spec(node: Any, topic: str, type: str, qos: QoSProfile, type_hash: str) -> EndpointSpec:
    """``rt/chatter`` is a topic; the halves of services are bare names, except in memory, where names are compared."""
    topic_key, participant = topic_key_of(topic), participant_of(node)
    if topic_key.kind != "topic" and not isinstance(participant, MemoryParticipant):
        topic_key = TopicKey("unmangled", topic)
    return EndpointSpec(topic_key, ros_type(type), qos, type_hash, node=scope_of(node).number)


def reader(node: Any, topic: str, type: str, qos: QoSProfile = DEEP, type_hash: str = "") -> Reader:
    made: Reader = participant_of(node).create_reader(spec(node, topic, type, qos, type_hash))
    return made


def writer(node: Any, topic: str, type: str, qos: QoSProfile = DEEP, type_hash: str = "") -> Writer:
    made: Writer = participant_of(node).create_writer(spec(node, topic, type, qos, type_hash))
    return made


def announce(node: Any, topic: str, type: str, type_hash: str = "", *, is_writer: bool = True) -> Reader | Writer:
    """Announce an endpoint as one of the node."""
    end = (writer if is_writer else reader)(node, topic, type, QoSProfile(), type_hash)
    scope_of(node).register(end, **{"writer" if is_writer else "reader": end.guid})
    return end


def found(guid: bytes, participant: bytes, topic: str, type: str, qos: QoSProfile, **more: Any) -> DiscoveredEndpoint:
    is_writer = not guid[15] & 4
    names = {"wire_name": topic, "wire_type": type}
    return DiscoveredEndpoint(guid, participant, is_writer, topic_key_of(topic), ros_type(type), qos, **names, **more)
