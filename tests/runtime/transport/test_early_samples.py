"""Which readers ask for what was sent before Cyclone had heard a heartbeat; that they get it is tried with real peers
in `tests/interop_rclpy/test_early_requests.py`.
"""

from __future__ import annotations

import ctypes as ct
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import String

from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone
from rosidl_py_gen.runtime.transport.cyclone.catchup import EarlySamples
from rosidl_py_gen.runtime.transport.cyclone.fastdds import FastDds

if TYPE_CHECKING:
    from worlds import World

    from rosidl_py_gen.runtime import Node

ALL = 2
KINDS = [
    pytest.param(QoSProfile(depth=5), True, id="reliable, volatile"),
    pytest.param(QoSProfile(depth=5).transient_local(), True, id="reliable, transient local"),
    pytest.param(QoSProfile(depth=5).best_effort(), False, id="best effort"),
]


def flags_of(entity: int) -> int:
    """What Cyclone has noted of a reader."""
    api, layout, pinned = cyclone._api, cyclone._fast_dds.layout, ct.c_void_p()
    assert api.entity_pin(entity, ct.byref(pinned)) == 0 and pinned.value
    reader = ct.c_uint64.from_address(pinned.value + layout.entity_reader).value
    flags = ct.c_ubyte.from_address(reader + layout.reader_flags).value
    api.entity_unpin(pinned)
    return flags


def newest_reader(node: Node) -> Any:
    """The reader that was made last."""
    participant: Any = node._scope.participant
    return list(participant._readers.values())[-1]


@pytest.mark.parametrize(("qos", "wants_all"), KINDS)
def test_reliable_readers_want_all_there_is(dds: World, qos: QoSProfile, wants_all: bool) -> None:
    node = dds.node()
    node.create_subscription(String, "topic", qos=qos)
    flags = flags_of(newest_reader(node).entity)
    assert (flags & 1, bool(flags & ALL)) == (wants_all, wants_all)


def test_a_reader_wants_all_before_the_first_writer_is_connected(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cyclone tells its listener of a connection first, and nobody asks afterwards here."""
    node = dds.node()
    node.create_publisher(String, "topic")
    participant: Any = node._scope.participant
    early = participant._early
    monkeypatch.setattr(early, "create_reader", lambda create: create(early._during_creation))
    node.create_subscription(String, "topic")
    assert flags_of(newest_reader(node).entity) & ALL
    node.create_subscription(String, "nobody_writes_here")
    assert not flags_of(newest_reader(node).entity) & ALL


def early_samples(dds: World, fast_dds: FastDds) -> tuple[EarlySamples, Any]:
    """Together with the participant whose readers it shall make."""
    participant: Any = dds.node()._scope.participant
    return EarlySamples(cyclone._api, fast_dds, participant._listener), participant


def test_readers_are_left_alone_with_an_unknown_build(dds: World) -> None:
    unknown = FastDds(SimpleNamespace(_name="/somewhere/libddsc.so.12"))  # type: ignore[arg-type]
    early, participant = early_samples(dds, unknown)
    listeners: list[int] = []
    assert early.create_reader(lambda listener: (listeners.append(listener), 7)[1]) == 7
    assert listeners == [participant._listener]
    early.close()


def test_a_reader_that_is_not_as_known_is_left_alone_and_ends_it(dds: World) -> None:
    fast_dds = FastDds(cyclone._library)
    fast_dds.layout = fast_dds.layout._replace(entity_reader=fast_dds.layout.entity_reader - 16)  # its topic
    early, participant = early_samples(dds, fast_dds)
    participant._early = early
    node = dds.nodes[-1]
    node.create_subscription(String, "topic")
    assert fast_dds.refusal is not None and "a reader, " in fast_dds.refusal
    assert not flags_of(newest_reader(node).entity) & ALL
