"""Nanoseconds, and what messages have instead: seconds and the nanoseconds of the last one.

Decides nothing about clocks, which are `runtime/time`; everything that counts nanoseconds takes their number from here.
"""

from __future__ import annotations

from operator import index
from typing import Any, Protocol

NS_PER_S = 1_000_000_000


class SecNanosec(Protocol):
    """What builtin_interfaces/Time and Duration look like, whoever generated them."""

    sec: int
    nanosec: int


def stamp_ns(stamp: SecNanosec) -> int:
    """Nanoseconds of a Time or a Duration, whose numbers may be numpy's; `TypeError` for those that are not whole."""
    return index(stamp.sec) * NS_PER_S + index(stamp.nanosec)


def nanoseconds(time: Any) -> int:
    """Nanoseconds of a `Time`, a Time message or a number of them; `TypeError` for anything else."""
    if hasattr(time, "nanoseconds"):
        return index(time.nanoseconds)
    try:
        return stamp_ns(time) if hasattr(time, "sec") else index(time)
    except (AttributeError, TypeError):
        raise TypeError(f"expected a Time, a Time message or nanoseconds, got {time!r:.100}") from None


def sec_nanosec(nanoseconds: int) -> tuple[int, int]:
    """The reverse: seconds rounded down, and the rest, which is never negative. Whether they fit is for the caller."""
    return divmod(nanoseconds, NS_PER_S)


def set_stamp(stamp: SecNanosec, nanoseconds: int) -> None:
    """Let a Time or a Duration say so many nanoseconds."""
    stamp.sec, stamp.nanosec = sec_nanosec(nanoseconds)
