"""Clocks, jumps of simulated time, and sleeping by a clock."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from types import TracebackType
from typing import Any, Optional, Protocol, Type, TypedDict

from rclpy._rclpy_pybind11 import ClockChange as ClockChangeOfC
from rclpy._rclpy_pybind11 import ClockType as ClockTypeOfC
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.destroyable import DestroyableType
from rclpy.duration import Duration
from rclpy.exceptions import NotInitializedException
from rclpy.handles import Destroyable
from rclpy.time import AnyClockType, Time, TimeHandle
from rclpy.utilities import get_default_context, resolve_context
from rosidl_py_gen import runtime

ClockChange = runtime.ClockChange
JumpHandlePreCallbackType = Callable[[], Any]


@dataclass(kw_only=True, eq=False)
class JumpThreshold:
    """Jumps of a clock's time for which a callback is called.

    Attributes:
        min_forward: smallest jump forward, positive; None: no jumps forward.
        min_backward: smallest jump back, negative; None: no jumps back.
        on_clock_change: call also when simulated time starts and stops.

    Raises:
        ValueError: a sign is wrong, or no jump is selected.
    """

    min_forward: Duration | None
    min_backward: Duration | None
    on_clock_change: bool = True

    def __post_init__(self) -> None:
        if self.min_forward is not None and self.min_forward.nanoseconds <= 0:
            raise ValueError("min_forward must be a positive non-zero duration")
        if self.min_backward is not None and self.min_backward.nanoseconds >= 0:
            raise ValueError("min_backward must be a negative non-zero duration")
        if self.min_forward is None and self.min_backward is None and not self.on_clock_change:
            raise ValueError("At least one jump threshold must be enabled")


@dataclass(frozen=True, eq=False)
class TimeJump:
    """Jump of a clock's time.

    Attributes:
        clock_change: change of the source of time.
        delta: length of the jump; 0 if the source changed.
    """

    clock_change: ClockChange | ClockChangeOfC
    delta: Duration

    def __post_init__(self) -> None:
        if not isinstance(self.clock_change, (ClockChange, ClockChangeOfC)):
            raise TypeError("clock_change must be an instance of rclpy.clock.ClockChange")


class TimeJumpDictionary(TypedDict):
    """Argument of the callback of a `JumpHandle` that a program creates itself; `delta` is in nanoseconds."""

    clock_change: ClockChange | ClockChangeOfC
    delta: int


class JumpHandle:
    """Registration of callbacks for jumps, until `unregister` or the end of a ``with`` block.

    `Clock.create_jump_callback` returns it. An exception of a callback is raised where the time was changed, and later
    callbacks are not called.
    """

    def __init__(
        self,
        *,
        clock: BaseClock,
        threshold: JumpThreshold,
        pre_callback: JumpHandlePreCallbackType | None,
        post_callback: Callable[[TimeJumpDictionary], Any] | None,
    ) -> None:
        if pre_callback is None and post_callback is None:
            raise ValueError("One of pre_callback or post_callback must be callable")
        if pre_callback is not None and not callable(pre_callback):
            raise ValueError("pre_callback must be callable if given")
        if post_callback is not None and not callable(post_callback):
            raise ValueError("post_callback must be callable if given")

        def before(jump: runtime.TimeJump) -> None:
            if pre_callback is not None:
                pre_callback()

        def after(jump: runtime.TimeJump) -> None:
            if post_callback is not None:
                post_callback({"clock_change": ClockChangeOfC(jump.clock_change), "delta": jump.delta.nanoseconds})

        with clock.handle as handle:
            self._rosidl_registration = handle.clock.create_jump_callback(
                pre=before,
                post=after,
                on_clock_change=threshold.on_clock_change,
                min_forward=_to_runtime(threshold.min_forward),
                min_backward=_to_runtime(threshold.min_backward),
            )

    def unregister(self) -> None:
        """Remove the callbacks; may be called twice."""
        self._rosidl_registration.close()

    def __enter__(self) -> JumpHandle:
        return self

    def __exit__(self, t: type[BaseException] | None, v: BaseException | None, tb: TracebackType | None) -> None:
        self.unregister()


def _to_runtime(duration: Duration | None) -> runtime.Duration | None:
    return None if duration is None else runtime.Duration(nanoseconds=duration.nanoseconds)


def _reraise(_activity: str) -> None:
    """Raise the exception of a jump callback in the code that changed the time, as rclpy does."""
    raise


class ClockHandle(Destroyable):
    """Handle with the clock of rosidl_py_gen.runtime that a `Clock` reads."""

    def __init__(self, clock_type: AnyClockType) -> None:
        super().__init__()
        self._clock_type = clock_type
        is_initialized = clock_type != ClockType.UNINITIALIZED
        kind = runtime.ClockType(int(clock_type)) if is_initialized else runtime.ClockType.SYSTEM_TIME
        self.clock = runtime.Clock(kind, on_failure=_reraise)

    def get_now(self) -> TimeHandle:
        """Return the current time; raise RCLError if the clock type is UNINITIALIZED."""
        if self._clock_type == ClockType.UNINITIALIZED:
            raise RCLError("failed to get current clock value: Clock is not initialized")
        return Time(nanoseconds=self.clock.now_ns(), clock_type=self._clock_type)

    def get_ros_time_override_is_enabled(self) -> bool:
        return self.clock.ros_time_is_active

    def set_ros_time_override_is_enabled(self, enabled: bool) -> None:
        if enabled:
            self.clock.enable_ros_time_override()
        else:
            self.clock.disable_ros_time_override()

    def set_ros_time_override(self, time_point: TimeHandle) -> None:
        """Set the simulated time."""
        self.clock.set_ros_time_override(
            runtime.Time(nanoseconds=time_point.nanoseconds, clock_type=runtime.ClockType.ROS_TIME)
        )


class BaseClock:
    """Clock of one clock type; base class of `Clock` and `rclpy.experimental.AsyncClock`."""

    _clock_type: AnyClockType
    _rosidl_clock: ClockHandle

    def __init__(self, *, clock_type: AnyClockType = ClockType.SYSTEM_TIME) -> None:
        self._rosidl_open(clock_type)

    def _rosidl_open(self, clock_type: AnyClockType) -> None:
        if not isinstance(clock_type, (ClockType, ClockTypeOfC)):
            raise TypeError("Clock type must be a ClockType enum")
        self._rosidl_clock = ClockHandle(clock_type)
        self._clock_type = clock_type

    @property
    def clock_type(self) -> AnyClockType:
        return self._clock_type

    @property
    def handle(self) -> ClockHandle:
        return self._rosidl_clock

    def __repr__(self) -> str:
        return f"{type(self).__name__}(clock_type={self.clock_type.name})"

    def now(self) -> Time:
        with self.handle as handle:
            return Time(nanoseconds=handle.get_now().nanoseconds, clock_type=self.clock_type)

    def create_jump_callback(
        self,
        threshold: JumpThreshold,
        *,
        pre_callback: JumpHandlePreCallbackType | None = None,
        post_callback: Callable[[TimeJump], Any] | None = None,
    ) -> JumpHandle:
        """Register functions for jumps that the threshold selects: `pre_callback()` is called before,
        `post_callback(jump)` after a jump.

        Both callbacks run in the thread that changes the time, until the returned handle is unregistered.

        Raises:
            ValueError: neither callback is given.
        """

        def after(jump: TimeJumpDictionary) -> None:
            assert post_callback is not None
            post_callback(TimeJump(jump["clock_change"], Duration(nanoseconds=jump["delta"])))

        post = after if callable(post_callback) else None
        return JumpHandle(clock=self, threshold=threshold, pre_callback=pre_callback, post_callback=post)

    @property
    def ros_time_is_active(self) -> bool:
        """True while the clock reads simulated time; raises AttributeError if the clock type is not ROS_TIME."""
        if self._clock_type != ClockType.ROS_TIME:
            raise AttributeError(f"clock: got the type {self._clock_type.name}; simulated time needs ROS_TIME")
        with self.handle as handle:
            return handle.get_ros_time_override_is_enabled()

    def _rosidl_require_ros_time(self) -> None:
        if self._clock_type != ClockType.ROS_TIME:
            raise RCLError(f"clock: got the type {self._clock_type.name}; simulated time needs ROS_TIME")

    def _set_ros_time_is_active(self, enabled: bool) -> None:
        with self.handle as handle:
            handle.set_ros_time_override_is_enabled(enabled)

    def set_ros_time_override(self, time: Time) -> None:
        """Set the simulated time, which the clock returns only while simulated time is active.

        Raises:
            TypeError: `time` is not a Time.
            RCLError: the clock type is not ROS_TIME.
        """
        if not isinstance(time, Time):
            raise TypeError(f"Time must be specified as rclpy.time.Time. Received type: {type(time)}")
        self._rosidl_require_ros_time()
        with self.handle as handle:
            handle.set_ros_time_override(time)


class Clock(BaseClock):
    """Clock of one clock type that threads can sleep by; for ROS_TIME an object of `ROSClock` is created."""

    def __new__(cls, *, clock_type: AnyClockType = ClockType.SYSTEM_TIME) -> Clock:
        clock = super().__new__(ROSClock if clock_type is ClockType.ROS_TIME else cls)
        clock._rosidl_open(clock_type)
        return clock

    def __repr__(self) -> str:
        return f"Clock(clock_type={self.clock_type.name})"

    def sleep_until(self, until: Time, context: Context | None = None) -> bool:
        """Block the calling thread until the clock reaches the time `until`, and return True.

        With simulated time, an executor must run in another thread.

        Returns:
            False if the context was shut down, or simulated time started or stopped, while sleeping.

        Raises:
            NotInitializedException: the context is not open.
            ValueError: `until` is of another clock type.
        """
        context = resolve_context(context)
        if not context.ok():
            raise NotInitializedException
        if until.clock_type != self._clock_type:
            raise ValueError("until's clock type does not match this clock's type")
        wake_event = threading.Event()
        has_source_changed = False

        def on_jump(jump: TimeJump) -> None:
            nonlocal has_source_changed
            changes = (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED)
            has_source_changed = has_source_changed or jump.clock_change in changes
            if has_source_changed or self.now() >= until:
                wake_event.set()

        context.on_shutdown(wake_event.set)
        threshold = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None)
        with self.create_jump_callback(threshold, post_callback=on_jump):
            while not wake_event.is_set():
                remaining_ns = (until - self.now()).nanoseconds
                if remaining_ns <= 0:
                    break
                is_simulated = self._rosidl_clock.get_ros_time_override_is_enabled()
                # At most 1 s at a time, so that a system clock that is set forward is noticed.
                wake_event.wait(None if is_simulated else min(remaining_ns / 1e9, 1.0))
        return context.ok() and not has_source_changed and self.now() >= until

    def sleep_for(self, rel_time: Duration, context: Context | None = None) -> bool:
        """Block the calling thread for a duration of this clock, and return True.

        With simulated time, an executor must run in another thread.

        Returns:
            False if the context was shut down, or simulated time started or stopped, while sleeping.

        Raises:
            NotInitializedException: the context is not open.
        """
        return self.sleep_until(self.now() + rel_time, context)


def _do_nothing(clock: Clock, *args: object, **kwargs: object) -> None:
    """Do nothing, because `Clock.__new__` has initialized the clock; a subclass may pass other arguments."""


Clock.__init__ = _do_nothing  # type: ignore[method-assign, assignment]


class ROSClock(Clock):
    """Clock that reads simulated time while that is active, else the system time."""

    def __new__(cls) -> ROSClock:
        clock = super().__new__(cls, clock_type=ClockType.ROS_TIME)
        assert isinstance(clock, ROSClock)
        return clock
