"""Timers on the event loop, `Node` methods for timers, rates and simulated time, and the clock topic.

`clocks.py` computes when a timer is due. Callbacks run like callbacks of subscriptions; periods that pass while an
async callback runs are skipped and counted. Timers may be created, reset and closed in any thread.

`TimeSource` receives simulated time, `SimTimePublisher` publishes it.
Source: docs/internals/protocol.md 9.6.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Literal

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import Waiters
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.msgs.rosgraph_msgs.msg import Clock as ClockMessage
from rosidl_py_gen.runtime.clocks import Clock, ClockTimer, Rate, TimerCall, TimerSchedule, period_to_ns
from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity, PollableEntity, entity_repr, user_callback
from rosidl_py_gen.runtime.entities.message_types import message_type
from rosidl_py_gen.runtime.entities.topics import Publisher, Subscription
from rosidl_py_gen.runtime.node.context import NodeBase
from rosidl_py_gen.runtime.parameters.values import ParameterDescriptor, ParameterType, SetResult, parameter_value
from rosidl_py_gen.runtime.time_values import ClockType, Duration, Time, TimeRangeError, finite_number, seconds_to_ns
from rosidl_py_gen.runtime.transport.qos import CLOCK, DEFAULT

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterStore
    from rosidl_py_gen.runtime.parameters.values import Parameter


class Timer(PollableEntity):
    """Timer of a clock, created by `Node.create_timer` or `create_wall_timer`."""

    _contents = "ticks"

    def __init__(self, scope: EntityScope, period_ns: int, callback: Callable[[], object] | None, clock: Clock) -> None:
        checked = user_callback(scope, callback, "a timer's callback")
        if not isinstance(clock, Clock):
            raise TypeError(f"clock must be a Clock such as node.clock, got {clock!r:.100}")
        super().__init__(scope)
        self._clock = clock
        self._callback = checked
        self._schedule = TimerSchedule(period_ns, clock.now_ns(), waits_at_zero=clock.clock_type is ClockType.ROS_TIME)
        self._schedule_lock = threading.Lock()  # a reset in another thread must not be lost in a call
        self._worker: asyncio.Task[None] | None = None
        self._waiters = Waiters()
        self._tick: list[Duration] = []
        """List that receives the result of the next tick and is shared by all tasks that wait for it; empty until the
        tick."""
        self.missed: int = 0
        """Number of periods that were skipped, because the callback or program was too slow."""
        self.call_count: int = 0
        """Number of calls of the callback, or of ticks that the program has taken."""
        self._clock_timer = ClockTimer(clock, self._schedule, lambda: scope.loop_binding.loop, self._on_due)
        self._start_registration = scope.loop_binding.on_bind(self._clock_timer.arm_threadsafe)
        scope.register(self)

    async def tick(self) -> Duration:
        """Wait until the timer is due; return the time since the previous tick (since creation for the first tick).

        If the timer is due already, return at once; further missed ticks are skipped.

        There is no blocking form, because timers run on the event loop; a plain script can use `time.sleep`.

        Raises:
            CallbackInUseError: the timer has a callback.
            ClosedError: the timer was closed, also while waiting.
        """
        self._require_takeable()
        self._scope.loop_binding.running_loop()
        if self._schedule.is_ready(self._clock.now_ns()):
            return self._count(self._advance())
        self._clock_timer.arm()
        tick = self._tick
        await self._waiters.wait(lambda: tick or self._closed)
        if not tick:
            self._require_open()
        return tick[0]

    def __aiter__(self) -> Timer:
        return self

    async def __anext__(self) -> Duration:
        try:
            return await self.tick()
        except ClosedError:
            raise StopAsyncIteration from None

    def take(self) -> Duration | None:
        """Return the time since the previous tick if the timer is due, else None, without waiting; from any thread.

        Missed ticks are skipped and counted in `missed`.

        Raises:
            CallbackInUseError: the timer has a callback.
            ClosedError: the timer or its node is closed.
        """
        self._require_takeable()
        now_ns = self._clock.now_ns()
        with self._schedule_lock:
            if not self._schedule.is_ready(now_ns):
                return None
            call = self._schedule.mark_called(now_ns)
        self._clock_timer.arm_threadsafe()
        return self._count(call)

    def _described(self) -> str:
        return "a timer"

    def _is_ready(self) -> bool:
        return self.is_ready

    def _count(self, call: TimerCall) -> Duration:
        self.missed += call.missed
        self.call_count += 1
        return Duration(nanoseconds=call.since_last_ns)

    def _advance(self) -> TimerCall:
        now_ns = self._clock.now_ns()
        with self._schedule_lock:
            return self._schedule.mark_called(now_ns)

    def _on_due(self) -> None:
        if self._callback is None:
            if not self._waiters:  # the timer remains due
                if self._on_arrival is not None:
                    self._on_arrival()
                return
            self._tick.append(self._count(self._advance()))
            self._tick = []
            self._waiters.wake()
        elif self._worker is None or self._worker.done():
            self._count(self._advance())
            self._worker = self._callback.call()
        else:
            self.missed += 1 + self._advance().missed
        self._clock_timer.arm()

    @property
    def period(self) -> Duration:
        """Time between two calls or ticks of the timer."""
        return Duration(nanoseconds=self._schedule.period_ns)

    def change_period(self, period_s: float) -> None:
        """Change the period; the time of the next call remains, and the new period starts there.

        Raises:
            TypeError: `period_s` is not a number.
            TimeRangeError: `period_s` is negative or not finite.
        """
        self._schedule.period_ns = period_to_ns(period_s)
        self._clock_timer.arm_threadsafe()

    @property
    def is_canceled(self) -> bool:
        """True between `cancel` and `reset`."""
        return self._schedule.canceled

    @property
    def is_ready(self) -> bool:
        """True when a call or tick of the timer is due."""
        return self._schedule.is_ready(self._clock.now_ns())

    def time_until_next_call(self) -> Duration | None:
        """Return the time until the timer is due, negative if it is overdue; None if the timer is canceled.

        The result is also None for a timer of simulated time before the first message on ``/clock``.
        """
        left_ns = self._schedule.time_until_ns(self._clock.now_ns())
        return None if left_ns is None else Duration(nanoseconds=left_ns)

    def cancel(self) -> None:
        """Stop the timer until `reset`; tasks that wait for a tick continue to wait."""
        self._schedule.canceled = True
        self._clock_timer.arm_threadsafe()

    def reset(self) -> None:
        """Start a new period now, also if the timer was canceled.

        Raises:
            ClosedError: the timer or its node is closed.
        """
        self._require_open()
        now_ns = self._clock.now_ns()
        with self._schedule_lock:
            self._schedule.reset(now_ns)
        self._clock_timer.arm_threadsafe()

    def __repr__(self) -> str:
        period = f"{self._schedule.period_ns / NS_PER_S:g} s"
        details = period, self._clock.clock_type.name, *["canceled"] * self.is_canceled
        return entity_repr(self, *details, peers=lambda: self.call_count, peer="call")

    def close(self) -> None:
        """Stop the timer for good; tasks that wait for a tick get `ClosedError`. May be called twice."""
        if self._begin_close():
            self._start_registration.close()
            if self._callback is not None:
                self._callback.close()
            self._clock_timer.close()
            self._waiters.wake()


# ------------------------------------------------------------------------------------------------------- simulated time

USE_SIM_TIME = "use_sim_time"
NOT_BOOL_REASON = "use_sim_time parameter set to something besides a bool"


class TimeSource:
    """Updater of a node's clock, which subscribes to ``/clock`` while the parameter `use_sim_time` is true."""

    def __init__(self, scope: EntityScope, names: NodeNames, store: ParameterStore, clock: Clock) -> None:
        self._scope = scope
        self._topic = names.resolve_topic("/clock")
        self._clock = clock
        self._subscription: Subscription[ClockMessage] | None = None
        store.callbacks.add("on-set", self._check)
        store.callbacks.add("post-set", self._after_set)
        if not store.has(USE_SIM_TIME):
            store.declare(USE_SIM_TIME, parameter_value(False), ParameterDescriptor(name=USE_SIM_TIME))

    def _check(self, parameters: list[Parameter]) -> SetResult:
        values = [parameter.value for parameter in parameters if parameter.name == USE_SIM_TIME]
        is_wrong = any(value.type is not ParameterType.BOOL for value in values)
        return SetResult(not is_wrong, NOT_BOOL_REASON if is_wrong else "")

    def _after_set(self, parameters: list[Parameter]) -> None:
        for parameter in parameters:
            is_on = parameter.value.value is True
            if parameter.name == USE_SIM_TIME and is_on is (self._subscription is None):
                (self._start if is_on else self._stop)()

    def _start(self) -> None:
        message = message_type(ClockMessage)
        self._subscription = Subscription(self._scope, message, self._topic, self._on_clock, CLOCK)
        # The clock must not return the time of an earlier simulation.
        self._clock.set_ros_time_override(Time(clock_type=ClockType.ROS_TIME))
        self._clock.enable_ros_time_override()

    def _stop(self) -> None:
        if self._subscription is not None:
            self._subscription.close()
            self._subscription = None
        self._clock.disable_ros_time_override()

    def _on_clock(self, message: ClockMessage) -> None:
        if message.clock.sec < 0:
            self._scope.logger.warning(f"ignored a negative time on {self._topic}", throttle_s=1.0)
            return
        self._clock.set_ros_time_override(Time.from_msg(message.clock))


