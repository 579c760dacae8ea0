"""Stamp of a message: ``header.stamp`` of a message or of a dict with its fields."""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.base.stamps import NS_PER_S, nanoseconds
from rosidl_py_gen.errors import RosidlError


class StampError(RosidlError, ValueError):
    """A message without ``header.stamp`` was passed to a filter that needs it."""


def header_stamp(message: Any) -> int | None:
    """Return the stamp in nanoseconds; None if the message has none."""
    try:
        if isinstance(message, dict):
            stamp = message["header"]["stamp"]
            return int(stamp["sec"]) * NS_PER_S + int(stamp["nanosec"])
        return nanoseconds(message.header.stamp)
    except (AttributeError, KeyError, TypeError):
        return None
