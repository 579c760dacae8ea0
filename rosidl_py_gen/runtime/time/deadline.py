"""Deadlines of waits. A timeout is a number of seconds >= 0; None and `math.inf` mean no timeout."""

from __future__ import annotations

import asyncio

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.time.values import timeout_to_ns


class WaitTimeoutError(RosidlError, TimeoutError):
    """Raised if a wait has not ended after `timeout_s` seconds.

    Attributes:
        reason: the end of the text; empty if no reason is known.
    """

    def __init__(self, text: str = "", reason: str = "") -> None:
        super().__init__(with_reason(text, reason))
        self.reason = reason


def with_reason(text: str, reason: str) -> str:
    """Return an error text with the reason, if one is known."""
    return f"{text}: {reason}" if reason else text


class Deadline:
    """End of one or several waits, by the time of the running event loop."""

    __slots__ = ("_end_s", "_time")

    def __init__(self, timeout_s: float | None) -> None:
        """Start the timeout; raises `TypeError`, `TimeRangeError` as `timeout_to_ns`."""
        timeout_ns = None if timeout_s is None else timeout_to_ns("timeout_s", timeout_s)
        self._time = asyncio.get_running_loop().time
        self._end_s = None if timeout_ns is None else self._time() + timeout_ns / NS_PER_S

    def remaining_s(self, max_s: float | None = None) -> float | None:
        """Return the remaining seconds, at most `max_s`; None without timeout and maximum."""
        if self._end_s is None:
            return max_s
        left_s = max(0.0, self._end_s - self._time())
        return left_s if max_s is None else min(left_s, max_s)

    def is_expired(self) -> bool:
        """Return True if the timeout is over."""
        return self._end_s is not None and self._time() >= self._end_s
