"""How long somebody is willing to wait, and what is left of it.

Decides what a time limit may be: a number of seconds, 0 or more, or None or `math.inf` for ever. The only place that
says so, in the same words for all.
"""

from __future__ import annotations

import asyncio

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.time.values import timeout_to_ns


class WaitTimeoutError(RosidlError, TimeoutError):
    """Raised when a wait has not ended after `timeout_s` seconds.

    Attributes:
        reason: why not, in words, which the text ends with; empty where it is not known.
    """

    def __init__(self, text: str = "", reason: str = "") -> None:
        super().__init__(with_reason(text, reason))
        self.reason = reason


def with_reason(text: str, reason: str) -> str:
    """Return the text of an error with the reason, if one is known."""
    return f"{text}: {reason}" if reason else text


class Deadline:
    """The end of one wait on the running event loop, by its time; the wait may consist of several."""

    __slots__ = ("_end_s", "_time")

    def __init__(self, timeout_s: float | None) -> None:
        """Raises `TypeError` for no number, `TimeRangeError` for a negative one or NaN."""
        limit_ns = None if timeout_s is None else timeout_to_ns("timeout_s", timeout_s)
        self._time = asyncio.get_running_loop().time
        self._end_s = None if limit_ns is None else self._time() + limit_ns / NS_PER_S

    def remaining_s(self, at_most_s: float | None = None) -> float | None:
        """Seconds, 0 when it is over; without an end `at_most_s`, which may be None."""
        if self._end_s is None:
            return at_most_s
        left_s = max(0.0, self._end_s - self._time())
        return left_s if at_most_s is None else min(left_s, at_most_s)

    def is_expired(self) -> bool:
        """Whether the time has passed."""
        return self._end_s is not None and self._time() >= self._end_s
