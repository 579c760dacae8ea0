"""Methods of a node for timers, rates and simulated time, and classes that receive and publish simulated time.

Source: docs/internals/protocol.md 9.6.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from rosidl_py_gen.msgs.rosgraph_msgs.msg import Clock as ClockMessage
from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity
from rosidl_py_gen.runtime.entities.message_types import message_type
from rosidl_py_gen.runtime.entities.publisher import Publisher
from rosidl_py_gen.runtime.entities.subscription import Subscription
from rosidl_py_gen.runtime.entities.timer import Timer
from rosidl_py_gen.runtime.node.node_base import NodeBase
from rosidl_py_gen.runtime.parameters.values import ParameterDescriptor, ParameterType, SetResult, parameter_value
from rosidl_py_gen.runtime.time.clock import Clock
from rosidl_py_gen.runtime.time.clock_timer import period_to_ns
from rosidl_py_gen.runtime.time.values import ClockType, Duration, Time, TimeRangeError, finite_number, seconds_to_ns
from rosidl_py_gen.runtime.transport.qos import CLOCK, DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterStore
    from rosidl_py_gen.runtime.parameters.values import Parameter
    from rosidl_py_gen.runtime.time.clock_timer import Rate

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
        from rosidl_py_gen.runtime.time.clock_timer import Rate

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
