"""Graph messages in a domain with Humble, whose GIDs have 24 bytes (docs/internals/protocol.md 6.5)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest
from support.node_fixtures import until

from rosidl_py_gen import get_message
from rosidl_py_gen.cdr.layout import HEADER_BYTES
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.msgs.rmw_dds_common.msg import ParticipantEntitiesInfo
from rosidl_py_gen.runtime.node.environment import read_environment
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, EntityLost, NodeEntities, NodesAnnounced, TopicKey
from rosidl_py_gen.runtime.transport.dds import discovery_info
from rosidl_py_gen.runtime.transport.qos import QoSProfile

if TYPE_CHECKING:
    from support.node_fixtures import World

    from rosidl_py_gen.runtime import Node

PREFIX = bytes.fromhex("0110f307000a000100000001")
GUID = PREFIX + bytes.fromhex("000001c1")
READER, WRITER = PREFIX + b"\0\0\5\4", PREFIX + b"\0\0\6\3"
NODES = [NodeEntities("/robot", "talker", frozenset([READER]), frozenset([WRITER]))]
Humble: Any = get_message("rmw_dds_common/msg/ParticipantEntitiesInfo", distro="humble")


def test_the_format_of_humble_is_what_its_class_writes() -> None:
    data = discovery_info.encode_message(GUID, NODES, is_humble=True)
    message = Humble.decode(data)
    assert message.encode() == data
    (node,) = message.node_entities_info_seq
    assert (node.node_namespace, node.node_name) == ("/robot", "talker")
    assert [bytes(gid.data) for gid in node.reader_gid_seq] == [READER + bytes(8)]
    for is_humble in (True, False):
        data = discovery_info.encode_message(GUID, NODES, is_humble=is_humble)
        for pad in (b"", b"\0\0"):  # of the network
            assert discovery_info.decode_message(data + pad, PREFIX) == NodesAnnounced(GUID, tuple(NODES), is_humble)


def test_later_distributions_read_no_nodes_in_the_format_of_humble() -> None:
    data = discovery_info.encode_message(GUID, NODES, is_humble=True)
    assert ParticipantEntitiesInfo.decode(data).node_entities_info_seq == []


def test_humble_takes_a_namespace_for_the_number_of_nodes() -> None:
    data = discovery_info.encode_message(GUID, NODES)
    assert int.from_bytes(data[HEADER_BYTES + 24 :][:4], "little") == int.from_bytes(b"/rob", "little") > 1.6e9
    with pytest.raises(DecodeError):
        Humble.decode(data)


@pytest.mark.parametrize(("value", "expected"), [("humble", "humble"), (" Humble ", "humble"), ("jazzy", "jazzy")])
def test_the_environment_selects_the_format(value: str, expected: str) -> None:
    assert read_environment({"ROS_DISTRO": value}).ros_distro == expected
    assert read_environment({}).ros_distro == ""
    assert read_environment({"ROS_DISTRO": value}, distro="kilted").ros_distro == "kilted"


class Formats:
    """Formats of the graph messages of a node's context, as another one receives them."""

    def __init__(self, observer: Node, observed: Node) -> None:
        participant: Any = observer.context._core.participant
        self._prefix = observed.context._core.participant.guid[:12]
        self._reader = participant.create_reader(discovery_info._spec(discovery_info._READER_QOS))
        self._last: bool | None = None

    def is_humble(self) -> bool | None:
        self._reader.fetch()
        while self._reader.queue.items:
            data, _, handle, *_ = self._reader.queue.items.popleft()
            if (self._reader.writer_guid(handle) or b"")[:12] == self._prefix:
                self._last = discovery_info.decode_message(data, self._prefix).is_humble
        return self._last


def node_of(dds: World, monkeypatch: pytest.MonkeyPatch, distro: str) -> Node:
    """Return a node whose graph messages are those of a distribution; those of Humble are without a hash."""
    with monkeypatch.context() as patch:
        patch.setenv("ROS_DISTRO", distro)
        if distro == "humble":
            patch.setattr(discovery_info, "HASHES", {discovery_info._TYPE: ""})
        return dds.node("old" if distro == "humble" else "new")


def writer_of(guid: bytes, type_hash: str) -> DiscoveredEndpoint:
    """A discovered writer of the topic."""
    key = TopicKey("unmangled", discovery_info.DISCOVERY_TOPIC)
    return DiscoveredEndpoint(guid, b"", True, key, "", QoSProfile(), type_hash, wire_name=key.name)