class SimTimePublisher(CompositeEntity):
    """Publisher of simulated time on ``/clock``, created by `Node.create_sim_time_publisher`.

    `advance` and `set_time` change the time. While `rate` is not 0, `rate` simulated seconds pass per second, in steps
    of `period_s`.
    """

    def __init__(self, scope: EntityScope, topic: str, start: Time, rate: float, period_s: float) -> None:
        _require_time("start", start)
        self._rate = _checked_rate(rate)
        period_ns = period_to_ns(period_s)
        if not period_ns:
            raise TimeRangeError("period_s, the seconds between two messages, must be more than 0")
        super().__init__(scope)
        self._now_ns = start.nanoseconds
        self._wall = scope.make_clock(ClockType.STEADY_TIME)
        self._wall_ns = self._wall.now_ns()
        self._publisher: Publisher[ClockMessage] = Publisher(self._parts, message_type(ClockMessage), topic, DEFAULT)
        self._timer = Timer(self._parts, period_ns, self._tick, self._wall)
        if not self._rate:
            self._timer.cancel()
        scope.register(self)

    @property
    def rate(self) -> float:
        """Simulated seconds per second; may be changed at any time, 0 pauses. Must be a finite number >= 0."""
        return self._rate

    @rate.setter
    def rate(self, rate: float) -> None:
        rate = _checked_rate(rate)
        self._require_open()
        previous, self._rate = self._rate, rate
        if not rate:
            self._timer.cancel()
        elif not previous:
            self._wall_ns = self._wall.now_ns()  # skip the pause
            self._timer.reset()

    @property
    def now(self) -> Time:
        """Time that was published last; before the first message, the time at which the publisher starts."""
        return Time(nanoseconds=self._now_ns, clock_type=ClockType.ROS_TIME)

    def advance(self, duration: Duration | float) -> None:
        """Add a duration, or a number of seconds, to the simulated time and publish it; a negative duration jumps back.

        Raises:
            TypeError: `duration` is neither a duration nor a number.
            TimeRangeError: `duration` is not finite, or the new time does not fit into a message.
        """
        length_ns = duration.nanoseconds if isinstance(duration, Duration) else seconds_to_ns("duration", duration)
        self.set_time(self.now + Duration(nanoseconds=length_ns))

    def set_time(self, now: Time) -> None:
        """Set the simulated time to a `Time` of any clock type, and publish it.

        Raises:
            TypeError: `now` is not a `Time`.
            TimeRangeError: the time does not fit into a message.
        """
        _require_time("now", now)
        self._publisher.publish(ClockMessage(clock=now.to_msg()))
        self._now_ns = now.nanoseconds

    def _described(self) -> str:
        return "a publisher of simulated time"

    def _tick(self) -> None:
        wall_ns = self._wall.now_ns()
        elapsed_ns, self._wall_ns = wall_ns - self._wall_ns, wall_ns
        self.advance(Duration(nanoseconds=round(elapsed_ns * self._rate)))

    async def wait_for_subscribers(self, timeout_s: float | None = None, *, count: int = 1) -> Literal[True]:
        """Wait until at least `count` nodes follow ``/clock``; raises `WaitTimeoutError` after `timeout_s`."""
        return await self._publisher.wait_for_subscribers(timeout_s, count=count)


