"""Drift-free schedule of timers (docs/internals/protocol.md 9.6)."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.inner_state import scope_of

from rosidl_py_gen.runtime import Context, MemoryTransport, Node
from rosidl_py_gen.runtime.clocks import TimerSchedule, period_to_ns
from rosidl_py_gen.runtime.time_values import Duration, TimeRangeError


def test_late_calls_do_not_shift_later_due_times() -> None:
    schedule = TimerSchedule(10, 100)
    assert not schedule.is_ready(109) and schedule.is_ready(110)
    call = schedule.mark_called(113)
    assert (call.since_last_ns, call.missed, schedule.next_ns) == (13, 0, 120)
    assert schedule.mark_called(121).since_last_ns == 8


@given(st.integers(1, 50), st.lists(st.integers(0, 300), max_size=30))
def test_next_call_is_the_first_grid_point_after_now(period: int, steps: list[int]) -> None:
    start = now = 1000
    schedule = TimerSchedule(period, start)
    skipped = calls = 0
    for step in steps:
        now += step
        if schedule.is_ready(now):
            skipped += schedule.mark_called(now).missed
            calls += 1
            assert now < schedule.next_ns <= now + period and (schedule.next_ns - start) % period == 0
    assert calls + skipped == (schedule.next_ns - start) // period - 1


def test_period_zero_is_always_ready() -> None:
    schedule = TimerSchedule(0, 100)
    assert schedule.is_ready(100)
    schedule.mark_called(105)
    assert schedule.next_ns == 105 and schedule.is_ready(105)


@pytest.mark.parametrize(
    ("bad", "error", "words"),
    [
        (math.nan, TimeRangeError, "period_s must be finite, got nan"),
        (math.inf, TimeRangeError, "period_s must be finite, got inf"),
        (-1, TimeRangeError, "period_s must be 0 or more seconds, got -1"),
        (None, TypeError, "period_s must be a number of seconds, got None"),
        ("1", TypeError, "period_s must be a number of seconds, got '1'"),
    ],
)
def test_invalid_timer_periods_are_refused(bad: Any, error: type[Exception], words: str) -> None:
    node = Node("n", context=Context(0, args=["p"], transport=MemoryTransport()))
    timer = node.create_timer(1)
    for make in (period_to_ns, node.create_timer, node.create_wall_timer, timer.change_period):
        with pytest.raises(error, match=words):
            make(bad)
    assert timer.period == Duration(seconds=1)
    node.context.close()
    assert period_to_ns(0.25) == 250_000_000


def test_timer_refuses_invalid_callback_or_clock() -> None:
    node = Node("n", context=Context(0, args=["p"], transport=MemoryTransport()))
    before = len(scope_of(node).owned)
    with pytest.raises(TypeError, match="callback must be a function, got 5"):
        node.create_timer(1, 5)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"clock must be a Clock such as node.clock, got 'steady'"):
        node.create_timer(1, clock="steady")  # type: ignore[arg-type]
    assert len(scope_of(node).owned) == before
    node.context.close()


def test_reset_of_canceled_timer_starts_a_new_period() -> None:
    schedule = TimerSchedule(10, 100)
    schedule.canceled = True
    assert schedule.time_until_ns(1000) is None and not schedule.is_ready(1000)
    schedule.reset(1000)
    assert schedule.time_until_ns(1000) == 10
    assert schedule.mark_called(1010).since_last_ns == 910


def test_changed_period_applies_after_the_next_call() -> None:
    schedule = TimerSchedule(10, 100)
    schedule.period_ns = 3
    assert schedule.time_until_ns(100) == 10
    schedule.mark_called(110)
    assert schedule.next_ns == 113


def test_timer_waits_while_its_ros_clock_reads_zero() -> None:
    schedule = TimerSchedule(0, 0, waits_at_zero=True)
    assert schedule.time_until_ns(0) is None and not schedule.is_ready(0)
    assert schedule.is_ready(1)


def test_time_source_change_keeps_elapsed_part_of_the_period() -> None:
    schedule = TimerSchedule(100, 1_000_000)
    schedule.before_source_change(1_000_030)
    schedule.after_source_change(500)
    assert (schedule.time_until_ns(500), schedule.last_ns) == (70, 470)


def test_overdue_timer_is_due_at_once_after_time_source_change() -> None:
    schedule = TimerSchedule(100, 1_000_000)
    schedule.before_source_change(1_005_000)
    schedule.after_source_change(500)
    assert schedule.time_until_ns(500) == 0


def test_elapsed_time_is_discarded_while_the_clock_reads_zero() -> None:
    schedule = TimerSchedule(100, 1_000_000, waits_at_zero=True)
    schedule.before_source_change(1_000_030)
    schedule.after_source_change(0)
    assert schedule.next_ns == 1_000_100
    schedule.after_jump(5_000)  # the first /clock: earlier than the last call, so a new period starts
    assert schedule.time_until_ns(5_000) == 100
    fresh = TimerSchedule(100, 0, waits_at_zero=True)
    fresh.before_source_change(0)
    fresh.after_source_change(1_000_000)
    assert fresh.time_until_ns(1_000_000) == 100


def test_forward_jump_makes_timer_due_and_backward_jump_restarts_its_period() -> None:
    schedule = TimerSchedule(100, 1_000)
    schedule.after_jump(5_000)
    assert schedule.is_ready(5_000) and schedule.mark_called(5_000).missed == 39
    schedule.after_jump(4_950)  # before the last call
    assert (schedule.time_until_ns(4_950), schedule.last_ns) == (100, 4_950)
    schedule.after_jump(4_960)  # not before the last call: unchanged
    assert schedule.time_until_ns(4_960) == 90