async def test_the_format_is_that_of_humble_until_a_later_distribution_is_there_and_while_humble_is(
    dds: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    alice, bob = dds.pair()
    formats = Formats(bob, alice)
    await until(lambda: formats.is_humble() is True)  # both read it, and no node of Humble that comes is harmed
    new = node_of(dds, monkeypatch, "jazzy")
    await until(lambda: formats.is_humble() is False)
    assert await new.wait_for_node("alice", 10) and await bob.wait_for_node("alice", 10)
    old = node_of(dds, monkeypatch, "humble")
    await until(lambda: formats.is_humble() is True)
    assert await bob.wait_for_node("alice", 10) and await old.wait_for_node("alice", 10)
    said = "So this process announces its nodes in the format of Humble, "
    await until(lambda: caplog.text.count(said) == 2)  # alice's context and bob's
    alice.create_publisher("std_msgs/msg/String", "late")
    await until(lambda: bob.count_publishers("late") == 1)
    old.context.close()
    await until(lambda: formats.is_humble() is False)
    new.context.close()
    await until(lambda: formats.is_humble() is True)
    assert caplog.text.count(said) == 2


async def test_a_writer_without_hash_counts_as_humble_until_its_message_tells_otherwise(
    dds: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Its reader would get our last message before its own is here."""
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    node = dds.node("alice")
    topic: Any = node.context._core.participant._discovery_info
    later, other = bytes(16), bytes([1, 15]).ljust(16, b"\1")  # of no vendor, and on Fast DDS
    found = writer_of(other, "RIHS01_00")
    topic.forward_events([found])
    assert topic._wrote_humble is False
    topic.forward_events([replace(found, guid=later, type_hash="")])
    assert topic._wrote_humble is True
    topic._set_layout(later, False)  # as its message does
    assert topic._wrote_humble is False and "Humble" not in caplog.text
    topic.forward_events([EntityLost(other), EntityLost(later)])
    assert topic._wrote_humble is True


@pytest.mark.parametrize("distro", ["jazzy", "humble"])
async def test_a_selected_distribution_decides(
    dds: World, distro: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("ROS_DISTRO", distro)
    alice, bob = dds.pair()
    formats = Formats(bob, alice)
    await until(lambda: formats.is_humble() is (distro == "humble"))
    old = node_of(dds, monkeypatch, "humble")
    await alice.wait_for_node("old", 10)
    said = "Set ROS_DISTRO=humble to announce the nodes of this process in the format of Humble"
    if distro == "jazzy":
        await until(lambda: caplog.text.count(said) == 2)
    assert formats.is_humble() is (distro == "humble")
    assert (said in caplog.text) is (distro == "jazzy")
    assert await bob.wait_for_node("alice", 10) and await old.wait_for_node("alice", 10)
    assert bob.get_publishers_info_by_topic("/rosout")


async def test_a_message_that_is_read_after_its_writer_has_left_does_not_decide_about_the_format(
    dds: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    topic: Any = dds.node("alice").context._core.participant._discovery_info
    later, short = bytes([1, 15]).ljust(16, b"\1"), WRITER
    found = writer_of(later, "RIHS01_00")
    topic.forward_events([found, replace(found, guid=short, type_hash="")])
    topic.forward_events([EntityLost(short)])
    assert topic._wrote_humble is False
    monkeypatch.setattr(topic._reader, "writer_guid", lambda _: short)
    topic._reader.queue.items.append((discovery_info.encode_message(GUID, NODES, is_humble=True), 0, 1, 0, None))
    topic._on_messages()
    assert topic._wrote_humble is False
    assert short not in topic._layouts and short not in topic._heard_writers and short not in topic._undecided


async def test_a_writer_that_was_lost_and_found_again_at_once_is_known(
    dds: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    topic: Any = dds.node("alice").context._core.participant._discovery_info
    found = writer_of(WRITER, "")
    topic.forward_events([found])
    topic.forward_events([EntityLost(WRITER), found])
    assert topic._writer_has_hash[WRITER] is False and topic._layouts[WRITER] is True
    topic.forward_events([found, EntityLost(WRITER)])
    assert WRITER not in topic._writer_has_hash and WRITER not in topic._layouts
