"""Sleeping by any clock: until a time, for a duration, at a rate.

Decides how to wait for a clock that can jump: simulated time is never slept for, each jump is looked at instead; system
time is looked at at least once a second, because somebody may set it.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.time_values import ClockType, ClockTypeError, Duration, Time, TimeRangeError

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.clock import Clock

_ANY = Duration(nanoseconds=1)
_LONGEST_S = 1.0


async def sleep_until(clock: Clock, until: Time) -> None:
    """Return when `clock` reads `until` or later; at once when it does already.

    While simulated time has not begun (the clock reads 0) nothing is due, not even time 0.

    Raises:
        ClockTypeError: `until` is of another clock.
    """
    if until.clock_type is not clock.clock_type:
        raise ClockTypeError(f"cannot sleep until a {until.clock_type.name} on a clock of {clock.clock_type.name}")
    loop = asyncio.get_running_loop()
    jumped = asyncio.Event()

    def wake() -> None:
        loop.call_soon_threadsafe(jumped.set)

    with clock.create_jump_callback(
        post=lambda jump: wake(), on_clock_change=True, min_forward=_ANY, min_backward=-_ANY
    ):
        while True:
            now_ns = clock.now_ns()
            if now_ns >= until.nanoseconds and not (clock.ros_time_is_active and now_ns == 0):
                return
            left_s = (until.nanoseconds - now_ns) / 1e9
            if clock.ros_time_is_active:
                await jumped.wait()
            elif clock.clock_type is ClockType.STEADY_TIME:
                await asyncio.sleep(left_s)
            else:
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(jumped.wait(), min(left_s, _LONGEST_S))
            jumped.clear()


async def sleep_for(clock: Clock, duration: Duration | float) -> None:
    """Sleep for a duration (a number means seconds) by `clock`; one that has not begun is waited for first."""
    length = duration if isinstance(duration, Duration) else Duration(seconds=duration)
    start = clock.now()
    if clock.ros_time_is_active and start.nanoseconds == 0:
        await sleep_until(clock, Time(nanoseconds=1, clock_type=clock.clock_type))
        start = clock.now()
    if length.nanoseconds > 0:
        await sleep_until(clock, start + length)


class Rate:
    """Keeps a loop at a frequency: ``while True: work(); await rate.sleep()``. Late rounds are not made up for."""

    def __init__(self, clock: Clock, frequency_hz: float) -> None:
        if not frequency_hz > 0:
            raise TimeRangeError(f"a rate must be positive, got {frequency_hz!r} Hz")
        self._clock = clock
        self._period = Duration(seconds=1 / frequency_hz)
        self._next: Time | None = None

    async def sleep(self) -> None:
        """Wait for the next point of the grid that began with the first call."""
        now = self._clock.now()
        if self._next is None or now + self._period < self._next:
            self._next = now + self._period  # the first round, or time went back
        await sleep_until(self._clock, self._next)
        late = (self._clock.now_ns() - self._next.nanoseconds) // self._period.nanoseconds
        self._next = self._next + self._period * (max(late, 0) + 1)
