"""When a timer is due: the arithmetic, fed with values.

Decides the drift-free rule of rcl (docs/internals/protocol.md 9.6): due times stay on the grid of the first one,
periods that were missed are skipped and counted, never made up. Waiting and calling are `entities/timer.py`'s
business.
"""

from __future__ import annotations

from dataclasses import dataclass

from rosidl_py_gen.runtime.time.values import TimeRangeError, timeout_to_ns


@dataclass(frozen=True, slots=True)
class TimerCall:
    """What one call of a timer knows.

    Attributes:
        since_last_ns: time since the previous call, or since creation for the first.
        missed: whole periods that passed without a call and are skipped.
    """

    since_last_ns: int
    missed: int


class TimerSchedule:
    """When one timer or sleep is due; every method takes the reading of the timer's clock."""

    __slots__ = ("_elapsed_before_jump_ns", "canceled", "last_ns", "next_ns", "period_ns", "waits_at_zero")

    def __init__(self, period_ns: int, now_ns: int, *, waits_at_zero: bool = False) -> None:
        """`waits_at_zero`: the clock is a ROS clock, so a reading of 0 means that no `/clock` arrived yet."""
        self.period_ns = _checked(period_ns)
        self.last_ns = now_ns
        self.next_ns = now_ns + period_ns
        self.canceled = False
        self.waits_at_zero = waits_at_zero
        self._elapsed_before_jump_ns = 0

    def time_until_ns(self, now_ns: int) -> int | None:
        """Nanoseconds to the next call, 0 or less when due; None while canceled or the clock has not started."""
        if self.canceled or (self.waits_at_zero and now_ns == 0):
            return None
        return self.next_ns - now_ns

    def is_ready(self, now_ns: int) -> bool:
        """True when a call is due."""
        remaining = self.time_until_ns(now_ns)
        return remaining is not None and remaining <= 0

    def mark_called(self, now_ns: int) -> TimerCall:
        """Note a call now and move on to the next due time on the grid that is later than now."""
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
        """Never be due until `reset`."""
        self.canceled = True

    def reset(self, now_ns: int) -> None:
        """Be due one period from now; ends a cancellation. The time of the last call is kept, as rcl does."""
        self.canceled = False
        self.next_ns = now_ns + self.period_ns

    def change_period(self, period_ns: int) -> None:
        """Use another period from the next call on; the call already due stays where it is."""
        self.period_ns = _checked(period_ns)

    def before_source_change(self, now_ns: int) -> None:
        """ROS time is about to be (de)activated: remember how much of the period has passed."""
        if now_ns == 0:
            self._elapsed_before_jump_ns = 0
            return
        elapsed = self.period_ns - (self.next_ns - now_ns)
        self._elapsed_before_jump_ns = min(max(elapsed, 0), self.period_ns)

    def after_source_change(self, now_ns: int) -> None:
        """ROS time was (de)activated: wait only for the rest of the period, in the new time."""
        if now_ns == 0:
            return
        elapsed, self._elapsed_before_jump_ns = self._elapsed_before_jump_ns, 0
        self.last_ns = now_ns - elapsed
        self.next_ns = self.last_ns + self.period_ns

    def after_jump(self, now_ns: int) -> None:
        """Time jumped on the same source; a jump to before the last call starts a new period.

        After a forward jump nothing changes here: `is_ready` answers True when the due time was passed.
        """
        if now_ns < self.last_ns and now_ns < self.next_ns:
            self.last_ns = now_ns
            self.next_ns = now_ns + self.period_ns


def period_to_ns(period_s: object, what: str = "period_s") -> int:
    """A timer's period in seconds as nanoseconds.

    Raises:
        TypeError: no number. TimeRangeError: negative or not finite. Both begin with `what`.
    """
    period_ns = timeout_to_ns(what, period_s)
    if period_ns is None:
        raise TimeRangeError(f"{what} must be finite, got {period_s!r}")
    return period_ns


def _checked(period_ns: int) -> int:
    if isinstance(period_ns, bool) or not isinstance(period_ns, int) or period_ns < 0:
        raise TimeRangeError(f"a timer's period must be an int of nanoseconds, 0 or more, got {period_ns!r}")
    return period_ns
