"""Clocks of ROS, system and steady time, with jump callbacks and sleeps.

ROS time is system time until the override is enabled. Then it is the time that was set last, or 0 if none was set.
Source: docs/internals/protocol.md 9.6.
"""

from __future__ import annotations

import contextlib
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.base.callbacks import RegistrationSet, require_signature
from rosidl_py_gen.runtime.logs.loggers import report_failure
from rosidl_py_gen.runtime.time.clock_timer import TimerSchedule, sleep_until_due
from rosidl_py_gen.runtime.time.values import (
    ClockChange,
    ClockType,
    ClockTypeError,
    Duration,
    Time,
    TimeJump,
    TimeRangeError,
    seconds_to_ns,
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
