"""How long somebody is willing to wait, and what is left of it.

Decides what a time limit may be: a number of seconds, 0 or more, or None or `math.inf` for ever. The only place that
says so, in the same words for all.
"""

from __future__ import annotations

import time

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.time.values import NS_PER_S, limit_to_ns


class WaitTimeoutError(RosidlError, TimeoutError):
    """What the caller waited for did not happen in `timeout_s` seconds."""


class Deadline:
    """The end of one wait, which may consist of several."""

    __slots__ = ("_end_ns",)

    def __init__(self, timeout_s: float | None) -> None:
        """Raises `TypeError` for no number, `TimeRangeError` for a negative one or NaN."""
        limit_ns = None if timeout_s is None else limit_to_ns("timeout_s", timeout_s)
        self._end_ns = None if limit_ns is None else time.monotonic_ns() + limit_ns

    def left_s(self, at_most_s: float | None = None) -> float | None:
        """Seconds, 0 when it is over; without an end `at_most_s`, which may be None."""
        if self._end_ns is None:
            return at_most_s
        left_s = max(0, self._end_ns - time.monotonic_ns()) / NS_PER_S
        return left_s if at_most_s is None else min(left_s, at_most_s)

    def is_over(self) -> bool:
        """Whether the time has passed."""
        return self._end_ns is not None and time.monotonic_ns() >= self._end_ns
