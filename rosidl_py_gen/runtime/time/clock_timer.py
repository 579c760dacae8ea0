"""Waiting until a schedule is due, by a clock that can jump.

With simulated time, each jump is checked. System time is checked at least once a second, because it may be set.
Thread: loop, except for jumps, `arm_threadsafe` and `close`.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import complete_threadsafe, current_loop
from rosidl_py_gen.runtime.time.values import ClockType

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.time.timer_schedule import TimerSchedule
    from rosidl_py_gen.runtime.time.values import TimeJump

_MAX_SLEEP_S = 1.0
"""Maximum time between two checks of the system time; a timer is at most that late after the time was set."""


class ClockTimer:
    """Timer that calls `on_due` on the loop when the schedule is due, once for each `arm`, until it is closed.

    Args:
        loop: returns the current loop; None while there is none.
        on_due: calls `mark_called` of the schedule, and may arm again.
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
        """Check the clock now, and schedule the next check."""
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
        """Stop the timer. Thread: any."""
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
    """Wait until the schedule is due and mark it called; return False if the source of time changed before.

    Args:
        ends_with_source: end if the source changes; otherwise the elapsed part of the period is retained.
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
    """Wait of one task, which ends in the jump callback itself, because time may change before the task runs."""

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
