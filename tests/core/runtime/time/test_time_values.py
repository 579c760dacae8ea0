"""Times and durations: exact nanoseconds, clock types."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen.runtime.time_values import ClockType, ClockTypeError, Duration, Time, TimeRangeError, seconds_to_ns

ROS, SYSTEM, STEADY = ClockType.ROS_TIME, ClockType.SYSTEM_TIME, ClockType.STEADY_TIME
NS = st.integers(-(2**62), 2**62)


@dataclass
class Stamp:
    sec: int
    nanosec: int


def test_clock_types_have_the_numbers_of_rcl() -> None:
    assert [int(kind) for kind in (ROS, SYSTEM, STEADY)] == [1, 2, 3]


def test_seconds_and_nanoseconds_are_added() -> None:
    assert Duration(seconds=1.5, nanoseconds=3).nanoseconds == 1_500_000_003
    assert Duration(seconds=-2).nanoseconds == -2_000_000_000
    assert Time(seconds=2**40, nanoseconds=1).nanoseconds == 2**40 * 10**9 + 1
    assert Time(seconds=1, nanoseconds=7).seconds_nanoseconds() == (1, 7)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), float("-inf")])
def test_non_finite_durations_are_refused(bad: float) -> None:
    with pytest.raises(TimeRangeError, match="finite"):
        Duration(seconds=bad)


@pytest.mark.parametrize("bad", ["1", None, True, 1j, [1]])
def test_seconds_must_be_numbers(bad: Any) -> None:
    with pytest.raises(TypeError, match="seconds must be a number of seconds, got"):
        Duration(seconds=bad)
    with pytest.raises(TypeError, match="start must be a number of seconds, got"):
        seconds_to_ns("start", bad)


def test_seconds_may_be_any_kind_of_number() -> None:
    for value in (np.float32(1.5), np.float64(1.5), Fraction(3, 2), 1.5):
        assert seconds_to_ns("x", value) == 1_500_000_000
    assert seconds_to_ns("x", np.int64(2)) == seconds_to_ns("x", 2) == 2_000_000_000
    assert seconds_to_ns("x", -0.25) == -250_000_000
    assert seconds_to_ns("x", 1e300) == int(1e300) * 10**9  # more than a float can hold


def test_negative_time_and_float_nanoseconds_are_refused() -> None:
    with pytest.raises(TimeRangeError, match="negative"):
        Time(seconds=-1)
    with pytest.raises(TimeRangeError, match="must be an int"):
        Duration(nanoseconds=1.5)  # type: ignore[arg-type]


@given(NS, NS)
def test_duration_arithmetic_is_integer_arithmetic(a: int, b: int) -> None:
    x, y = Duration(nanoseconds=a), Duration(nanoseconds=b)
    assert (x + y).nanoseconds == a + b
    assert (x - y).nanoseconds == a - b
    assert (-x).nanoseconds == -a and abs(x).nanoseconds == abs(a)
    assert (x < y, x <= y, x == y, x > y) == (a < b, a <= b, a == b, a > b)
    assert (x * 3).nanoseconds == (3 * x).nanoseconds == 3 * a
    assert bool(x) is (a != 0)


@given(st.integers(0, 2**62), st.integers(0, 2**62))
def test_time_minus_time_undoes_time_plus_duration(a: int, d: int) -> None:
    start, length = Time(nanoseconds=a, clock_type=ROS), Duration(nanoseconds=d)
    later = start + length
    assert later - start == length and later - length == start and length + start == later
    assert later >= start and not later < start and (later > start) == (d > 0) and (later <= start) == (d == 0)
    assert hash(later) == hash(Time(nanoseconds=a + d, clock_type=ROS))


def test_duration_can_be_divided_by_number_and_duration() -> None:
    assert Duration(seconds=3) / 2 == Duration(seconds=1.5)
    assert Duration(seconds=3) / Duration(seconds=2) == 1.5


def test_times_of_different_clocks_cannot_be_compared_or_subtracted() -> None:
    a, b = Time(nanoseconds=1, clock_type=ROS), Time(nanoseconds=1, clock_type=STEADY)
    assert a != b
    for wrong in (lambda: a < b, lambda: a <= b, lambda: a > b, lambda: a >= b, lambda: a - b):
        with pytest.raises(ClockTypeError, match="ROS_TIME and a STEADY_TIME"):
            wrong()


def test_time_arithmetic_with_wrong_operands_raises_type_error() -> None:
    for wrong in (
        lambda: Time() + Time(),  # type: ignore[operator]
        lambda: Duration() + 1,  # type: ignore[operator]
        lambda: Duration() - Time(),  # type: ignore[operator]
        lambda: Duration() * "2",  # type: ignore[operator]
        lambda: Time() < 3,  # type: ignore[operator]
        lambda: Time() - 3,  # type: ignore[operator]
    ):
        with pytest.raises(TypeError):
            wrong()


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_datetime_round_trip_keeps_microseconds(ns: int) -> None:
    moment = Time(nanoseconds=ns).to_datetime()
    assert moment.tzinfo is timezone.utc
    assert Time.from_datetime(moment).nanoseconds == ns // 1000 * 1000


def test_datetime_conversion_requires_time_zone_and_non_steady_clock() -> None:
    with pytest.raises(TimeRangeError, match="no time zone"):
        Time.from_datetime(datetime(2024, 1, 1))
    with pytest.raises(ClockTypeError, match="arbitrary zero"):
        Time(clock_type=STEADY).to_datetime()


def test_duration_converts_to_and_from_timedelta() -> None:
    assert Duration(seconds=-1.5).to_timedelta() == timedelta(seconds=-1.5)
    assert Duration.from_timedelta(timedelta(days=-1, microseconds=1)).nanoseconds == -86400 * 10**9 + 1000


def test_time_and_duration_convert_from_any_message_like_object() -> None:
    assert Time.from_msg(Stamp(3, 5)) == Time(nanoseconds=3_000_000_005, clock_type=ROS)
    assert Time.from_msg(Stamp(3, 5), STEADY).clock_type is STEADY
    assert Duration.from_msg(Stamp(-1, 500_000_000)).nanoseconds == -500_000_000


@pytest.mark.parametrize(
    ("nanoseconds", "sec", "nanosec"), [(0, 0, 0), (1_500_000_000, 1, 500_000_000), (-1, -1, 999_999_999)]
)
def test_duration_to_msg_rounds_seconds_down(nanoseconds: int, sec: int, nanosec: int) -> None:
    pytest.importorskip("rosidl_py_gen.msgs.builtin_interfaces.msg")
    message = Duration(nanoseconds=nanoseconds).to_msg()
    assert (message.sec, message.nanosec) == (sec, nanosec)
    assert Duration.from_msg(message).nanoseconds == nanoseconds


def test_time_beyond_2038_cannot_be_converted_to_a_message() -> None:
    pytest.importorskip("rosidl_py_gen.msgs.builtin_interfaces.msg")
    assert Time(seconds=2**31 - 1).to_msg().sec == 2**31 - 1
    with pytest.raises(TimeRangeError, match="int32"):
        Time(seconds=2**31).to_msg()
