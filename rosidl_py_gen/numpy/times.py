"""``builtin_interfaces`` Time and Duration, and Python's `datetime`.

Python counts microseconds: converting to it drops the last three digits of the nanoseconds, downwards.
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from typing import Any, overload

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
    """The moment of a Time message, with the time zone UTC."""
    return _EPOCH + timedelta(microseconds=_nanoseconds(stamp) // 1000)


@overload
def datetime_to_time(moment: datetime, *, cls: type[M]) -> M: ...
@overload
def datetime_to_time(moment: datetime, *, cls: None = None) -> Any: ...
def datetime_to_time(moment: datetime, *, cls: type[M] | None = None) -> Any:
    """A Time message of a moment.

    Raises:
        ConversionError: `moment` is none, or has no time zone, so that it means another moment on another machine; or
            it is outside of 1901 to 2038.
    """
    if not isinstance(moment, datetime):
        raise ConversionError(f"expected a datetime, got {moment!r:.100}")
    if moment.tzinfo is None:
        raise ConversionError(f"{moment} has no time zone; local time is moment.astimezone()")
    return _split((moment - _EPOCH) // _MICROSECOND * 1000, cls, "builtin_interfaces/msg/Time")


def duration_to_timedelta(duration: Any) -> timedelta:
    """The length of a Duration message."""
    return timedelta(microseconds=_nanoseconds(duration) // 1000)


@overload
def timedelta_to_duration(length: timedelta, *, cls: type[M]) -> M: ...
@overload
def timedelta_to_duration(length: timedelta, *, cls: None = None) -> Any: ...
def timedelta_to_duration(length: timedelta, *, cls: type[M] | None = None) -> Any:
    """A Duration message of a length of time; raises `ConversionError` for what is none, or beyond 68 years."""
    if not isinstance(length, timedelta):
        raise ConversionError(f"expected a timedelta, got {length!r:.100}")
    return _split(length // _MICROSECOND * 1000, cls, "builtin_interfaces/msg/Duration")


def _split(nanoseconds: int, cls: type[M] | None, name: str) -> M:
    sec, nanosec = sec_nanosec(nanoseconds)
    if not -(2**31) <= sec < 2**31:
        raise ConversionError(f"{sec} seconds do not fit the int32 of {name}")
    maker: Any = message_class(cls, name)
    return maker(sec=sec, nanosec=nanosec)  # type: ignore[no-any-return]
