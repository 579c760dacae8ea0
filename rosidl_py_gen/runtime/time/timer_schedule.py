"""Arithmetic of timers, by the drift-free rule of rcl.

Due times are the first one plus multiples of the period. Missed periods are skipped and counted.
Source: docs/internals/protocol.md 9.6.
"""

from __future__ import annotations

from dataclasses import dataclass

from rosidl_py_gen.runtime.time.values import TimeRangeError, timeout_to_ns


@dataclass(frozen=True, slots=True)
class TimerCall:
    """Call of a timer.

    Attributes:
        since_last_ns: time since the previous call, or since creation.
        missed: number of whole periods without a call.
    """

    since_last_ns: int
    missed: int


class TimerSchedule:
    """Due time of a timer or sleep; the methods take the time of its clock.

    Args:
        waits_at_zero: the clock is of ROS time, on which 0 means that no `/clock` message has arrived.
    """

    __slots__ = ("_elapsed_before_jump_ns", "canceled", "last_ns", "next_ns", "period_ns", "waits_at_zero")

    def __init__(self, period_ns: int, now_ns: int, *, waits_at_zero: bool = False) -> None:
        self.period_ns = _checked(period_ns)
        self.last_ns = now_ns
        self.next_ns = now_ns + period_ns
        self.canceled = False
        self.waits_at_zero = waits_at_zero
        self._elapsed_before_jump_ns = 0

    def time_until_ns(self, now_ns: int) -> int | None:
        """Return the time to the next call, 0 or less if due; None while canceled, or before the clock has started."""
        if self.canceled or (self.waits_at_zero and now_ns == 0):
            return None
        return self.next_ns - now_ns

    def is_ready(self, now_ns: int) -> bool:
        """Return True if a call is due."""
        remaining = self.time_until_ns(now_ns)
        return remaining is not None and remaining <= 0

    def mark_called(self, now_ns: int) -> TimerCall:
        """Record a call, and advance to the first due time later than now."""
        since_last_ns = now_ns - self.last_ns
        self.last_ns = now_ns
        missed = 0
        if self.period_ns == 0:
            self.next_ns = now_ns
        else:
            self.next_ns += self.period_ns
            if self.next_ns <= now_ns:
                missed = (now_ns - self.next_ns) // self.period_ns + 1
                self.next_ns += missed * self.period_ns
        return TimerCall(since_last_ns, missed)

    def cancel(self) -> None:
        """Stop until `reset`."""
        self.canceled = True

    def reset(self, now_ns: int) -> None:
        """Restart the period; retains the time of the last call, as rcl does."""
        self.canceled = False
        self.next_ns = now_ns + self.period_ns

    def change_period(self, period_ns: int) -> None:
        """Use another period after the next call."""
        self.period_ns = _checked(period_ns)

    def before_source_change(self, now_ns: int) -> None:
        """Store the elapsed part of the period, before ROS time is activated or deactivated."""
        if now_ns == 0:
            self._elapsed_before_jump_ns = 0
            return
        elapsed = self.period_ns - (self.next_ns - now_ns)
        self._elapsed_before_jump_ns = min(max(elapsed, 0), self.period_ns)

    def after_source_change(self, now_ns: int) -> None:
        """Continue the period in the new time, because the zeros of both are unrelated."""
        if now_ns == 0:
            return
        elapsed, self._elapsed_before_jump_ns = self._elapsed_before_jump_ns, 0
        self.last_ns = now_ns - elapsed
        self.next_ns = self.last_ns + self.period_ns

    def after_jump(self, now_ns: int) -> None:
        """Start a new period if the clock has jumped to before the last call."""
        if now_ns < self.last_ns and now_ns < self.next_ns:
            self.last_ns = now_ns
            self.next_ns = now_ns + self.period_ns


def period_to_ns(period_s: object) -> int:
    """Convert a period in seconds; raises `TypeError`, and `TimeRangeError` if it is negative or not finite."""
    period_ns = timeout_to_ns("period_s", period_s)
    if period_ns is None:
        raise TimeRangeError(f"period_s must be finite, got {period_s!r}")
    return period_ns


def _checked(period_ns: int) -> int:
    if isinstance(period_ns, bool) or not isinstance(period_ns, int) or period_ns < 0:
        raise TimeRangeError(f"the period of a timer must be an int of nanoseconds >= 0, got {period_ns!r}")
    return period_ns
