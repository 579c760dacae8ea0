"""Timers, which call a function periodically, and rates, which pace a loop."""

from __future__ import annotations

import inspect
import threading
import weakref
from functools import partial
from typing import TYPE_CHECKING, Any, Awaitable, Callable, Optional

from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import BaseClock, Clock, JumpThreshold
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle, NotInitializedException, ROSInterruptException
from rclpy.handles import ContextHandle, Destroyable
from rclpy.time import Time
from rclpy.utilities import get_default_context, resolve_context

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self

    from rclpy.clock import TimeJump
    from rclpy.executors import Executor


class TimerInfo:
    """Times of one call of a timer: `expected_call_time` and `actual_call_time`.

    A timer passes the object to the parameter of its callback that is annotated with this class. Times are nanoseconds
    of the timer's clock.

    Raises:
        TypeError: `clock_type` is not a ClockType.
        ValueError: a time is negative.
    """

    def __init__(
        self,
        *,
        expected_call_time: int = 0,
        actual_call_time: int = 0,
        clock_type: ClockType = ClockType.SYSTEM_TIME,
    ) -> None:
        if not isinstance(clock_type, ClockType):
            raise TypeError("Clock type must be a ClockType enum")
        if expected_call_time < 0 or actual_call_time < 0:
            raise ValueError("call time values must not be negative")
        self._rosidl_expected_call_time = Time(nanoseconds=expected_call_time, clock_type=clock_type)
        self._rosidl_actual_call_time = Time(nanoseconds=actual_call_time, clock_type=clock_type)

    @property
    def expected_call_time(self) -> Time:
        """Time when the timer's call was due."""
        return self._rosidl_expected_call_time

    @property
    def actual_call_time(self) -> Time:
        """Time when the timer's call took place."""
        return self._rosidl_actual_call_time


TimerCallbackType = Callable[[], None] | Callable[[TimerInfo], None]
AsyncTimerCallbackType = Callable[[], Awaitable[None]] | Callable[[TimerInfo], Awaitable[None]]
TimerCallbackUnion = TimerCallbackType | AsyncTimerCallbackType


