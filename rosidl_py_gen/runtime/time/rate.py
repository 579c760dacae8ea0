"""Keeping a loop at a frequency, by any clock.

Decides that a `Rate` goes on like a timer, by the arithmetic of `schedule.py`. May import this room only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime.time.clock_timer import sleep_until_due
from rosidl_py_gen.runtime.time.values import TimeRangeError, finite_number, seconds_to_ns

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.time.timer_schedule import TimerSchedule


class Rate:
    """Keeps a loop at a frequency: ``while True: work(); await rate.sleep()``. Late rounds are not made up for.

    It follows its clock as a timer does: time that jumps back starts a new period; when ROS time is activated or
    deactivated during `sleep`, the part of the period that has passed counts.
    """

    def __init__(self, clock: Clock, frequency_hz: float) -> None:
        """Raises `TypeError` for no number, `TimeRangeError` unless positive, finite and at most 1e9."""
        self._clock = clock
        self._period_ns = _period_ns(frequency_hz)
        self._schedule: TimerSchedule | None = None
        self._was_active = clock.ros_time_is_active

    async def sleep(self) -> None:
        """Wait for the next point of the grid that began with the first call."""
        schedule, active = self._schedule, self._clock.ros_time_is_active
        if schedule is None or active != self._was_active:  # the first round, or the source changed between two
            self._schedule = schedule = self._clock._schedule(self._period_ns, self._clock.now_ns())
        schedule.after_jump(self._clock.now_ns())  # time may have gone back between two rounds
        await sleep_until_due(self._clock, schedule, ends_with_source=False)
        self._was_active = self._clock.ros_time_is_active


def _period_ns(frequency_hz: object) -> int:
    frequency = finite_number("frequency_hz", frequency_hz, "a number")
    # Below 1e-300 the period would be no float any more.
    if not 1e-300 <= frequency <= NS_PER_S:
        raise TimeRangeError(f"frequency_hz must be positive, finite and at most 1e9, got {frequency!r}")
    return seconds_to_ns("the period", 1 / frequency)
