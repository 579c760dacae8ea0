"""Conversions between ``builtin_interfaces`` Time and Duration, and Python's `datetime` and `timedelta`.

Python counts microseconds: converting to it drops the last three digits of the nanoseconds, rounding down.
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from typing import Any

from rosidl_py_gen.base.stamps import sec_nanosec, stamp_ns
from rosidl_py_gen.numpy.common import ConversionError, M, message_class

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_MICROSECOND = timedelta(microseconds=1)


def _nanoseconds(message: Any) -> int:
    try:
        return stamp_ns(message)
    except (AttributeError, TypeError, ValueError):
        raise ConversionError(f"expected sec and nanosec, got {message!r:.100}") from None


def time_to_datetime(stamp: Any) -> datetime:
    """Return the moment of a Time message as a datetime with the time zone UTC."""
    return _EPOCH + timedelta(microseconds=_nanoseconds(stamp) // 1000)


def datetime_to_time(moment: datetime, *, cls: type[M] | None = None) -> M:
    """Return a Time message for a datetime.

    Raises:
        ConversionError: `moment` is not a datetime; has no time zone, so that it means another moment on another
            machine; or is not from 1901 to 2038.
    """
    if not isinstance(moment, datetime):
        raise ConversionError(f"expected a datetime, got {moment!r:.100}")
    if moment.tzinfo is None:
        raise ConversionError(f"{moment} has no time zone; local time is moment.astimezone()")
    return _from_nanoseconds((moment - _EPOCH) // _MICROSECOND * 1000, cls, "builtin_interfaces/msg/Time")


def duration_to_timedelta(duration: Any) -> timedelta:
    """Return the length of a Duration message as a timedelta."""
    return timedelta(microseconds=_nanoseconds(duration) // 1000)


def timedelta_to_duration(length: timedelta, *, cls: type[M] | None = None) -> M:
    """Return a Duration message for a timedelta.

    Raises:
        ConversionError: `length` is not a timedelta, or exceeds 68 years.
    """
    if not isinstance(length, timedelta):
        raise ConversionError(f"expected a timedelta, got {length!r:.100}")
    return _from_nanoseconds(length // _MICROSECOND * 1000, cls, "builtin_interfaces/msg/Duration")


def _from_nanoseconds(nanoseconds: int, cls: type[M] | None, name: str) -> M:
    sec, nanosec = sec_nanosec(nanoseconds)
    if not -(2**31) <= sec < 2**31:
        raise ConversionError(f"{sec} seconds do not fit the int32 of {name}")
    return message_class(cls, name)(sec=sec, nanosec=nanosec)
