"""Points in time, durations and deadlines, in integer nanoseconds.

Times of different clock types cannot be ordered or subtracted, because their zeros differ.
"""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from enum import IntEnum
from numbers import Integral, Real
from typing import TYPE_CHECKING, overload

from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec, stamp_ns
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from rosidl_py_gen.base.stamps import SecNanosec
    from rosidl_py_gen.msgs.builtin_interfaces.msg import Duration as DurationMessage
    from rosidl_py_gen.msgs.builtin_interfaces.msg import Time as TimeMessage

_INT32_MIN, _INT32_MAX = -(2**31), 2**31 - 1
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


class ClockTypeError(RosidlError, TypeError):
    """Raised if times of different clock types are mixed, or a clock type does not support an operation."""


class TimeRangeError(RosidlError, ValueError):
    """Raised for a time or duration that is out of range."""


class ClockType(IntEnum):
    """Type of time that a clock measures; numbers of rcl."""

    # Source: docs/internals/protocol.md 9.6.

    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3


def finite_number(subject: str, value: object, expected: str) -> float:
    """Return `value` as a finite float.

    Raises:
        TypeError: the value is not a number; the text says that `subject` must be `expected`.
        TimeRangeError: the value is not finite.
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        raise TypeError(f"{subject} must be {expected}, got {value!r:.100}")
    number = float(value)
    if not math.isfinite(number):
        raise TimeRangeError(f"{subject} must be finite, got {number!r}")
    return number


_EXACT_S = 1e6
"""Number of seconds below which a product with 1e9 is exact to the nanosecond; computing it is five times faster than
`seconds_to_ns`."""


def seconds_to_ns(subject: str, seconds: object) -> int:
    """Convert a number of seconds, also of numpy, to nanoseconds.

    Raises:
        TypeError: `seconds` is not a number; the text names `subject`.
        TimeRangeError: `seconds` is not finite.
    """
    if isinstance(seconds, Integral) and not isinstance(seconds, bool):
        return int(seconds) * NS_PER_S
    # Whole seconds are converted separately, because their product may exceed the precision of a float.
    fraction, whole = math.modf(finite_number(subject, seconds, "a number of seconds"))
    return int(whole) * NS_PER_S + round(fraction * NS_PER_S)


def timeout_to_ns(subject: str, seconds: object) -> int | None:
    """Convert a timeout in seconds to nanoseconds; return None for `math.inf`.

    Raises:
        TypeError: the timeout is not a number; the text names `subject`.
        TimeRangeError: the timeout is negative or NaN.
    """
    if type(seconds) in (int, float) and 0 <= seconds < _EXACT_S:  # type: ignore[operator]
        return round(seconds * NS_PER_S)  # type: ignore[operator]
    if isinstance(seconds, float) and seconds == math.inf:
        return None
    timeout_ns = seconds_to_ns(subject, seconds)
    if timeout_ns < 0:
        raise TimeRangeError(f"{subject} must be 0 or more seconds, got {seconds!r}")
    return timeout_ns


def _total_ns(seconds: float, nanoseconds: int) -> int:
    if not isinstance(nanoseconds, int):
        raise TimeRangeError(f"nanoseconds must be an int, got {nanoseconds!r}")
    if type(seconds) is int:
        return seconds * NS_PER_S + nanoseconds
    return seconds_to_ns("seconds", seconds) + nanoseconds


def _message_fields(subject: str, nanoseconds: int) -> tuple[int, int]:
    """Split nanoseconds into the fields of a message: seconds, rounded down, and nanoseconds from 0 to 999 999 999.

    Raises:
        TimeRangeError: the seconds do not fit an int32; the text names `subject`.
    """
    sec, nanosec = sec_nanosec(nanoseconds)
    if not _INT32_MIN <= sec <= _INT32_MAX:
        raise TimeRangeError(f"{subject} of {sec} s does not fit a message, whose sec is an int32")
    return sec, nanosec


@dataclass(frozen=True, slots=True, order=True, init=False)
class Duration:
    """Signed duration in nanoseconds."""

    nanoseconds: int

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        object.__setattr__(self, "nanoseconds", _total_ns(seconds, nanoseconds))

    @property
    def seconds(self) -> float:
        """Duration in seconds, rounded to a float."""
        return self.nanoseconds / NS_PER_S

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self.nanoseconds})"

    def __bool__(self) -> bool:
        return self.nanoseconds != 0

    def __neg__(self) -> Duration:
        return Duration(nanoseconds=-self.nanoseconds)

    def __abs__(self) -> Duration:
        return Duration(nanoseconds=abs(self.nanoseconds))

    def __add__(self, other: Duration) -> Duration:
        if not isinstance(other, Duration):
            return NotImplemented
        return Duration(nanoseconds=self.nanoseconds + other.nanoseconds)

    def __sub__(self, other: Duration) -> Duration:
        if not isinstance(other, Duration):
            return NotImplemented
        return Duration(nanoseconds=self.nanoseconds - other.nanoseconds)

    def __mul__(self, factor: float) -> Duration:
        if isinstance(factor, int):
            return Duration(nanoseconds=self.nanoseconds * factor)
        if isinstance(factor, float):
            return Duration(nanoseconds=round(self.nanoseconds * factor))
        return NotImplemented

    __rmul__ = __mul__

    @overload
    def __truediv__(self, other: Duration) -> float: ...
    @overload
    def __truediv__(self, other: float) -> Duration: ...
    def __truediv__(self, other: Duration | float) -> float | Duration:
        if isinstance(other, Duration):
            return self.nanoseconds / other.nanoseconds
        if isinstance(other, (int, float)):
            return Duration(nanoseconds=round(self.nanoseconds / other))
        return NotImplemented

    def to_timedelta(self) -> timedelta:
        """Convert the duration to a timedelta, rounded to microseconds."""
        return timedelta(microseconds=round(self.nanoseconds / 1000))

    @classmethod
    def from_timedelta(cls, value: timedelta) -> Duration:
        """Convert a timedelta to a duration, exactly."""
        return cls(nanoseconds=(value // timedelta(microseconds=1)) * 1000)

    def to_msg(self) -> DurationMessage:
        """Convert the duration to a builtin_interfaces/Duration.

        Raises:
            TimeRangeError: the seconds do not fit an int32.
        """
        from rosidl_py_gen.msgs.builtin_interfaces.msg import Duration as DurationMessage

        sec, nanosec = _message_fields("duration", self.nanoseconds)
        return DurationMessage(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, message: SecNanosec) -> Duration:
        """Convert a builtin_interfaces/Duration message of any code generator to a duration."""
        return cls(nanoseconds=stamp_ns(message))


@dataclass(frozen=True, slots=True, init=False)
class Time:
    """Point in time on a clock of one clock type; not negative.

    Times of different clock types are not equal; ordering or subtracting them raises `ClockTypeError`.
    """

    nanoseconds: int
    clock_type: ClockType

    def __init__(
        self, *, seconds: float = 0, nanoseconds: int = 0, clock_type: ClockType = ClockType.SYSTEM_TIME
    ) -> None:
        total = _total_ns(seconds, nanoseconds)
        if total < 0:
            raise TimeRangeError(f"a time must not be negative, got {total} ns")
        object.__setattr__(self, "nanoseconds", total)
        object.__setattr__(self, "clock_type", ClockType(clock_type))

    @property
    def seconds(self) -> float:
        """Time in seconds, rounded to a float (precision of the system clock: about 0.2 µs)."""
        return self.nanoseconds / NS_PER_S

    def __repr__(self) -> str:
        return f"Time(nanoseconds={self.nanoseconds}, clock_type={self.clock_type.name})"

    def seconds_nanoseconds(self) -> tuple[int, int]:
        """Return the time as whole seconds and the remaining nanoseconds."""
        return sec_nanosec(self.nanoseconds)

    def __add__(self, other: Duration) -> Time:
        if not isinstance(other, Duration):
            return NotImplemented
        return Time(nanoseconds=self.nanoseconds + other.nanoseconds, clock_type=self.clock_type)

    __radd__ = __add__

    @overload
    def __sub__(self, other: Time) -> Duration: ...
    @overload
    def __sub__(self, other: Duration) -> Time: ...
    def __sub__(self, other: Time | Duration) -> Time | Duration:
        if isinstance(other, Time):
            return Duration(nanoseconds=self.nanoseconds - self._same_clock(other))
        if isinstance(other, Duration):
            return Time(nanoseconds=self.nanoseconds - other.nanoseconds, clock_type=self.clock_type)
        return NotImplemented

    def __lt__(self, other: Time) -> bool:
        return self.nanoseconds < self._same_clock(other) if isinstance(other, Time) else NotImplemented

    def __le__(self, other: Time) -> bool:
        return self.nanoseconds <= self._same_clock(other) if isinstance(other, Time) else NotImplemented

    def __gt__(self, other: Time) -> bool:
        return self.nanoseconds > self._same_clock(other) if isinstance(other, Time) else NotImplemented

    def __ge__(self, other: Time) -> bool:
        return self.nanoseconds >= self._same_clock(other) if isinstance(other, Time) else NotImplemented

    def _same_clock(self, other: Time) -> int:
        if other.clock_type is not self.clock_type:
            raise ClockTypeError(
                f"a {self.clock_type.name} and a {other.clock_type.name} cannot be compared; use times of one clock"
            )
        return other.nanoseconds

    def to_datetime(self) -> datetime:
        """Convert the time to a datetime in UTC, truncated to microseconds.

        Raises:
            ClockTypeError: the time is steady time, whose zero is arbitrary.
        """
        if self.clock_type is ClockType.STEADY_TIME:
            raise ClockTypeError("STEADY_TIME has an arbitrary zero and cannot be a datetime")
        return _EPOCH + timedelta(microseconds=self.nanoseconds // 1000)

    @classmethod
    def from_datetime(cls, value: datetime, clock_type: ClockType = ClockType.SYSTEM_TIME) -> Time:
        """Convert a datetime to a time, exactly.

        Raises:
            TimeRangeError: the datetime has no time zone, or is before 1970.
        """
        if value.tzinfo is None:
            raise TimeRangeError(f"{value!r} has no time zone; use for example datetime.now(timezone.utc)")
        return cls(nanoseconds=((value - _EPOCH) // timedelta(microseconds=1)) * 1000, clock_type=clock_type)

    def to_msg(self) -> TimeMessage:
        """Convert the time to a builtin_interfaces/Time.

        Raises:
            TimeRangeError: the seconds do not fit an int32.
        """
        from rosidl_py_gen.msgs.builtin_interfaces.msg import Time as TimeMessage

        sec, nanosec = _message_fields("time", self.nanoseconds)
        return TimeMessage(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, message: SecNanosec, clock_type: ClockType = ClockType.ROS_TIME) -> Time:
        """Convert a builtin_interfaces/Time message of any code generator; stamps of messages are ROS time.

        Raises:
            TimeRangeError: the stamp is negative.
        """
        return cls(nanoseconds=stamp_ns(message), clock_type=clock_type)


def read_stamp(message: SecNanosec) -> Time | None:
    """Return the stamp (builtin_interfaces/Time) in a peer's message as a time; None if the stamp is negative."""
    return Time.from_msg(message) if stamp_ns(message) >= 0 else None


