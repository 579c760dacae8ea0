"""Sleeping at a fixed frequency, by any clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime.time.clock_timer import sleep_until_due
from rosidl_py_gen.runtime.time.values import TimeRangeError, finite_number, seconds_to_ns

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.time.timer_schedule import TimerSchedule


class Rate:
    """Fixed frequency of a loop: ``while True: work(); await rate.sleep()``. Missed periods are skipped.

    A jump back of the clock starts a new period. If ROS time is activated or deactivated during `sleep`, the elapsed
    part of the period counts.
    """

    def __init__(self, clock: Clock, frequency_hz: float) -> None:
        """Raise `TypeError` for a frequency that is not a number, `TimeRangeError` unless it is in (0, 1e9]."""
        self._clock = clock
        self._period_ns = _period_ns(frequency_hz)
        self._schedule: TimerSchedule | None = None
        self._was_active = clock.ros_time_is_active

    async def sleep(self) -> None:
        """Wait for the end of the current period; the first call starts the first one.

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
