"""Clocks, what jumps of simulated time do, and sleeping by a clock."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from types import TracebackType
from typing import Any, Optional, Protocol, Type, TypedDict  # noqa: F401, UP035

from rclpy._rclpy_pybind11 import ClockChange as ClockChangeOfC
from rclpy._rclpy_pybind11 import ClockType as ClockTypeOfC
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.destroyable import DestroyableType as DestroyableType
from rclpy.duration import Duration
from rclpy.exceptions import NotInitializedException
from rclpy.handles import Destroyable
from rclpy.time import AnyClockType, Time, TimeHandle
from rclpy.utilities import get_default_context
from rosidl_py_gen import runtime

JumpHandlePreCallbackType = Callable[[], Any]


class ClockChange(IntEnum):
    """What happened to the source of a clock; numbers of rcl."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4


@dataclass(kw_only=True, eq=False)
class JumpThreshold:
    """Which jumps of time a callback wants to hear of.

    `min_forward` is positive, `min_backward` negative, either may be None; `on_clock_change` is for simulated time that
    begins or ends. ValueError for other signs, and when none is wanted.
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
    """One jump.

    Attributes:
        clock_change: what happened to the source.
        delta: how far time jumped; 0 when the source changed.
    """

    clock_change: ClockChange | ClockChangeOfC
    delta: Duration

    def __post_init__(self) -> None:
        if not isinstance(self.clock_change, (ClockChange, ClockChangeOfC)):
            raise TypeError("clock_change must be an instance of rclpy.clock.ClockChange")


class TimeJumpDictionary(TypedDict):
    """What the callback of a `JumpHandle` made by hand is given; `delta` in nanoseconds."""

    clock_change: ClockChange | ClockChangeOfC
    delta: int


class JumpHandle:
    """Callbacks at jumps, until `unregister` or the end of a ``with`` block; `Clock.create_jump_callback` makes it.

    An exception of a callback comes out of what changed the time, and no later callback is called.
    """

    def __init__(
        self,
        *,
        clock: Clock,
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
        """Call no more; may be called twice."""
        self._rosidl_registration.close()

    def __enter__(self) -> JumpHandle:
        return self

    def __exit__(self, t: type[BaseException] | None, v: BaseException | None, tb: TracebackType | None) -> None:
        self.unregister()


def _to_runtime(duration: Duration | None) -> runtime.Duration | None:
    return None if duration is None else runtime.Duration(nanoseconds=duration.nanoseconds)


def _pass_on(_doing: str) -> None:
    """While the exception of a jump callback is handled: as in rclpy, it goes to whoever changed the time."""
    raise


class ClockHandle(Destroyable):
    """The clock of rosidl_py_gen that a `Clock` reads; there is no C structure here."""

    def __init__(self, clock_type: AnyClockType) -> None:
        super().__init__()
        self._clock_type = clock_type
        kind = (
            runtime.ClockType.SYSTEM_TIME
            if clock_type == ClockType.UNINITIALIZED
            else runtime.ClockType(int(clock_type))
        )
        self.clock = runtime.Clock(runtime.ClockType(int(kind)), on_failure=_pass_on)

    def get_now(self) -> TimeHandle:
        """What it reads; RCLError when it is of no kind."""
        if self._clock_type == ClockType.UNINITIALIZED:
            raise RCLError("failed to get current clock value: Clock is not initialized")
        return Time(nanoseconds=self.clock.now_ns(), clock_type=self._clock_type)

    def get_ros_time_override_is_enabled(self) -> bool:
        """Whether simulated time counts."""
        return self.clock.ros_time_is_active

    def set_ros_time_override_is_enabled(self, enabled: bool) -> None:
        """Have simulated time count, or not."""
        if enabled:
            self.clock.enable_ros_time_override()
        else:
            self.clock.disable_ros_time_override()

    def set_ros_time_override(self, time_point: TimeHandle) -> None:
        """Set the simulated time."""
        self.clock.set_ros_time_override(
            runtime.Time(nanoseconds=time_point.nanoseconds, clock_type=runtime.ClockType.ROS_TIME)
        )


class Clock:
    """A clock of one kind; for ROS_TIME this makes a `ROSClock`."""

    _clock_type: AnyClockType
    _rosidl_clock: ClockHandle

    def __new__(cls, *, clock_type: AnyClockType = ClockType.SYSTEM_TIME) -> Clock:
        if not isinstance(clock_type, (ClockType, ClockTypeOfC)):
            raise TypeError("Clock type must be a ClockType enum")
        made = super().__new__(ROSClock if clock_type is ClockType.ROS_TIME else cls)
        made._rosidl_clock = ClockHandle(clock_type)
        made._clock_type = clock_type
        return made

    @property
    def clock_type(self) -> AnyClockType:
        """Its kind."""
        return self._clock_type

    @property
    def handle(self) -> ClockHandle:
        """What it reads."""
        return self._rosidl_clock

    def __repr__(self) -> str:
        return f"Clock(clock_type={self.clock_type.name})"

    def now(self) -> Time:
        """The time it reads now."""
        with self.handle as handle:
            return Time(nanoseconds=handle.get_now().nanoseconds, clock_type=self.clock_type)

    def create_jump_callback(
        self,
        threshold: JumpThreshold,
        *,
        pre_callback: JumpHandlePreCallbackType | None = None,
        post_callback: Callable[[TimeJump], Any] | None = None,
    ) -> JumpHandle:
        """Call `pre_callback()` before and `post_callback(jump)` after each jump that the threshold selects.

        Both run in the thread that changes the time. ValueError when there is none.
        """

        def after(jump: TimeJumpDictionary) -> None:
            assert post_callback is not None
            post_callback(TimeJump(jump["clock_change"], Duration(nanoseconds=jump["delta"])))

        given = after if callable(post_callback) else None
        return JumpHandle(clock=self, threshold=threshold, pre_callback=pre_callback, post_callback=given)

    def sleep_until(self, until: Time, context: Context | None = None) -> bool:
        """Block this thread until the clock reads `until`.

        A ROSClock with simulated time needs an executor in another thread.

        Returns:
            False when the context was shut down meanwhile, or simulated time began or ended.

        Raises:
            NotInitializedException: the context is not open. ValueError: `until` is of another kind of clock.
        """
        context = get_default_context() if context is None else context
        if not context.ok():
            raise NotInitializedException
        if until.clock_type != self._clock_type:
            raise ValueError("until's clock type does not match this clock's type")
        woken = threading.Event()
        source_changed = False

        def on_jump(jump: TimeJump) -> None:
            nonlocal source_changed
            changes = (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED)
            source_changed = source_changed or jump.clock_change in changes
            if source_changed or self.now() >= until:
                woken.set()

        context.on_shutdown(woken.set)
        threshold = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None)
        with self.create_jump_callback(threshold, post_callback=on_jump):
            while not woken.is_set():
                left_ns = (until - self.now()).nanoseconds
                if left_ns <= 0:
                    break
                simulated = self._rosidl_clock.get_ros_time_override_is_enabled()
                # Waited for in parts: a system clock that is set forward is noticed a second later.
                woken.wait(None if simulated else min(left_ns / 1e9, 1.0))
        return context.ok() and not source_changed and self.now() >= until

    def sleep_for(self, rel_time: Duration, context: Context | None = None) -> bool:
        """`sleep_until` from now on."""
        return self.sleep_until(self.now() + rel_time, context)


class ROSClock(Clock):
    """A clock that reads simulated time while that is active, else the system's."""

    def __new__(cls) -> ROSClock:
        made = super().__new__(cls, clock_type=ClockType.ROS_TIME)
        assert isinstance(made, ROSClock)
        return made

    @property
    def ros_time_is_active(self) -> bool:
        """Whether simulated time counts."""
        with self.handle as handle:
            return handle.get_ros_time_override_is_enabled()

    def _set_ros_time_is_active(self, enabled: bool) -> None:
        """For time sources."""
        with self.handle as handle:
            handle.set_ros_time_override_is_enabled(enabled)

    def set_ros_time_override(self, time: Time) -> None:
        """Set the simulated time; it counts while that is active. TypeError for what is no Time."""
        if not isinstance(time, Time):
            raise TypeError(f"Time must be specified as rclpy.time.Time. Received type: {type(time)}")
        with self.handle as handle:
            handle.set_ros_time_override(time)