class TimerHandle(Destroyable):
    """Schedule of a timer, as in rcl: calls are whole periods apart, and missed calls are skipped."""

    def __init__(self, context: ContextHandle, clock: BaseClock, period_ns: int, autostart: bool) -> None:
        super().__init__()
        if period_ns < 0:
            raise RCLError("failed to create timer: timer period must be non-negative")
        self._context = context
        self._clock = clock
        clock.now()  # raises RCLError if the clock type is UNINITIALIZED
        self._now_ns = clock.handle.clock.now_ns
        self._is_simulated = clock.handle.get_ros_time_override_is_enabled
        self._lock = threading.Lock()
        self.period_ns = period_ns
        self.canceled = not autostart
        self._last_ns = self._now_ns()
        self._next_ns = self._last_ns + period_ns
        self._remaining_ns = 0
        self._jump_handle = None
        if clock.clock_type == ClockType.ROS_TIME:
            ns = Duration(nanoseconds=1)
            self._jump_handle = clock.create_jump_callback(
                JumpThreshold(min_forward=ns, min_backward=Duration(nanoseconds=-1), on_clock_change=True),
                pre_callback=_weak_callback(self._before_jump),
                post_callback=_weak_callback(self._after_jump),
            )

    def _before_jump(self) -> None:
        self._remaining_ns = self._next_ns - self._now_ns()

    def _after_jump(self, jump: TimeJump) -> None:
        now_ns = self._now_ns()
        with self._lock:
            if jump.clock_change.name in ("ROS_TIME_ACTIVATED", "ROS_TIME_DEACTIVATED"):  # keep the rest of the period
                if now_ns:
                    self._next_ns = now_ns + self._remaining_ns
                    self._last_ns = self._next_ns - self.period_ns
            elif now_ns < self._last_ns:
                self._last_ns, self._next_ns = now_ns, now_ns + self.period_ns
        self._context.notify()

    def call_timer(self) -> tuple[int, int]:
        """Start the next period; return when the current call was due and when it takes place, in nanoseconds."""
        now_ns = self._now_ns()
        with self._lock:
            expected_ns = self._next_ns
            self._last_ns = now_ns
            if self.period_ns == 0:
                self._next_ns = now_ns
                return expected_ns, now_ns
            self._next_ns += self.period_ns
            if self._next_ns <= now_ns:  # the next call must be later than now, even if now is a multiple
                self._next_ns += ((now_ns - self._next_ns) // self.period_ns + 1) * self.period_ns
        return expected_ns, now_ns

    def is_ready(self) -> bool:
        return not self.canceled and not self._is_destruction_requested and self._next_ns <= self._now_ns()

    def time_until_next_call(self) -> int | None:
        return None if self.canceled else self._next_ns - self._now_ns()

    def time_since_last_call(self) -> int:
        return self._now_ns() - self._last_ns

    def cancel_timer(self) -> None:
        self.canceled = True
        self._context.notify()

    def reset_timer(self) -> None:
        now_ns = self._now_ns()
        with self._lock:
            self._next_ns, self.canceled = now_ns + self.period_ns, False
        self._context.notify()

    def max_wait_s(self) -> float | None:
        """Return the seconds until the timer is due; None if only another event, such as a jump, can make it due."""
        if self.canceled or self._is_destruction_requested or (self._jump_handle is not None and self._is_simulated()):
            return None
        return max(0.0, (self._next_ns - self._now_ns()) / 1e9)

    def _destroy(self) -> None:
        if self._jump_handle is not None:
            self._jump_handle.unregister()
        self._context.notify()


def _weak_callback(method: Callable[..., None]) -> Callable[..., None]:
    reference = weakref.WeakMethod(method)

    def call(*args: Any) -> None:
        if (target := reference()) is not None:
            target(*args)

    return call


class BaseTimer:
    """Base class of `Timer` and `rclpy.experimental.AsyncTimer`. Times are nanoseconds of the timer's clock."""

    callback: Callable[..., Any] | None

    def __init__(
        self,
        callback: Callable[..., Any] | None,
        timer_period_ns: int,
        clock: BaseClock,
        *,
        on_destroy: Callable[[Any], None] | None = None,
        context: Context | None = None,
        autostart: bool = True,
    ) -> None:
        self._context = resolve_context(context)
        self._clock = clock
        handle = self._context.handle
        if handle is None:
            raise NotInitializedException("cannot create timer")
        with handle:
            self._rosidl_timer = TimerHandle(handle, clock, int(timer_period_ns), autostart)
        self.rosidl_is_ready = self._rosidl_timer.is_ready
        self.rosidl_on_destroy = on_destroy
        self.callback = callback

    @property
    def handle(self) -> TimerHandle:
        return self._rosidl_timer

    def destroy(self) -> None:
        """Destroy the timer; use `Node.destroy_timer` for timers of nodes."""
        on_destroy, self.rosidl_on_destroy = self.rosidl_on_destroy, None
        if on_destroy is not None:
            on_destroy(self)
        self._rosidl_timer.destroy_when_not_in_use()

    @property
    def clock(self) -> Any:
        return self._clock

    @property
    def timer_period_ns(self) -> int:
        """Time between two calls of the timer; a new value has effect from the next call on."""
        with self._rosidl_timer:
            return self._rosidl_timer.period_ns

    @timer_period_ns.setter
    def timer_period_ns(self, value: int) -> None:
        period_ns = int(value)
        with self._rosidl_timer as timer:
            if period_ns < 0:
                raise RCLError("failed to exchange timer period: timer period must be non-negative")
            timer.period_ns = period_ns

    def is_ready(self) -> bool:
        """Return True if a call of the timer is due."""
        with self._rosidl_timer:
            return self._rosidl_timer.is_ready()

    def is_canceled(self) -> bool:
        with self._rosidl_timer:
            return self._rosidl_timer.canceled

    def cancel(self) -> None:
        """Stop the calls of the timer until `reset`."""
        with self._rosidl_timer:
            self._rosidl_timer.cancel_timer()

    def reset(self) -> None:
        """Start a new period now, also if the timer was canceled."""
        with self._rosidl_timer:
            self._rosidl_timer.reset_timer()

    def time_since_last_call(self) -> int:
        """Return the nanoseconds since the last call, or since the creation of the timer."""
        with self._rosidl_timer:
            return self._rosidl_timer.time_since_last_call()

    def time_until_next_call(self) -> int | None:
        """Return the nanoseconds until the next call, negative if it is overdue; None while the timer is canceled."""
        with self._rosidl_timer:
            return self._rosidl_timer.time_until_next_call()

    def _rosidl_info(self, expected_ns: int, actual_ns: int) -> TimerInfo:
        return TimerInfo(
            expected_call_time=max(0, expected_ns),  # negative after a jump back to the start of simulated time
            actual_call_time=actual_ns,
            clock_type=ClockType(int(self._clock.clock_type)),
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exc_tb: TracebackType | None
    ) -> None:
        self.destroy()


class Timer(BaseTimer):
    """Timer, created by `Node.create_timer`. Times are nanoseconds of its clock."""

    rosidl_take_method = "_take_timer"

    def __init__(
        self,
        callback: Callable[..., Any] | None,
        callback_group: CallbackGroup | None,
        timer_period_ns: int,
        clock: Clock,
        *,
        context: Context | None = None,
        autostart: bool = True,
    ) -> None:
        super().__init__(callback, timer_period_ns, clock, context=context, autostart=autostart)
        self.callback_group = callback_group
        self._executor_event = False
        self._rosidl_checked_callback: Callable[..., Any] | None = None
        self._rosidl_info_name: str | None = None  # parameter of that callback

    def rosidl_take(self, executor: Executor) -> Callable[[], Any] | None:
        with self._rosidl_timer:
            times_ns = self._rosidl_timer.call_timer()
        callback = self.callback
        if callback is not self._rosidl_checked_callback:
            self._rosidl_checked_callback = callback
            self._rosidl_info_name = None if callback is None else _name_of_info_parameter(callback)
        name = self._rosidl_info_name
        if callback is None or name is None:
            return callback
        return partial(callback, **{name: self._rosidl_info(*times_ns)})


def _name_of_info_parameter(callback: Callable[..., Any]) -> str | None:
    """Return the name of a callback's first parameter that is annotated with `TimerInfo`; None if there is none."""
    try:
        parameters = inspect.signature(callback).parameters.values()
    except (TypeError, ValueError, NameError, AttributeError):  # functions of C, and names for type checkers only
        return None
    for parameter in parameters:
        annotation = parameter.annotation
        if annotation is TimerInfo or (isinstance(annotation, str) and annotation.rpartition(".")[2] == "TimerInfo"):
            return parameter.name
    return None


class Rate:
    """Rate, created by `Node.create_rate`: `sleep` waits for the next period while another thread spins the node."""

    def __init__(self, timer: Timer, *, context: Context) -> None:
        self._timer = timer
        self._is_shutdown = False
        self._is_destroyed = False
        self._event = threading.Event()
        self._lock = threading.Lock()
        self._num_sleepers = 0
        self._timer.callback = self._event.set
        context.on_shutdown(self._on_shutdown)

    def _on_shutdown(self) -> None:
        self._is_shutdown = True
        self.destroy()

    def destroy(self) -> None:
        """Wake up all threads that sleep with the rate."""
        self._is_destroyed = True
        self._event.set()

    def sleep(self) -> None:
        """Block until the next period of the rate begins.

        Raises:
            ROSInterruptException: the context is shut down.
            RuntimeError: the rate was destroyed.
        """
        if self._is_shutdown:
            raise ROSInterruptException
        if self._is_destroyed:
            raise RuntimeError("Rate cannot sleep because it has been destroyed")
        if not self._timer.handle.is_valid:
            self.destroy()
            raise InvalidHandle("Rate cannot sleep because the timer has been destroyed")
        with self._lock:
            self._num_sleepers += 1
        try:
            self._event.wait()
        finally:
            with self._lock:
                self._num_sleepers -= 1
                if self._num_sleepers == 0:
                    self._event.clear()
            if self._is_shutdown:
                raise ROSInterruptException
