"""Clocks of ROS, system and steady time, and the schedules of timers, rates and sleeps by a clock that can jump.

ROS time is system time until the override is enabled. Then it is the time that was set last, or 0 if none was set.

Due times are the first due time plus multiples of the period, as in rcl. Missed periods are skipped and counted. With
simulated time, a timer checks the clock at each jump. With system time, it checks at least once a second, because the
time may be set.
Source: docs/internals/protocol.md 9.6.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.callbacks import RegistrationSet, require_signature
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import complete_threadsafe, current_loop
from rosidl_py_gen.runtime.logs import report_failure
from rosidl_py_gen.runtime.time_values import (
    ClockChange,
    ClockType,
    ClockTypeError,
    Duration,
    Time,
    TimeJump,
    TimeRangeError,
    finite_number,
    seconds_to_ns,
    timeout_to_ns,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.base.callbacks import Registration


@dataclass(frozen=True, slots=True, eq=False)
class _JumpCallbacks:
    """Callbacks to call before and after a time jump, with a function that returns True for jumps that their thresholds
    select.
    """

    matches: Callable[[TimeJump], bool]
    pre: Callable[[TimeJump], None] | None
    post: Callable[[TimeJump], None] | None


class Clock:
    """Clock of ROS time, system time or steady time.

    Args:
        system_ns: function that replaces the system clock in tests; returns nanoseconds.
        steady_ns: function that replaces the steady clock in tests; returns nanoseconds.
        on_failure: called with a description while the exception of a jump callback is handled; None: log it.
    """

    def __init__(
        self,
        clock_type: ClockType = ClockType.ROS_TIME,
        *,
        system_ns: Callable[[], int] | None = None,
        steady_ns: Callable[[], int] | None = None,
        on_failure: Callable[[str], None] | None = None,
    ) -> None:
        self.clock_type: ClockType = ClockType(clock_type)
        """Type of the clock; times of different types cannot be compared."""
        is_steady = self.clock_type is ClockType.STEADY_TIME
        self._source_ns = (steady_ns or time.monotonic_ns) if is_steady else (system_ns or time.time_ns)
        self._override_ns = 0
        self._active = False
        self._on_failure = on_failure or report_failure
        self._jump_callbacks: RegistrationSet[_JumpCallbacks] = RegistrationSet()

    def __repr__(self) -> str:
        state = ", overridden" if self._active else ""
        return f"Clock({self.clock_type.name}{state})"

    def now(self) -> Time:
        """Return the current time."""
        return Time(nanoseconds=self.now_ns(), clock_type=self.clock_type)

    def now_ns(self) -> int:
        """Return the current time in nanoseconds; 0 while the ROS time override is enabled and no time was set."""
        return self._override_ns if self._active else self._source_ns()

    @property
    def ros_time_is_active(self) -> bool:
        """True while the ROS time override is enabled."""
        return self._active

    def enable_ros_time_override(self) -> None:
        """Use the time of `set_ros_time_override`, 0 before its first call, instead of system time.

        Raises:
            ClockTypeError: the clock is not of ROS time.
        """
        self._change_source(True)

    def disable_ros_time_override(self) -> None:
        """Use system time again; the time of the override is retained for the next `enable_ros_time_override`.

        Raises:
            ClockTypeError: the clock is not of ROS time.
        """
        self._change_source(False)

    def set_ros_time_override(self, now: Time) -> None:
        """Set the time that the clock reads while the ROS time override is enabled.

        Raises:
            ClockTypeError: the clock or `now` is not of ROS time.
            TypeError: `now` is not a `Time`.
        """
        self._require_ros_time()
        if not isinstance(now, Time):
            raise TypeError(f"the override of a ROS clock must be a Time, got {now!r:.100}")
        if now.clock_type is not ClockType.ROS_TIME:
            raise ClockTypeError(f"the override of a ROS clock must be a ROS_TIME, got {now!r}")
        if not self._active:
            self._override_ns = now.nanoseconds
            return
        delta = Duration(nanoseconds=now.nanoseconds - self._override_ns)
        jump = TimeJump(ClockChange.ROS_TIME_NO_CHANGE, delta)
        with self._calling_back(jump):
            self._override_ns = now.nanoseconds

    def create_jump_callback(
        self,
        *,
        pre: Callable[[TimeJump], None] | None = None,
        post: Callable[[TimeJump], None] | None = None,
        on_clock_change: bool = False,
        min_forward: Duration | None = None,
        min_backward: Duration | None = None,
    ) -> Registration:
        """Call `pre` before and `post` after each time jump that a threshold selects, until the registration is closed.

        The callbacks run on the thread that changes the time; their exceptions are logged.

        Args:
            on_clock_change: select each activation and deactivation of ROS time.
            min_forward: select jumps forward by at least this positive duration.
            min_backward: select jumps back by at least this negative duration.

        Raises:
            TimeRangeError: `min_forward` is not positive, or `min_backward` is not negative.
            TypeError: an argument has the wrong type.
            CallbackSignatureError: a callback cannot be called with a `TimeJump`.
        """
        for name, threshold in (("min_forward", min_forward), ("min_backward", min_backward)):
            if threshold is not None and not isinstance(threshold, Duration):
                raise TypeError(f"{name} must be a Duration or None, got {threshold!r:.100}")
        for name, callback in (("pre", pre), ("post", post)):
            if callback is not None:
                if not callable(callback):
                    raise TypeError(f"{name} must be a function or None, got {callback!r:.100}")
                require_signature(callback, f"the {name} callback of a time jump", "the TimeJump")
        if min_forward is not None and min_forward.nanoseconds <= 0:
            raise TimeRangeError(f"min_forward must be a positive duration, got {min_forward!r}")
        if min_backward is not None and min_backward.nanoseconds >= 0:
            raise TimeRangeError(f"min_backward must be a negative duration, got {min_backward!r}")

        def matches(jump: TimeJump) -> bool:
            if jump.source_changed:
                return on_clock_change
            forward = min_forward is not None and jump.delta >= min_forward
            return forward or (min_backward is not None and jump.delta <= min_backward)

        return self._jump_callbacks.add(_JumpCallbacks(matches, pre, post))

    def _on_any_jump(self, pre: Callable[[TimeJump], None], post: Callable[[TimeJump], None]) -> Registration:
        """Register `pre` and `post`, which are called before and after every time jump until the registration is
        closed.
        """
        return self._jump_callbacks.add(
            _JumpCallbacks(lambda jump: jump.source_changed or jump.delta.nanoseconds != 0, pre, post)
        )

    async def sleep_until(self, until: Time) -> bool:
        """Sleep until this clock reads `until` or later.

        While simulated time has not started (the clock reads 0) no sleep ends. A jump back makes the sleep longer.
        There is no blocking form, because a clock has no event loop that could run while it waits.

        Returns:
            False if the sleep ended because ROS time was activated or deactivated, as in rclpy: `until` has no meaning
            on the other time.

        Raises:
            ClockTypeError: `until` is of another clock type.
            TypeError: `until` is not a `Time`.
        """
        if not isinstance(until, Time):
            raise TypeError(f"until must be a Time such as clock.now() + Duration(seconds=1), got {until!r:.100}")
        if until.clock_type is not self.clock_type:
            raise ClockTypeError(f"cannot sleep until a {until.clock_type.name} on a clock of {self.clock_type.name}")
        # A period that started at 0, because no jump goes back further.
        return await self._sleep(until.nanoseconds, 0)

    async def sleep_for(self, duration: Duration | float) -> bool:
        """Sleep by this clock for a duration, or for a number of seconds.

        The sleep starts when simulated time has started. A jump of the clock to a time before the start restarts the
        sleep.

        There is no blocking form, because a clock has no event loop that could run while it waits; `time.sleep` waits
        in real time.

        Returns:
            False if the sleep ended because ROS time was activated or deactivated.

        Raises:
            TypeError: `duration` is not a `Duration` and not a number.
            TimeRangeError: `duration` is not finite.
        """
        length_ns = duration.nanoseconds if isinstance(duration, Duration) else seconds_to_ns("duration", duration)
        if self._active and self.now_ns() == 0 and not await self._sleep(1, 0):
            return False
        return await self._sleep(max(length_ns, 0), self.now_ns())

    async def _sleep(self, length_ns: int, start_ns: int) -> bool:
        schedule = self._schedule(length_ns, start_ns)
        return await sleep_until_due(self, schedule, ends_with_source=True)

    def _schedule(self, period_ns: int, start_ns: int) -> TimerSchedule:
        """Return a timer schedule for this clock, whose first period starts at `start_ns`."""
        return TimerSchedule(period_ns, start_ns, waits_at_zero=self.clock_type is ClockType.ROS_TIME)

    def _require_ros_time(self) -> None:
        if self.clock_type is not ClockType.ROS_TIME:
            raise ClockTypeError(f"only a ROS_TIME clock can be overridden, got {self.clock_type.name}")

    def _change_source(self, active: bool) -> None:
        self._require_ros_time()
        if active == self._active:
            return
        change = ClockChange.ROS_TIME_ACTIVATED if active else ClockChange.ROS_TIME_DEACTIVATED
        with self._calling_back(TimeJump(change, Duration())):
            self._active = active

    @contextlib.contextmanager
    def _calling_back(self, jump: TimeJump) -> Iterator[None]:
        """Call the callbacks whose thresholds select `jump` before and after the block, which changes the time."""
        matching = set()
        for callbacks in self._jump_callbacks:
            if callbacks.matches(jump):
                matching.add(callbacks)
                self._call(callbacks.pre, jump)
        yield
        for callbacks in self._jump_callbacks:
            if callbacks in matching:
                self._call(callbacks.post, jump)

    def _call(self, callback: Callable[[TimeJump], None] | None, jump: TimeJump) -> None:
        if callback is None:
            return
        try:
            callback(jump)
        except Exception:
            self._on_failure("a time jump callback")


# ------------------------------------------------------------------------------------------------------------ schedules

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
