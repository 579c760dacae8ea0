"""Readers that request samples from before the first heartbeat; real peers: `interop_rclpy/test_services.py`."""

from __future__ import annotations

import ctypes as ct
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import String

from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone
from rosidl_py_gen.runtime.transport.cyclone import private_layout
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.early_samples import EarlySampleReaders
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.interop import FastDdsInterop

if TYPE_CHECKING:
    from support.node_fixtures import World

    from rosidl_py_gen.runtime import Node

ALL = 2
KINDS = [
    pytest.param(QoSProfile(depth=5), True, id="reliable, volatile"),
    pytest.param(QoSProfile(depth=5).transient_local(), True, id="reliable, transient local"),
    pytest.param(QoSProfile(depth=5).best_effort(), False, id="best effort"),
]


def flags_of(entity: int) -> int:
    """Return the flags of a reader in Cyclone."""
    offsets = cyclone._fast_dds.reader_offsets
    assert offsets is not None
    with cyclone._api.locked_entity(entity) as address:
        reader = ct.c_uint64.from_address(address + offsets.entity).value
        return ct.c_ubyte.from_address(reader + offsets.flags).value


def newest_reader(node: Node) -> Any:
    participant: Any = node._scope.participant
    return list(participant.readers.values())[-1]


@pytest.mark.parametrize(("qos", "wants_all"), KINDS)
def test_reliable_readers_want_all_there_is(dds: World, qos: QoSProfile, wants_all: bool) -> None:
    node = dds.node()
    node.create_subscription(String, "topic", qos=qos)
    flags = flags_of(newest_reader(node).entity)
    assert (flags & 1, bool(flags & ALL)) == (wants_all, wants_all)


def test_a_reader_wants_all_before_the_first_writer_is_connected(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    node = dds.node()
    node.create_publisher(String, "topic")
    participant: Any = node._scope.participant
    early = participant._early
    # Only the listener sets the flag here, not the code after the creation.
    monkeypatch.setattr(early, "create_reader", lambda create, is_reliable: create(early._during_creation))
    node.create_subscription(String, "topic")
    assert flags_of(newest_reader(node).entity) & ALL
    node.create_subscription(String, "nobody_writes_here")
    assert not flags_of(newest_reader(node).entity) & ALL


def early_samples(dds: World, fast_dds: FastDdsInterop) -> tuple[EarlySampleReaders, Any]:
    participant: Any = dds.node()._scope.participant
    return EarlySampleReaders(cyclone._api, fast_dds, participant._listener), participant


def test_readers_are_left_alone_where_they_do_not_look_as_known(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    unknown = FastDdsInterop(cyclone._api)
    early, participant = early_samples(dds, unknown)
    monkeypatch.setattr(private_layout, "probe_reader_offsets", lambda *_: None)
    early.probe_layout(participant.discovery.entities[0])
    reason = unknown.capabilities()["first samples of nodes on Fast DDS"]
    assert reason == "the layout of readers is unknown in this library"
    listeners: list[int] = []
    assert early.create_reader(lambda listener: (listeners.append(listener), 7)[1], is_reliable=True) == 7
    assert listeners == [participant._listener]
    early.close()


def test_a_reader_that_is_not_as_known_is_left_alone_and_ends_it(dds: World) -> None:
    fast_dds = FastDdsInterop(cyclone._api)
    known = cyclone._fast_dds.reader_offsets
    early, participant = early_samples(dds, fast_dds)
    assert known is not None
    fast_dds.reader_offsets = known._replace(entity=known.entity - 16)  # another pointer
    participant._early = early
    node = dds.nodes[-1]
    node.create_subscription(String, "topic")
    assert "a reader, " in fast_dds.early_refusal
    assert not flags_of(newest_reader(node).entity) & ALL
