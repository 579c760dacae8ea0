"""Random streams, compared with message_filters."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.system_python import Oracle, running

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.message_filters import ApproximateTimeSynchronizer, Cache, MessageFilter, TimeSynchronizer

PointStamped: Any = get_message("geometry_msgs/msg/PointStamped")
ORACLE = Path(__file__).parent / "message_filters_oracle.py"
MS = 10**6


def stamped(stamp: int, name: int) -> Any:
    message = PointStamped()
    set_stamp(message.header.stamp, stamp)
    message.point.x = float(name)
    return message


def names(messages: Any) -> list[int]:
    return [int(one.point.x) for one in messages]


@pytest.fixture(scope="module")
def message_filters() -> Iterator[Oracle]:
    with running(ORACLE, "message_filters", "python3-message-filters") as oracle:
        yield oracle


def sets(inputs: int, queue_size: int, slop_s: float | None, messages: list[tuple[int, int]]) -> list[list[list[int]]]:
    """Return the sets that our synchronizer passes after each message."""
    found: list[list[list[int]]] = []
    filters = [MessageFilter() for _ in range(inputs)]
    made: Any = (
        TimeSynchronizer(filters, queue_size=queue_size)
        if slop_s is None
        else ApproximateTimeSynchronizer(filters, slop_s=slop_s, queue_size=queue_size)
    )
    made.register_callback(lambda one, *others: found[-1].append(names([one, *others])))
    for name, (index, stamp) in enumerate(messages):
        found.append([])
        filters[index].signal_message(stamped(stamp, name))
    return found


@st.composite
def streams(draw: st.DrawFn) -> tuple[int, int, list[tuple[int, int]]]:
    """Draw the number of inputs, the queue size, and messages that are early, late, repeated or missing."""
    inputs = draw(st.integers(1, 4))
    step = draw(st.sampled_from([1, 7 * MS, 100 * MS]))
    ticks = draw(st.lists(st.tuples(st.integers(0, inputs - 1), st.integers(0, 12)), max_size=40))
    spread = draw(st.integers(0, 3))
    messages = [
        (index, (tick * 2 + number // 4) * step + number % (spread + 1)) for number, (index, tick) in enumerate(ticks)
    ]
    return inputs, draw(st.integers(1, 6)), messages


@given(streams())
def test_time_synchronizer_passes_the_sets_of_message_filters(message_filters: Any, stream: Any) -> None:
    inputs, size, messages = stream
    assert sets(inputs, size, None, messages) == message_filters.ask(["sets", inputs, size, None, messages])


@given(streams(), st.sampled_from([0.0, 1e-9, 2e-9, 5e-9, 0.007, 0.014, 0.03, 0.1, 0.5, 10.0]))
def test_approximate_synchronizer_passes_the_sets_of_message_filters(
    message_filters: Any, stream: Any, slop_s: float
) -> None:
    inputs, size, messages = stream
    assert sets(inputs, size, slop_s, messages) == message_filters.ask(["sets", inputs, size, slop_s, messages])


@given(
    st.integers(1, 8),
    st.lists(st.integers(0, 30), max_size=20).map(sorted),
    st.lists(st.tuples(st.integers(0, 31), st.integers(0, 31)).map(sorted), max_size=10),
)
def test_cache_returns_the_messages_that_message_filters_returns(
    message_filters: Any, size: int, stamps: list[int], questions: list[list[int]]
) -> None:
    source = MessageFilter()
    cache = Cache(source, size)
    for name, stamp in enumerate(stamps):
        source.signal_message(stamped(stamp, name))
    answers = []
    for start, end in questions:
        around = cache.at_or_before(end), cache.at_or_after(start)
        answers.append([names(cache.interval(start, end)), *(one and names([one])[0] for one in around)])
    wanted, last = message_filters.ask(["cached", size, stamps, questions])
    assert answers == wanted
    # If several messages have the highest stamp, message_filters returns the first, this package the last.
    latest = cache.latest()
    assert (latest is None) == (last is None)
    assert latest is None or stamps[names([latest])[0]] == stamps[last]


@given(st.integers(1, 6), st.lists(st.integers(0, 20), max_size=20), st.integers(0, 21), st.integers(0, 5))
def test_late_messages_are_sorted_into_the_cache_by_stamp(
    size: int, stamps: list[int], start: int, length: int
) -> None:
    """Compare with a slow reference that sorts as message_filters in C++, and as its Python comments state."""
    source, kept = MessageFilter(), []
    cache = Cache(source, size)
    for name, stamp in enumerate(stamps):
        source.signal_message(stamped(stamp, name))
        kept = sorted([*kept[-(size - 1) :], (stamp, name)] if size > 1 else [(stamp, name)])
    within = [name for stamp, name in kept if start <= stamp <= start + length]
    assert names(cache.interval(start, start + length)) == within
    assert (cache.oldest_stamp, cache.latest_stamp) == ((kept[0][0], kept[-1][0]) if kept else (None, None))


def test_full_queue_of_almost_matching_messages_is_searched_quickly() -> None:
    """message_filters tries 200 ** 5 combinations here."""
    inputs, waiting = 6, 200
    messages = [
        (index, 10**9 + (index % 2) * 101 * MS + number) for number in range(waiting) for index in range(1, inputs)
    ]
    found = sets(inputs, waiting, 0.1, [*messages, (0, 10**9 + 50 * MS)])
    assert list(itertools.chain(*found)) == []
