"""Graph messages in a domain with Humble, whose GIDs have 24 bytes (docs/internals/protocol.md 6.5)."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from support.announced_types import humble_node
from support.inner_state import participant_of
from support.waiting import until

from rosidl_py_gen import get_message
from rosidl_py_gen.cdr.layout import Header
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.msgs.rmw_dds_common.msg import ParticipantEntitiesInfo
from rosidl_py_gen.runtime.node.settings import read_environment
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, EndpointSpec, EntityLost, NodeEntities, TopicKey
from rosidl_py_gen.runtime.transport.dds import discovery_info
from rosidl_py_gen.runtime.transport.qos import QoSProfile

if TYPE_CHECKING:
    from support.worlds import World

    from rosidl_py_gen.runtime import Node

PREFIX = bytes.fromhex("0110f307000a000100000001")
GUID = PREFIX + bytes.fromhex("000001c1")
READER, WRITER = PREFIX + b"\0\0\5\4", PREFIX + b"\0\0\6\3"
KEY, TYPE = TopicKey("unmangled", discovery_info.DISCOVERY_TOPIC), "rmw_dds_common/msg/ParticipantEntitiesInfo"
NODES = [NodeEntities("/robot", "talker", frozenset([READER]), frozenset([WRITER]))]
Humble: Any = get_message(TYPE, distro="humble")


def test_humble_graph_message_equals_the_encoded_humble_class() -> None:
    data = discovery_info.encode_message(GUID, NODES, is_humble=True)
    message = Humble.decode(data)
    assert message.encode() == data
    (node,) = message.node_entities_info_seq
    assert (node.node_namespace, node.node_name) == ("/robot", "talker")
    assert [bytes(gid.data) for gid in node.reader_gid_seq] == [READER + bytes(8)]
    for is_humble in (True, False):
        data = discovery_info.encode_message(GUID, NODES, is_humble=is_humble)
        for pad in (b"", b"\0\0"):  # of the network
            found = discovery_info.decode_message(data + pad, PREFIX)
            assert (found.guid, found.nodes, found.is_humble) == (GUID, tuple(NODES), is_humble)


def test_humble_graph_message_has_no_nodes_for_later_distributions() -> None:
    data = discovery_info.encode_message(GUID, NODES, is_humble=True)
    assert ParticipantEntitiesInfo.decode(data).node_entities_info_seq == []


def test_humble_reads_a_later_graph_message_with_namespace_as_node_count() -> None:
    data = discovery_info.encode_message(GUID, NODES)
    assert int.from_bytes(data[Header.SIZE + 24 :][:4], "little") == int.from_bytes(b"/rob", "little") > 1.6e9
    with pytest.raises(DecodeError):
        Humble.decode(data)


@pytest.mark.parametrize(("value", "expected"), [("humble", "humble"), (" Humble ", "humble"), ("jazzy", "jazzy")])
def test_the_environment_selects_the_graph_message_format(value: str, expected: str) -> None:
    assert read_environment({"ROS_DISTRO": value}).ros_distro == expected
    assert read_environment({}).ros_distro == ""
    assert read_environment({"ROS_DISTRO": value}, distro="kilted").ros_distro == "kilted"


class Formats:
    """Formats of the graph messages of a node's context, as another one receives them."""

    def __init__(self, observer: Node, observed: Node) -> None:
        participant = participant_of(observer)
        self._prefix = participant_of(observed).guid[:12]
        self._reader = participant.create_reader(EndpointSpec(KEY, TYPE, QoSProfile().keep_all().transient_local()))
        self._last: bool | None = None

    def is_humble(self) -> bool | None:
        self._reader.fetch()
        while self._reader.queue.items:
            data, _, handle, *_ = self._reader.queue.items.popleft()
            if (self._reader.writer_guid(handle) or b"")[:12] == self._prefix:
                self._last = discovery_info.decode_message(data, self._prefix).is_humble
        return self._last


def writer_of(guid: bytes, type_hash: str) -> DiscoveredEndpoint:
    """A discovered writer of the topic."""
    return DiscoveredEndpoint(guid, b"", True, KEY, "", QoSProfile(), type_hash, wire_name=KEY.name)


LATER = writer_of(bytes([1, 15]).ljust(16, b"\1"), "RIHS01_00")  # on Fast DDS