def _checked_rate(rate: object) -> float:
    number = finite_number("rate", rate, "a number of simulated seconds per second")
    if number < 0:
        raise TimeRangeError(f"rate, the simulated seconds per second, must be 0 or more, got {number!r}")
    return number


def _require_time(name: str, value: object) -> None:
    if not isinstance(value, Time):
        raise TypeError(f"{name} must be a Time such as Time(seconds=5), got {value!r:.100}")


class TimeMethods(NodeBase):
    """Time methods of `Node`. Each one raises `ClosedError` when the node is closed."""

    def create_timer(
        self, period_s: float, callback: Callable[[], object] | None = None, *, clock: Clock | None = None
    ) -> Timer:
        """Create a timer.

        Args:
            period_s: time between two calls.
            callback: plain or async function without arguments; None to iterate, `tick` or `take`.
            clock: None uses the node's clock, whose time may be simulated.

        Raises:
            TypeError: an argument has the wrong type.
            TimeRangeError: the period is negative or not finite.
            ClosedError: the node is closed.
        """
        self._require_open()
        timer = Timer(self._scope, period_to_ns(period_s), callback, self.clock if clock is None else clock)
        if callback is not None:
            self._scope.with_callbacks[id(timer)] = timer
        return timer

    def create_wall_timer(self, period_s: float, callback: Callable[[], object] | None = None) -> Timer:
        """Create a timer of the steady clock."""
        return self.create_timer(period_s, callback, clock=self._scope.make_clock(ClockType.STEADY_TIME))

    def create_rate(self, frequency_hz: float) -> Rate:
        """Create a rate: ``await rate.sleep()`` keeps a loop at a frequency in Hz, measured by the node's clock."""
        return Rate(self.clock, frequency_hz)

    def create_sim_time_publisher(
        self, *, rate: float = 0.0, start: Time | None = None, period_s: float = 0.01
    ) -> SimTimePublisher:
        """Create a publisher of ``/clock``, whose time the program advances, or which passes with `rate`.

        Args:
            rate: simulated seconds per second; 0 publishes only when the program calls `advance` or `set_time`.
            start: first time; None starts at 0.
            period_s: time between two messages.

        Raises:
            TypeError: an argument has the wrong type.
            TimeRangeError: an argument is out of range.
            ClosedError: the node is closed.
        """
        self._require_open()
        start = Time(clock_type=ClockType.ROS_TIME) if start is None else start
        return SimTimePublisher(self._scope, self._names.resolve_topic("/clock"), start, rate, period_s)
