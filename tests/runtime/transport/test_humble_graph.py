"""Graph messages in a domain with Humble, whose GIDs have 24 bytes (docs/internals/protocol.md 6.5)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from support.node_fixtures import until

from rosidl_py_gen import get_message
from rosidl_py_gen.cdr.layout import HEADER_BYTES
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.msgs.rmw_dds_common.msg import ParticipantEntitiesInfo
from rosidl_py_gen.runtime.node.environment import read_environment
from rosidl_py_gen.runtime.transport.dds import discovery_info, discovery_info_message
from rosidl_py_gen.runtime.transport.discovery_events import NodeEntities

if TYPE_CHECKING:
    from support.node_fixtures import World

    from rosidl_py_gen.runtime import Node

PREFIX = bytes.fromhex("0110f307000a000100000001")
GUID = PREFIX + bytes.fromhex("000001c1")
READER, WRITER = PREFIX + b"\0\0\5\4", PREFIX + b"\0\0\6\3"
NODES = [NodeEntities("/robot", "talker", frozenset([READER]), frozenset([WRITER]))]
Humble: Any = get_message("rmw_dds_common/msg/ParticipantEntitiesInfo", distro="humble")


def test_the_format_of_humble_is_what_its_class_writes() -> None:
    data = discovery_info_message.encode(GUID, NODES, is_humble=True)
    message = Humble.decode(data)
    assert message.encode() == data
    (node,) = message.node_entities_info_seq
    assert (node.node_namespace, node.node_name) == ("/robot", "talker")
    assert [bytes(gid.data) for gid in node.reader_gid_seq] == [READER + bytes(8)]
    assert discovery_info_message.decode(data, PREFIX) == (GUID, NODES, True)
    assert discovery_info_message.decode(discovery_info_message.encode(GUID, NODES), PREFIX) == (GUID, NODES, False)


def test_later_distributions_read_no_nodes_in_the_format_of_humble() -> None:
    data = discovery_info_message.encode(GUID, NODES, is_humble=True)
    assert ParticipantEntitiesInfo.decode(data).node_entities_info_seq == []


def test_humble_takes_a_namespace_for_the_number_of_nodes() -> None:
    data = discovery_info_message.encode(GUID, NODES)
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
                self._last = discovery_info_message.decode(data, self._prefix).is_humble
        return self._last


def humble_node(dds: World, monkeypatch: pytest.MonkeyPatch) -> Node:
    """Return a node whose graph messages are those of Humble: without a hash."""
    with monkeypatch.context() as patch:
        patch.setenv("ROS_DISTRO", "humble")
        patch.setattr(discovery_info, "HASHES", {discovery_info._TYPE: ""})
        return dds.node("old")


async def test_nodes_are_announced_in_the_format_of_humble_while_it_is_there(
    dds: World, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    alice, bob = dds.pair()
    formats = Formats(bob, alice)
    await until(lambda: formats.is_humble() is False)
    old = humble_node(dds, monkeypatch)
    await until(lambda: formats.is_humble() is True)
    assert await bob.wait_for_node("alice", 10) and await old.wait_for_node("alice", 10)
    said = "So this process announces its nodes in the format of Humble from now on"
    await until(lambda: caplog.text.count(said) == 2)  # alice's context and bob's
    alice.create_publisher("std_msgs/msg/String", "late")
    await until(lambda: bob.count_publishers("late") == 1)
    old.context.close()
    await until(lambda: formats.is_humble() is False)
    assert caplog.text.count(said) == 2


@pytest.mark.parametrize("distro", ["jazzy", "humble"])
async def test_a_selected_distribution_decides(
    dds: World, distro: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("ROS_DISTRO", distro)
    alice, bob = dds.pair()
    formats = Formats(bob, alice)
    await until(lambda: formats.is_humble() is (distro == "humble"))
    old = humble_node(dds, monkeypatch)
    await alice.wait_for_node("old", 10)
    said = "Set ROS_DISTRO=humble to announce the nodes of this process in the format of Humble"
    if distro == "jazzy":
        await until(lambda: caplog.text.count(said) == 2)
    assert formats.is_humble() is (distro == "humble")
    assert (said in caplog.text) is (distro == "jazzy")
    assert await bob.wait_for_node("alice", 10) and await old.wait_for_node("alice", 10)
    assert bob.get_publishers_info_by_topic("/rosout")
