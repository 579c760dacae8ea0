"""Schedules of timers, rates and sleeps, and waiting until a schedule is due, by a clock that can jump.

Due times are the first due time plus multiples of the period, as in rcl. Missed periods are skipped and counted. With
simulated time, a timer checks the clock at each jump. With system time, it checks at least once a second, because the
time may be set.
Source: docs/internals/protocol.md 9.6.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import complete_threadsafe, current_loop
from rosidl_py_gen.runtime.time.values import ClockType, TimeRangeError, finite_number, seconds_to_ns, timeout_to_ns

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.time.values import TimeJump
_MAX_SLEEP_S = 1.0
"""Maximum time between two checks of the system time, in seconds; setting the time delays a timer by at most this."""


class TimerCall(NamedTuple):
    """Times of one call of a timer.

    Attributes:
        since_last_ns: time since the previous call, or since the creation of the timer.
        missed: number of due times without a call.
    """

    since_last_ns: int
    missed: int


class TimerSchedule:
    """Due times of a timer or sleep; `now_ns` of the methods is the current time of its clock.

    Args:
        period_ns: length of a period.
        waits_at_zero: no call is due while the clock reads 0: on ROS time, no `/clock` message has arrived.
    """

    __slots__ = ("_elapsed_before_jump_ns", "canceled", "last_ns", "next_ns", "period_ns", "waits_at_zero")

    def __init__(self, period_ns: int, now_ns: int, *, waits_at_zero: bool = False) -> None:
        self.period_ns = period_ns
        """Length of a period in ns; a change applies after the next call."""
        self.last_ns = now_ns
        self.next_ns = now_ns + period_ns
        self.canceled = False
        """True while no call is due until `reset`."""
        self.waits_at_zero = waits_at_zero
        self._elapsed_before_jump_ns = 0

    def time_until_ns(self, now_ns: int) -> int | None:
        """Return the time in ns to the next call, 0 or less if a call is due.

        Returns:
            None while canceled, and with `waits_at_zero` while the clock reads 0.
        """
        if self.canceled or (self.waits_at_zero and now_ns == 0):
            return None
        return self.next_ns - now_ns

    def is_ready(self, now_ns: int) -> bool:
        """Return True if a call of the timer is due."""
        remaining = self.time_until_ns(now_ns)
        return remaining is not None and remaining <= 0

    def mark_called(self, now_ns: int) -> TimerCall:
        """Record a call of the timer, and advance to the first due time after `now_ns`."""
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

    def reset(self, now_ns: int) -> None:
        """Start a new period now, and end a cancellation; the time of the last call is retained, as in rcl."""
        self.canceled = False
        self.next_ns = now_ns + self.period_ns

    def before_source_change(self, now_ns: int) -> None:
        """Store the elapsed part of the period, before ROS time is activated or deactivated."""
        if now_ns == 0:
            self._elapsed_before_jump_ns = 0
            return
        elapsed = self.period_ns - (self.next_ns - now_ns)
        self._elapsed_before_jump_ns = min(max(elapsed, 0), self.period_ns)

    def after_source_change(self, now_ns: int) -> None:
        """Continue the period on the new source of time with the stored elapsed part.

        The zeros of the two sources are unrelated.
        """
        if now_ns == 0:
            return
        elapsed, self._elapsed_before_jump_ns = self._elapsed_before_jump_ns, 0
        self.last_ns = now_ns - elapsed
        self.next_ns = self.last_ns + self.period_ns

    def after_jump(self, now_ns: int) -> None:
        """Start a new period if the clock has jumped back to a time before the last call."""
        if now_ns < self.last_ns and now_ns < self.next_ns:
            self.last_ns = now_ns
            self.next_ns = now_ns + self.period_ns


def period_to_ns(period_s: object) -> int:
    """Convert a period in seconds to nanoseconds.

    Raises:
        TypeError: the period is not a number.
        TimeRangeError: the period is negative or not finite.
    """
    period_ns = timeout_to_ns("period_s", period_s)
    if period_ns is None:
        raise TimeRangeError(f"period_s must be finite, got {period_s!r}")
    return period_ns


class ClockTimer:
    """Timer that calls `on_due` on the event loop when the schedule is due by the clock, once for each call of `arm`.

    Args:
        loop: returns the event loop of the timer; None while there is no loop.
        on_due: function that calls `mark_called` of the schedule, and may call `arm` again.
    """

    def __init__(
        self,
        clock: Clock,
        schedule: TimerSchedule,
        loop: Callable[[], asyncio.AbstractEventLoop | None],
        on_due: Callable[[], None],
    ) -> None:
        self._clock = clock
        self._schedule = schedule
        self._loop = loop
        self._on_due = on_due
        self._handle: asyncio.Handle | None = None
        self._closed = False
        self._jumps = clock._on_any_jump(self._before_jump, self._after_jump)

    def arm(self) -> None:
        """Check the clock now, and schedule the next check on the loop; simulated time is checked at its next jump."""
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None
        loop, left_ns = self._loop(), self._schedule.time_until_ns(self._clock.now_ns())
        if self._closed or loop is None or left_ns is None:
            return
        if left_ns <= 0:
            self._handle = loop.call_soon(self._check)
        elif not self._clock.ros_time_is_active:
            left_s = left_ns / NS_PER_S
            if self._clock.clock_type is not ClockType.STEADY_TIME:
                left_s = min(left_s, _MAX_SLEEP_S)
            self._handle = loop.call_later(left_s, self._check)

    def arm_threadsafe(self) -> None:
        """Call `arm` on the loop. Thread: any."""
        loop = self._loop()
        if loop is None:
            return
        if loop is current_loop():
            self.arm()
            return
        with contextlib.suppress(RuntimeError):  # closed in the meantime
            loop.call_soon_threadsafe(self.arm)

    def close(self) -> None:
        """Stop the timer for good. Thread: any."""
        self._closed = True
        self._jumps.close()
        self.arm_threadsafe()

    def _check(self) -> None:
        self._handle = None
        if not self._closed and self._schedule.is_ready(self._clock.now_ns()):
            self._on_due()
        else:  # the loop was early, or the schedule has changed
            self.arm()

    def _before_jump(self, jump: TimeJump) -> None:
        if jump.source_changed:
            self._schedule.before_source_change(self._clock.now_ns())

    def _after_jump(self, jump: TimeJump) -> None:
        if jump.source_changed:
            self._schedule.after_source_change(self._clock.now_ns())
        else:
            self._schedule.after_jump(self._clock.now_ns())
        self.arm_threadsafe()


async def sleep_until_due(clock: Clock, schedule: TimerSchedule, *, ends_with_source: bool) -> bool:
    """Wait until a schedule is due by a clock, and record the call in the schedule.

    Args:
        ends_with_source: end the wait if ROS time is activated or deactivated; otherwise continue with the elapsed part
            of the period.

    Returns:
        False if the wait ended because ROS time was activated or deactivated.
    """
    now_ns = clock.now_ns()
    if schedule.is_ready(now_ns):
        schedule.mark_called(now_ns)
        await asyncio.sleep(0)  # so that a caller that is always late does not starve other tasks
        return True
    wait = _ClockWait(clock, schedule, ends_with_source)
    wait.arm()
    try:
        return await wait.outcome
    finally:
        wait.close()


class _ClockWait(ClockTimer):
    """Wait of one task until a schedule is due.

    The jump callback itself ends the wait, because time may change again before the waiting task runs.
    """

    def __init__(self, clock: Clock, schedule: TimerSchedule, ends_with_source: bool) -> None:
        loop = asyncio.get_running_loop()
        super().__init__(clock, schedule, lambda: loop, self._end_if_due)
        self._ends_with_source = ends_with_source
        self._has_ended = False
        self.outcome: asyncio.Future[bool] = loop.create_future()

    def _end_if_due(self) -> None:
        now_ns = self._clock.now_ns()
        if not self._has_ended and self._schedule.is_ready(now_ns):
            self._schedule.mark_called(now_ns)
            self._end(True)

    def _end(self, outcome: bool) -> None:
        self._has_ended = True
        complete_threadsafe(self.outcome, outcome)  # the first call counts

    def _after_jump(self, jump: TimeJump) -> None:
        if not jump.source_changed:
            self._end_if_due()
        elif self._ends_with_source:
            self._end(False)
        super()._after_jump(jump)


class Rate:
    """Fixed frequency of a loop: ``while True: work(); await rate.sleep()``. Missed periods are skipped.

    A jump back of the clock starts a new period. If ROS time is activated or deactivated during `sleep`, the elapsed
    part of the period counts.
    """

    def __init__(self, clock: Clock, frequency_hz: float) -> None:
        """Raise `TypeError` if `frequency_hz` is not a number, `TimeRangeError` unless it is in (0, 1e9]."""
        self._clock = clock
        self._period_ns = _period_ns(frequency_hz)
        self._schedule: TimerSchedule | None = None
        self._was_active = clock.ros_time_is_active

    async def sleep(self) -> None:
        """Wait for the end of the current period; the first call starts the first period.

        There is no blocking form, because a clock has no event loop that could run while it waits.
        """
        schedule, active = self._schedule, self._clock.ros_time_is_active
        if schedule is None or active != self._was_active:  # first call, or the source has changed since the last one
            self._schedule = schedule = self._clock._schedule(self._period_ns, self._clock.now_ns())
        schedule.after_jump(self._clock.now_ns())  # the clock may have jumped back since the last call
        await sleep_until_due(self._clock, schedule, ends_with_source=False)
        self._was_active = self._clock.ros_time_is_active


def _period_ns(frequency_hz: object) -> int:
    frequency = finite_number("frequency_hz", frequency_hz, "a number")
    # The period of lower frequencies would not be a finite float.
    if not 1e-300 <= frequency <= NS_PER_S:
        raise TimeRangeError(f"frequency_hz must be positive, finite and at most 1e9, got {frequency!r}")
    return seconds_to_ns("the period", 1 / frequency)