class ClockChange(IntEnum):
    """Change of the time source of a clock in a time jump; numbers of rcl."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4


@dataclass(frozen=True, slots=True)
class TimeJump:
    """Jump of the time of a clock; `delta` is 0 if the time source changed, because the zeros are unrelated."""

    clock_change: ClockChange
    delta: Duration

    @property
    def source_changed(self) -> bool:
        """True if the jump is an activation or deactivation of ROS time (the override)."""
        return self.clock_change in (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED)


class WaitTimeoutError(RosidlError, TimeoutError):
    """Raised if a wait has not ended after `timeout_s` seconds.

    Attributes:
        reason: end of the error's text, the reason for the timeout; empty if no reason is known.
    """

    def __init__(self, text: str = "", reason: str = "") -> None:
        super().__init__(with_reason(text, reason))
        self.reason = reason


def with_reason(text: str, reason: str) -> str:
    """Return an error text with a reason at its end; the text alone if `reason` is empty."""
    return f"{text}: {reason}" if reason else text


class Deadline:
    """Time at which one or several waits time out, by the time of the running event loop.

    A timeout of None or `math.inf` means that the waits never time out.
    """

    __slots__ = ("_end_s", "_time")

    def __init__(self, timeout_s: float | None) -> None:
        """Start the timeout now.

        Raises:
            TypeError: the timeout is not a number or None.
            TimeRangeError: the timeout is negative or NaN.
            RuntimeError: no event loop runs.
        """
        timeout_ns = None if timeout_s is None else timeout_to_ns("timeout_s", timeout_s)
        self._time = asyncio.get_running_loop().time
        self._end_s = None if timeout_ns is None else self._time() + timeout_ns / NS_PER_S

    def remaining_s(self, max_s: float | None = None) -> float | None:
        """Return the remaining seconds, at most `max_s`; None if there is neither a timeout nor a maximum."""
        if self._end_s is None:
            return max_s
        left_s = max(0.0, self._end_s - self._time())
        return left_s if max_s is None else min(left_s, max_s)

    def is_expired(self) -> bool:
        """Return True if the timeout is over."""
        return self._end_s is not None and self._time() >= self._end_s
