"""Sleeping by any clock: until a time, for a duration, at a rate.

Decides how to wait for a clock that can jump: simulated time is never slept for, each jump is looked at instead; system
time is looked at at least once a second, because somebody may set it. A sleep ends when ROS time is activated or
deactivated, as in rclpy: a point in one time means nothing in the other, and waiting for it could take for ever. A
`Rate` goes on like a timer; the arithmetic of both is `schedule.py`.

Source: protocol.md 9.6.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from numbers import Real
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.time.schedule import TimerRule
from rosidl_py_gen.runtime.time.values import (
    NS_PER_S,
    ClockType,
    ClockTypeError,
    Duration,
    Time,
    TimeRangeError,
    seconds_to_ns,
)

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.time.clock import Clock, TimeJump

_ANY = Duration(nanoseconds=1)
_LONGEST_S = 1.0


async def sleep_until(clock: Clock, until: Time) -> bool:
    """True when `clock` reads `until` or later; False when the source of its time changed before.

    While simulated time has not begun (the clock reads 0) nothing is due, not even time 0. A jump back makes the sleep
    longer.

    Raises:
        ClockTypeError: `until` is of another clock. TypeError: it is no `Time`.
    """
    if not isinstance(until, Time):
        raise TypeError(f"until must be a Time such as clock.now() + Duration(seconds=1), got {until!r:.100}")
    if until.clock_type is not clock.clock_type:
        raise ClockTypeError(f"cannot sleep until a {until.clock_type.name} on a clock of {clock.clock_type.name}")
    # A period that began at 0: no jump goes back to before that.
    return await _Wait(clock, _rule(clock, until.nanoseconds, 0), ends_with_source=True).wait()


async def sleep_for(clock: Clock, duration: Duration | float) -> bool:
    """Sleep for a duration (a number means seconds) by `clock`; one that has not begun is waited for first.

    Time that jumps back to before the start begins the sleep anew. False as in `sleep_until`.

    Raises:
        TypeError: no duration and no number. TimeRangeError: not finite.
    """
    length_ns = duration.nanoseconds if isinstance(duration, Duration) else seconds_to_ns("duration", duration)
    if clock.ros_time_is_active and clock.now_ns() == 0:
        begun = await sleep_until(clock, Time(nanoseconds=1, clock_type=clock.clock_type))
        if not begun:
            return False
    rule = _rule(clock, max(length_ns, 0), clock.now_ns())
    return await _Wait(clock, rule, ends_with_source=True).wait()


class Rate:
    """Keeps a loop at a frequency: ``while True: work(); await rate.sleep()``. Late rounds are not made up for.

    It follows its clock as a timer does: time that jumps back starts a new period; when ROS time is activated or
    deactivated during `sleep`, the part of the period that has passed counts.
    """

    def __init__(self, clock: Clock, frequency_hz: float) -> None:
        """Raises `TypeError` for no number, `TimeRangeError` unless positive, finite and at most 1e9."""
        self._clock = clock
        self._period_ns = _period_ns(frequency_hz)
        self._rule: TimerRule | None = None
        self._was_active = clock.ros_time_is_active

    async def sleep(self) -> None:
        """Wait for the next point of the grid that began with the first call."""
        rule, active = self._rule, self._clock.ros_time_is_active
        if rule is None or active != self._was_active:  # the first round, or the source changed between two
            rule = _rule(self._clock, self._period_ns, self._clock.now_ns())
            self._rule = rule
        rule.after_jump(self._clock.now_ns())  # time may have gone back between two rounds
        await _Wait(self._clock, rule, ends_with_source=False).wait()
        self._was_active = self._clock.ros_time_is_active


class _Wait:
    """One wait until a rule is due by a clock that jumps.

    That it was due is noted in the jump itself: the task may wake when time is somewhere else already.
    """

    def __init__(self, clock: Clock, rule: TimerRule, *, ends_with_source: bool) -> None:
        self._clock = clock
        self._rule = rule
        self._ends_with_source = ends_with_source
        self._loop = asyncio.get_running_loop()
        self._jumped = asyncio.Event()
        self._outcome: bool | None = None

    async def wait(self) -> bool:
        """True when the rule was due, which is noted as its call; False when the source of time changed before."""
        if self._left_ns() == 0:
            await asyncio.sleep(0)  # a loop that is always late must not starve the others
            return True
        with self._clock.create_jump_callback(
            pre=self._before_jump, post=self._after_jump, on_clock_change=True, min_forward=_ANY, min_backward=-_ANY
        ):
            while True:
                left_ns = self._left_ns()
                if self._outcome is not None:
                    return self._outcome
                await self._pause(left_ns)

    def _left_ns(self) -> int | None:
        """0 when over; None when only a jump can tell."""
        now_ns = self._clock.now_ns()
        if self._outcome is None and self._rule.is_ready(now_ns):
            self._rule.call(now_ns)
            self._outcome = True
        return 0 if self._outcome is not None else self._rule.time_until_ns(now_ns)

    async def _pause(self, left_ns: int | None) -> None:
        if left_ns is None or self._clock.ros_time_is_active:
            await self._jumped.wait()
        elif self._clock.clock_type is ClockType.STEADY_TIME:
            await asyncio.sleep(left_ns / NS_PER_S)
        else:
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._jumped.wait(), min(left_ns / NS_PER_S, _LONGEST_S))
        self._jumped.clear()

    def _before_jump(self, jump: TimeJump) -> None:
        if jump.source_changed:
            self._rule.before_source_change(self._clock.now_ns())

    def _after_jump(self, jump: TimeJump) -> None:
        if not jump.source_changed:
            self._left_ns()
            self._rule.after_jump(self._clock.now_ns())
        elif not self._ends_with_source:
            self._rule.after_source_change(self._clock.now_ns())
        elif self._outcome is None:
            self._outcome = False
        with contextlib.suppress(RuntimeError):  # the loop was closed with the sleep unfinished
            self._loop.call_soon_threadsafe(self._jumped.set)


def _rule(clock: Clock, length_ns: int, start_ns: int) -> TimerRule:
    return TimerRule(length_ns, start_ns, waits_at_zero=clock.clock_type is ClockType.ROS_TIME)


def _period_ns(frequency_hz: object) -> int:
    if not isinstance(frequency_hz, Real) or isinstance(frequency_hz, bool):
        raise TypeError(f"frequency_hz must be a number, got {frequency_hz!r:.100}")
    frequency = float(frequency_hz)
    # Below 1e-300 the period would be no float any more.
    if not (math.isfinite(frequency) and 1e-300 <= frequency <= NS_PER_S):
        raise TimeRangeError(f"frequency_hz must be positive, finite and at most 1e9, got {frequency!r}")
    return seconds_to_ns("the period", 1 / frequency)
