"""Lost messages: docs/internals/zenoh.md 8."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.waiting import until
from support.worlds import World
from support.zenoh_peer import Peer, PlainPublisher

from rosidl_py_gen import type_hash
from rosidl_py_gen.msgs.rcl_interfaces.msg import ParameterType
from rosidl_py_gen.runtime import CountStatus, SubscriptionEventCallbacks, UnsupportedEventError
from rosidl_py_gen.runtime.transport.zenoh.endpoints import SequenceGaps

ONE, OTHER = b"1" * 16, b"2" * 16
TYPE = "rcl_interfaces::msg::dds_::ParameterType_"


def counted(*numbers: tuple[bytes, Iterable[int]]) -> int:
    gaps = SequenceGaps()
    for publisher, given_ in numbers:
        for number in given_:
            gaps.on_sample(publisher, number)
    return gaps.lost


@pytest.mark.parametrize(
    ("numbers", "lost"),
    [
        ([(ONE, [1, 2, 3]), (OTHER, [1, 2]), (ONE, [4])], 0),
        ([(ONE, [7, 8]), (OTHER, [100])], 0),  # samples before the first received one do not count
        ([(ONE, [1, 4]), (OTHER, [1, 3])], 3),
        ([(ONE, [1, 1, 2, 2])], 0),
        ([(ONE, [1, 3, 2, 4])], 1),  # 2 was overtaken
    ],
)
def test_lost_messages_are_counted_for_each_publisher(numbers: list[tuple[bytes, list[int]]], lost: int) -> None:
    assert counted(*numbers) == lost


@given(st.lists(st.integers(0, 20), unique=True, min_size=1).map(sorted))
def test_missing_sequence_numbers_are_counted_as_lost(numbers: list[int]) -> None:
    assert counted((ONE, numbers)) == numbers[-1] - numbers[0] + 1 - len(numbers)


def test_sequence_gaps_forget_old_publishers_and_keep_the_count() -> None:
    gaps = SequenceGaps()
    for publisher in range(3000):
        gaps.on_sample(publisher.to_bytes(16, "big"), 1)
        gaps.on_sample(publisher.to_bytes(16, "big"), 3)
    assert gaps.lost == 3000
    for publisher in (2999, 2999 - 1024):  # a known one, and one that counts as new
        gaps.on_sample(publisher.to_bytes(16, "big"), 5)
    assert gaps.lost == 3001


async def test_message_lost_callback_reports_missing_sequence_numbers(zenoh: World, peer: Peer) -> None:
    lost: list[CountStatus] = []
    received: list[ParameterType] = []
    callbacks = SubscriptionEventCallbacks(message_lost=lost.append)
    zenoh.node("n").create_subscription(ParameterType, "t", received.append, event_callbacks=callbacks)
    publisher = PlainPublisher(peer, "/t", f"{TYPE}/{type_hash(ParameterType)}")
    data = ParameterType().encode()

    def publish(skipped: int) -> None:
        publisher.numbers = itertools.count(next(publisher.numbers) + skipped)
        publisher.publish(data)

    await until(lambda: bool(publish(0) or received))  # samples sent before the match do not count
    publish(2)
    await until(lambda: bool(lost))
    publish(0)
    publish(1)
    await until(lambda: len(lost) == 2)
    assert lost == [CountStatus(2, 2), CountStatus(3, 1)]


def test_missed_deadlines_are_not_reported(zenoh: World) -> None:
    with pytest.raises(UnsupportedEventError, match="this middleware does not report deadline events"):
        zenoh.node("n").create_subscription(
            ParameterType, "t", event_callbacks=SubscriptionEventCallbacks(deadline=print)
        )
