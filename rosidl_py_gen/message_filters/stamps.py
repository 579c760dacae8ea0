"""The time that a message is of: ``header.stamp``, of a message or of the dict that stands for one."""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.base.stamps import NS_PER_S, nanoseconds
from rosidl_py_gen.errors import RosidlError


class StampError(RosidlError, ValueError):
    """The caller gives messages without ``header.stamp`` to what goes by it."""


def header_stamp(message: Any) -> int | None:
    """Nanoseconds; None for a message without a stamp."""
    try:
        if isinstance(message, dict):
            stamp = message["header"]["stamp"]
            return int(stamp["sec"]) * NS_PER_S + int(stamp["nanosec"])
        return nanoseconds(message.header.stamp)
    except (AttributeError, KeyError, TypeError):
        return None
