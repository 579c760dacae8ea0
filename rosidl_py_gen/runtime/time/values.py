"""Points in time and durations as integer nanoseconds.

Decides arithmetic, comparison and conversion. Which clock a time comes from is part of it: times of different clocks
can neither be ordered nor subtracted, because their zero differs. Where time comes from is `clock.py`.
"""

from __future__ import annotations

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
    """The caller mixed times of different clocks, or asked a clock for what its type cannot do."""


class TimeRangeError(RosidlError, ValueError):
    """The caller's time or duration does not fit where it should go."""


class ClockType(IntEnum):
    """Where a time comes from; numbers of rcl (docs/internals/protocol.md 9.6)."""

    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3


def finite_number(what: str, value: object, kind: str) -> float:
    """Raises `TypeError` for what is no `kind`, `TimeRangeError` for what is not finite; both begin with `what`."""
    if not isinstance(value, Real) or isinstance(value, bool):
        raise TypeError(f"{what} must be {kind}, got {value!r:.100}")
    number = float(value)
    if not math.isfinite(number):
        raise TimeRangeError(f"{what} must be finite, got {number!r}")
    return number


_PLAIN_S = 1e6
"""Below this a product of floats is exact to the nanosecond; it is what calls with a time limit need, in a fifth of the
time.
"""


def seconds_to_ns(what: str, seconds: object) -> int:
    """A number of seconds, numpy's too, as nanoseconds; rounded when it is no whole number.

    Raises:
        TypeError: no number. TimeRangeError: not finite. Both begin with `what`.
    """
    if isinstance(seconds, Integral) and not isinstance(seconds, bool):
        return int(seconds) * NS_PER_S
    # Whole seconds apart: the product of both might exceed a float.
    fraction, whole = math.modf(finite_number(what, seconds, "a number of seconds"))
    return int(whole) * NS_PER_S + round(fraction * NS_PER_S)


def timeout_to_ns(what: str, seconds: object) -> int | None:
    """How long somebody is willing to wait, as nanoseconds: 0 or more, None for `math.inf`, which means for ever.

    Raises:
        TypeError: no number. TimeRangeError: negative or NaN. Both begin with `what`.
    """
    if type(seconds) in (int, float) and 0 <= seconds < _PLAIN_S:  # type: ignore[operator]
        return round(seconds * NS_PER_S)  # type: ignore[operator]
    if isinstance(seconds, float) and seconds == math.inf:
        return None
    limit_ns = seconds_to_ns(what, seconds)
    if limit_ns < 0:
        raise TimeRangeError(f"{what} must be 0 or more seconds, got {seconds!r}")
    return limit_ns


def _total_ns(seconds: float, nanoseconds: int) -> int:
    if not isinstance(nanoseconds, int):
        raise TimeRangeError(f"nanoseconds must be an int, got {nanoseconds!r}")
    if type(seconds) is int:
        return seconds * NS_PER_S + nanoseconds
    return seconds_to_ns("seconds", seconds) + nanoseconds


def _fitting(what: str, nanoseconds: int) -> tuple[int, int]:
    """Split for a message: seconds rounded down, nanoseconds always from 0 to 999 999 999."""
    sec, nanosec = sec_nanosec(nanoseconds)
    if not _INT32_MIN <= sec <= _INT32_MAX:
        raise TimeRangeError(f"{what} of {sec} s does not fit a message, whose sec is an int32")
    return sec, nanosec


@dataclass(frozen=True, slots=True, order=True, init=False)
class Duration:
    """A signed length of time; exact, in nanoseconds."""

    nanoseconds: int

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        object.__setattr__(self, "nanoseconds", _total_ns(seconds, nanoseconds))

    @property
    def seconds(self) -> float:
        """The whole duration in seconds, rounded to a float."""
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
        """The duration rounded to microseconds."""
        return timedelta(microseconds=round(self.nanoseconds / 1000))

    @classmethod
    def from_timedelta(cls, value: timedelta) -> Duration:
        """Exact."""
        return cls(nanoseconds=(value // timedelta(microseconds=1)) * 1000)

    def to_msg(self) -> DurationMessage:
        """A builtin_interfaces/Duration; raises `TimeRangeError` when sec exceeds an int32."""
        from rosidl_py_gen.msgs.builtin_interfaces.msg import Duration as DurationMessage

        sec, nanosec = _fitting("duration", self.nanoseconds)
        return DurationMessage(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, message: SecNanosec) -> Duration:
        """From builtin_interfaces/Duration of any generator."""
        return cls(nanoseconds=stamp_ns(message))


@dataclass(frozen=True, slots=True, init=False)
class Time:
    """A point in time on one kind of clock; never negative.

    ``==`` between times of different clocks is False; ordering and subtracting them raises `ClockTypeError`.
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
        """Seconds since the clock's zero, rounded to a float (about 0.2 microseconds for the system clock)."""
        return self.nanoseconds / NS_PER_S

    def __repr__(self) -> str:
        return f"Time(nanoseconds={self.nanoseconds}, clock_type={self.clock_type.name})"

    def seconds_nanoseconds(self) -> tuple[int, int]:
        """Whole seconds and the nanoseconds that remain."""
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
                f"a {self.clock_type.name} and a {other.clock_type.name} have nothing to compare; "
                "take both from one clock"
            )
        return other.nanoseconds

    def to_datetime(self) -> datetime:
        """In UTC, cut to microseconds; raises `ClockTypeError` for steady time, whose zero is arbitrary."""
        if self.clock_type is ClockType.STEADY_TIME:
            raise ClockTypeError("STEADY_TIME has an arbitrary zero and is no date")
        return _EPOCH + timedelta(microseconds=self.nanoseconds // 1000)

    @classmethod
    def from_datetime(cls, value: datetime, clock_type: ClockType = ClockType.SYSTEM_TIME) -> Time:
        """Exact; raises `TimeRangeError` for a datetime without time zone."""
        if value.tzinfo is None:
            raise TimeRangeError(f"{value!r} has no time zone; use for example datetime.now(timezone.utc)")
        return cls(nanoseconds=((value - _EPOCH) // timedelta(microseconds=1)) * 1000, clock_type=clock_type)

    def to_msg(self) -> TimeMessage:
        """A builtin_interfaces/Time; raises `TimeRangeError` when sec exceeds an int32."""
        from rosidl_py_gen.msgs.builtin_interfaces.msg import Time as TimeMessage

        sec, nanosec = _fitting("time", self.nanoseconds)
        return TimeMessage(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, message: SecNanosec, clock_type: ClockType = ClockType.ROS_TIME) -> Time:
        """From builtin_interfaces/Time of any generator; a message does not say its clock, stamps are ROS time."""
        return cls(nanoseconds=stamp_ns(message), clock_type=clock_type)


def read_stamp(message: SecNanosec) -> Time | None:
    """Return the stamp of a peer's message; None if it is negative, which no `Time` is."""
    return Time.from_msg(message) if stamp_ns(message) >= 0 else None


class ClockChange(IntEnum):
    """What happened to the source of a clock; numbers of rcl."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4


@dataclass(frozen=True, slots=True)
class TimeJump:
    """One jump; `delta` is 0 when the source changed, because the two zeros have nothing in common."""

    clock_change: ClockChange
    delta: Duration

    @property
    def source_changed(self) -> bool:
        """True when ROS time was activated or deactivated."""
        return self.clock_change in (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED)
