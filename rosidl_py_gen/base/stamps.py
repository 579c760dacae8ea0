"""Conversion between nanoseconds and the stamps of messages, which have seconds and nanoseconds."""

from __future__ import annotations

from operator import index
from typing import Any, Protocol

NS_PER_S = 1_000_000_000


class SecNanosec(Protocol):
    """Protocol of the messages builtin_interfaces/Time and Duration, of any class."""

    sec: int
    nanosec: int


def stamp_ns(stamp: SecNanosec) -> int:
    """Return the nanoseconds of a Time or Duration message; raises `TypeError` for numbers that are not integers."""
    return index(stamp.sec) * NS_PER_S + index(stamp.nanosec)


def nanoseconds(time: Any) -> int:
    """Return the nanoseconds of a `Time` object, a Time message or an integer; raises `TypeError` for another value."""
    if hasattr(time, "nanoseconds"):
        return index(time.nanoseconds)
    try:
        return stamp_ns(time) if hasattr(time, "sec") else index(time)
    except (AttributeError, TypeError):
        raise TypeError(f"expected a Time, a Time message or nanoseconds, got {time!r:.100}") from None


def sec_nanosec(nanoseconds: int) -> tuple[int, int]:
    """Return nanoseconds as seconds, rounded down, and the remaining nanoseconds, which are never negative."""
    return divmod(nanoseconds, NS_PER_S)


def set_stamp(stamp: SecNanosec, nanoseconds: int) -> None:
    """Set the fields of a Time or Duration message to a number of nanoseconds."""
    stamp.sec, stamp.nanosec = sec_nanosec(nanoseconds)