class SingleParticipant:
    """Participant with one node, its reader and its writer; the test is the network."""

    def __init__(self) -> None:
        self.guid, self.sender, self.is_humble = GUID, b"", False
        self.queue, self.items, self.events = self, deque[Any](), list[Any]()
        self.create_reader = self.create_writer = lambda spec: self
        self.uses_sample_identity = lambda guid: guid == LATER.guid
        self.fetch, self.set_sink, self.writer_guid = bool, bool, lambda _: self.sender
        self.topic = discovery_info.DiscoveryInfoTopic(self, self.events.extend)
        self.topic.announce({1: NODES[0]})

    def write(self, data: bytes) -> None:
        self.is_humble = discovery_info.decode_message(data, PREFIX).is_humble

    def receive(self, sender: bytes, *, is_humble: bool) -> None:
        self.sender = sender
        self.items.append((discovery_info.encode_message(sender, NODES, is_humble=is_humble), 0, 1, 0, None))
        self.topic.read()


async def test_humble_format_is_used_until_later_peers_appear_and_while_humble_peers_exist(
    dds: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    alice, bob = dds.pair()
    formats = Formats(bob, alice)
    await until(lambda: formats.is_humble() is True)  # both read it, and later nodes of Humble are not harmed
    with monkeypatch.context() as patch:
        patch.setenv("ROS_DISTRO", "jazzy")
        new = dds.node("new")
    await until(lambda: formats.is_humble() is False)
    assert await new.wait_for_node("alice", 10) and await bob.wait_for_node("alice", 10)
    old = humble_node(dds, "old")
    await until(lambda: formats.is_humble() is True)
    assert await bob.wait_for_node("alice", 10) and await old.wait_for_node("alice", 10)
    warning = "So this process announces its nodes in the format of Humble, "
    await until(lambda: caplog.text.count(warning) == 2)  # alice's context and bob's
    alice.create_publisher("std_msgs/msg/String", "late")
    await until(lambda: bob.count_publishers("late") == 1)
    old.context.close()
    await until(lambda: formats.is_humble() is False)
    new.context.close()
    await until(lambda: formats.is_humble() is True)
    assert caplog.text.count(warning) == 2


def test_writer_without_hash_is_treated_as_humble_until_its_message_shows_otherwise(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Its reader would get our last message before its own is here."""
    unknown, own = bytes(16), SingleParticipant()  # of no vendor
    own.topic.forward_events([LATER])
    assert own.is_humble is False
    own.topic.forward_events([replace(LATER, guid=unknown, type_hash="")])
    assert own.is_humble is True
    own.receive(unknown, is_humble=False)
    assert own.is_humble is False and "Humble" not in caplog.text
    own.topic.forward_events([EntityLost(LATER.guid), EntityLost(unknown)])
    assert own.is_humble is True


@pytest.mark.parametrize("distro", ["jazzy", "humble"])
async def test_ros_distro_fixes_the_graph_message_format(
    dds: World, distro: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("ROS_DISTRO", distro)
    alice, bob = dds.pair()
    formats = Formats(bob, alice)
    await until(lambda: formats.is_humble() is (distro == "humble"))
    old = humble_node(dds, "old")
    await alice.wait_for_node("old", 10)
    warning = "Set ROS_DISTRO=humble to announce the nodes of this process in the format of Humble"
    if distro == "jazzy":
        await until(lambda: caplog.text.count(warning) == 2)
    assert formats.is_humble() is (distro == "humble")
    assert (warning in caplog.text) is (distro == "jazzy")
    assert await bob.wait_for_node("alice", 10) and await old.wait_for_node("alice", 10)
    assert bob.get_publishers_info_by_topic("/rosout")


def test_graph_message_of_lost_writer_does_not_change_the_format() -> None:
    own, short = SingleParticipant(), writer_of(WRITER, "")
    own.topic.forward_events([LATER, short])
    own.topic.forward_events([EntityLost(WRITER)])
    assert own.is_humble is False
    own.receive(WRITER, is_humble=True)
    assert own.is_humble is False
    own.events.clear()
    own.topic.forward_events([short])  # as if it was not there before
    assert own.is_humble is True and own.events == [short]


def test_writer_rediscovered_in_the_same_batch_is_known() -> None:
    own, found = SingleParticipant(), writer_of(WRITER, "")
    own.topic.forward_events([LATER, found])
    own.topic.forward_events([EntityLost(WRITER), found])
    assert own.is_humble is True
    own.receive(WRITER, is_humble=True)
    assert own.events[-1].is_humble is True
    own.topic.forward_events([found, EntityLost(WRITER)])
    assert own.is_humble is False
    own.receive(WRITER, is_humble=True)
    assert own.events[-1].is_humble is None
