"""Points in time of a clock: the class `Time`."""

from __future__ import annotations

from datetime import datetime
from typing import Protocol, Tuple, Union, overload

import builtin_interfaces.msg

from rclpy._rclpy_pybind11 import ClockType as ClockTypeOfC
from rclpy.clock_type import ClockType
from rclpy.constants import S_TO_NS
from rclpy.duration import Duration, _Ordered

AnyClockType = ClockType | ClockTypeOfC
_TYPES_OF_C = {type_: ClockTypeOfC(type_) for type_ in ClockType}


class TimeHandle(Protocol):
    """Handle with the nanoseconds and the clock type of a time that a clock returned."""

    @property
    def nanoseconds(self) -> int: ...
    @property
    def clock_type(self) -> ClockTypeOfC: ...


class Time(_Ordered):
    """Time of one type of clock, in nanoseconds since its epoch; fractions of a nanosecond are cut off.

    Times of different clock types raise TypeError when they are compared, also with ``==``, or subtracted.

    Raises:
        ValueError: a number is negative.
        OverflowError: the time is 2**63 ns or more.
    """

    def __init__(
        self, *, seconds: float = 0, nanoseconds: int = 0, clock_type: AnyClockType = ClockType.SYSTEM_TIME
    ) -> None:
        if not isinstance(clock_type, (ClockType, ClockTypeOfC)):
            raise TypeError("Clock type must be a ClockType enum")
        if seconds < 0:
            raise ValueError("Seconds value must not be negative")
        if nanoseconds < 0:
            raise ValueError("Nanoseconds value must not be negative")
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if total >= 2**63:
            raise OverflowError("Total nanoseconds value is too large to store in C time point.")
        self._rosidl_nanoseconds = total
        self._rosidl_clock_type = clock_type if isinstance(clock_type, ClockTypeOfC) else _TYPES_OF_C[clock_type]

    @property
    def nanoseconds(self) -> int:
        return self._rosidl_nanoseconds

    def seconds_nanoseconds(self) -> tuple[int, int]:
        """Return the whole seconds of the time and the remaining nanoseconds."""
        return divmod(self.nanoseconds, S_TO_NS)

    def to_datetime(self) -> datetime:
        """Return the time as a datetime in local time; raise TypeError for a steady clock."""
        if self.clock_type not in (ClockType.ROS_TIME, ClockType.SYSTEM_TIME):
            raise TypeError("Time object's clock type should be either ROS_TIME or SYSTEM_TIME")
        return datetime.fromtimestamp(self.nanoseconds / S_TO_NS)

    @property
    def clock_type(self) -> ClockTypeOfC:
        """Type of the clock that the time belongs to; equals a member of `ClockType`."""
        return self._rosidl_clock_type

    def __repr__(self) -> str:
        return f"Time(nanoseconds={self.nanoseconds}, clock_type={self.clock_type.name})"

    def __add__(self, other: Duration) -> Time:
        if not isinstance(other, Duration):
            return NotImplemented
        try:
            return Time(nanoseconds=self.nanoseconds + other.nanoseconds, clock_type=self.clock_type)
        except OverflowError as error:
            raise OverflowError("Addition leads to overflow in C storage.") from error

    def __radd__(self, other: Duration) -> Time:
        return self.__add__(other)

    @overload
    def __sub__(self, other: Time) -> Duration: ...
    @overload
    def __sub__(self, other: Duration) -> Time: ...
    def __sub__(self, other: Time | Duration) -> Time | Duration:
        if isinstance(other, Time):
            if self._rosidl_clock_type is not other._rosidl_clock_type:
                raise TypeError("Can't subtract times with different clock types")
            return Duration(nanoseconds=self.nanoseconds - other.nanoseconds)
        if not isinstance(other, Duration):
            return NotImplemented
        try:
            return Time(nanoseconds=self.nanoseconds - other.nanoseconds, clock_type=self.clock_type)
        except ValueError as error:
            raise ValueError("Subtraction leads to negative time.") from error

    def _rosidl_comparable_ns(self, other: object) -> int | None:
        if not isinstance(other, Time):
            return None
        if self._rosidl_clock_type is not other._rosidl_clock_type:
            raise TypeError("Can't compare times with different clock types")
        return other.nanoseconds

    def to_msg(self) -> builtin_interfaces.msg.Time:
        """Return a builtin_interfaces/Time, which has no clock type."""
        sec, nanosec = self.seconds_nanoseconds()
        return builtin_interfaces.msg.Time(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: builtin_interfaces.msg.Time, clock_type: AnyClockType = ClockType.ROS_TIME) -> Time:
        """Convert a builtin_interfaces/Time; raise TypeError for other values."""
        if not isinstance(msg, builtin_interfaces.msg.Time):
            raise TypeError("Must pass a builtin_interfaces.msg.Time object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec, clock_type=clock_type)
