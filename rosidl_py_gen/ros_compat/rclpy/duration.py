"""Durations in nanoseconds: `Duration`, and `Infinite` for QoS profiles."""

from __future__ import annotations

from functools import total_ordering
from math import isfinite
from typing import Protocol, Union

import builtin_interfaces.msg

from rclpy.constants import S_TO_NS


class DurationType(Protocol):
    """Class that stands for the C structure of a duration, returned by `Duration.get_c_duration`."""

    @property
    def nanoseconds(self) -> int: ...


@total_ordering
class _Ordered:
    """Base of values that are compared by their nanoseconds and have no hash, as in rclpy."""

    _rosidl_nanoseconds: int

    def _rosidl_comparable_ns(self, other: object) -> int | None:
        """Return the nanoseconds of a value for a comparison; None for values of other classes. May raise TypeError."""
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        nanoseconds = self._rosidl_comparable_ns(other)
        return NotImplemented if nanoseconds is None else self._rosidl_nanoseconds == nanoseconds

    def __lt__(self, other: object) -> bool:
        nanoseconds = self._rosidl_comparable_ns(other)
        return NotImplemented if nanoseconds is None else self._rosidl_nanoseconds < nanoseconds


class Duration(_Ordered):
    """Signed duration in nanoseconds, of 64 bits; fractions of a nanosecond are cut off.

    Raises:
        OverflowError: the duration does not fit, or is infinite.
        ValueError: `seconds` is NaN or text.
    """

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        if isinstance(seconds, (str, bytes)):  # `seconds * S_TO_NS` would create a text of a gigabyte
            raise ValueError(f"seconds: expected a number, got {seconds!r}")
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if not -(2**63) <= total < 2**63:
            raise OverflowError("Total nanoseconds value is too large to store in C duration.")
        self._rosidl_nanoseconds = total

    @property
    def nanoseconds(self) -> int:
        return self._rosidl_nanoseconds

    def __add__(self, other: Duration) -> Duration:
        if not isinstance(other, Duration):
            return NotImplemented
        return Duration(nanoseconds=self.nanoseconds + other.nanoseconds)

    def __sub__(self, other: Duration) -> Duration:
        if not isinstance(other, Duration):
            return NotImplemented
        return Duration(nanoseconds=self.nanoseconds - other.nanoseconds)

    def __mul__(self, factor: float) -> Duration:
        if not isinstance(factor, (int, float)):
            return NotImplemented
        if factor == float("inf"):
            return Infinite
        if isinstance(factor, float) and not isfinite(factor):
            raise ValueError(f"factor of a duration: got {factor}; expected a finite number or inf")
        return Duration(nanoseconds=int(self.nanoseconds * factor))

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self.nanoseconds})"

    def __str__(self) -> str:
        return "Infinite" if self == Infinite else f"{self.nanoseconds} nanoseconds"

    def _rosidl_comparable_ns(self, other: object) -> int | None:
        return other.nanoseconds if isinstance(other, Duration) else None

    def to_msg(self) -> builtin_interfaces.msg.Duration:
        """Return a builtin_interfaces/Duration, whose `nanosec` is never negative."""
        sec, nanosec = divmod(self.nanoseconds, S_TO_NS)
        return builtin_interfaces.msg.Duration(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: builtin_interfaces.msg.Duration) -> Duration:
        """Convert a builtin_interfaces/Duration; raise TypeError for other values."""
        if not isinstance(msg, builtin_interfaces.msg.Duration):
            raise TypeError("Must pass a builtin_interfaces.msg.Duration object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)

    def get_c_duration(self) -> DurationType:
        """Return the duration itself, which replaces the C structure of rclpy."""
        return self


Infinite = Duration(nanoseconds=2**63 - 1)
"""Unlimited duration in a QoS profile."""
