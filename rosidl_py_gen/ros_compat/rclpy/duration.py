"""Lengths of time."""

from __future__ import annotations

from functools import total_ordering
from typing import Protocol, Union  # noqa: F401

import builtin_interfaces.msg

from rclpy.constants import S_TO_NS


class DurationType(Protocol):
    """What `Duration.get_c_duration` gives."""

    @property
    def nanoseconds(self) -> int: ...


@total_ordering
class _Ordered:
    """What is compared by its nanoseconds; as in rclpy it has no hash."""

    _rosidl_nanoseconds: int

    def _rosidl_comparable(self, other: object) -> int | None:
        """Nanoseconds of what it can be compared with, None of anything else; may raise TypeError."""
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        found = self._rosidl_comparable(other)
        return NotImplemented if found is None else self._rosidl_nanoseconds == found

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __lt__(self, other: object) -> bool:
        found = self._rosidl_comparable(other)
        return NotImplemented if found is None else self._rosidl_nanoseconds < found


class Duration(_Ordered):
    """A signed length of time in nanoseconds, of 64 bits.

    Fractions of a nanosecond are cut off. Raises OverflowError for what does not fit, infinity included, and ValueError
    for NaN and for text.
    """

    def __init__(self, *, seconds: float = 0, nanoseconds: int = 0) -> None:
        if isinstance(seconds, (str, bytes)):  # repeated S_TO_NS times it would take a gigabyte to be no number
            raise ValueError(f"seconds is a number, found {seconds!r}")
        total = int(seconds * S_TO_NS) + int(nanoseconds)
        if not -(2**63) <= total < 2**63:
            raise OverflowError("Total nanoseconds value is too large to store in C duration.")
        self._rosidl_nanoseconds = total

    @property
    def nanoseconds(self) -> int:
        """The whole length."""
        return self._rosidl_nanoseconds

    def __repr__(self) -> str:
        return f"Duration(nanoseconds={self.nanoseconds})"

    def __str__(self) -> str:
        return "Infinite" if self == Infinite else f"{self.nanoseconds} nanoseconds"

    def _rosidl_comparable(self, other: object) -> int | None:
        return other.nanoseconds if isinstance(other, Duration) else None

    def to_msg(self) -> builtin_interfaces.msg.Duration:
        """As builtin_interfaces/Duration; `nanosec` is never negative."""
        sec, nanosec = divmod(self.nanoseconds, S_TO_NS)
        return builtin_interfaces.msg.Duration(sec=sec, nanosec=nanosec)

    @classmethod
    def from_msg(cls, msg: builtin_interfaces.msg.Duration) -> Duration:
        """Of a builtin_interfaces/Duration; TypeError for anything else."""
        if not isinstance(msg, builtin_interfaces.msg.Duration):
            raise TypeError("Must pass a builtin_interfaces.msg.Duration object")
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)

    def get_c_duration(self) -> DurationType:
        """The duration itself: there is no C structure here."""
        return self


Infinite = Duration(nanoseconds=2**63 - 1)
"""For ever, where a quality of service is meant."""
