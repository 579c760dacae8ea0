"""Simulated time: following ``/clock`` while the parameter `use_sim_time` is true, and publishing it.

Decides which change of the parameter means what; what a jump of time means is decided by `time/clock.py`. May import
endpoints and parameters, never the node. Source: docs/internals/protocol.md 9.6.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from rosidl_py_gen.msgs.rosgraph_msgs.msg import Clock as ClockMessage
from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity
from rosidl_py_gen.runtime.entities.message_types import message_type
from rosidl_py_gen.runtime.entities.publisher import Publisher
from rosidl_py_gen.runtime.entities.subscription import Subscription
from rosidl_py_gen.runtime.entities.timer import Timer
from rosidl_py_gen.runtime.parameters.values import ParameterDescriptor, ParameterType, SetResult, parameter_value
from rosidl_py_gen.runtime.time.clock import Clock
from rosidl_py_gen.runtime.time.timer_schedule import period_to_ns
from rosidl_py_gen.runtime.time.values import ClockType, Duration, Time, TimeRangeError, finite_number, seconds_to_ns
from rosidl_py_gen.runtime.transport.qos import CLOCK, DEFAULT

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterStore
    from rosidl_py_gen.runtime.parameters.values import Parameter

USE_SIM_TIME = "use_sim_time"
NOT_BOOL_REASON = "use_sim_time parameter set to something besides a bool"


class TimeSource:
    """Ties the ROS clock of one node to its parameter `use_sim_time` and, when that is true, to ``/clock``."""

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
        """Refuse a value that is no bool."""
        wrong = any(one.name == USE_SIM_TIME and one.value.type is not ParameterType.BOOL for one in parameters)
        return SetResult(not wrong, NOT_BOOL_REASON if wrong else "")

    def _after_set(self, parameters: list[Parameter]) -> None:
        for parameter in parameters:
            wanted = parameter.value.value is True
            if parameter.name == USE_SIM_TIME and wanted is (self._subscription is None):
                (self._start if wanted else self._stop)()

    def _start(self) -> None:
        message = message_type(ClockMessage)
        self._subscription = Subscription(self._scope, message, self._topic, self._on_clock, CLOCK)
        # A time from an earlier round of simulation must not be shown again.
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
    """Publishes ``/clock``; made by `create_sim_time_publisher`.

    Time moves with `advance` and `set_time`, and while `rate` is not 0 by itself: `rate` simulated seconds pass in one
    second, in steps of `period_s`.
    """

    def __init__(self, scope: EntityScope, topic: str, start: Time, rate: float, period_s: float) -> None:
        """Raises `TypeError` and `TimeRangeError` that name the argument."""
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
        """Simulated seconds per second; may be changed at any time, 0 pauses.

        Setting it raises `TypeError` for no number, `TimeRangeError` unless finite and 0 or more.
        """
        return self._rate

    @rate.setter
    def rate(self, rate: float) -> None:
        rate = _checked_rate(rate)
        self._scope.require_open(self._closed, "a publisher of simulated time")
        before, self._rate = self._rate, rate
        if not rate:
            self._timer.cancel()
        elif not before:
            self._wall_ns = self._wall.now_ns()  # what passed during the pause does not count
            self._timer.reset()

    @property
    def now(self) -> Time:
        """The time published last, or about to be published first."""
        return Time(nanoseconds=self._now_ns, clock_type=ClockType.ROS_TIME)

    def advance(self, duration: Duration | float) -> None:
        """Let time pass, a number means seconds, and publish; negative jumps back.

        Raises:
            TypeError: no duration and no number. TimeRangeError: not finite, or time would leave what a message holds.
        """
        length_ns = duration.nanoseconds if isinstance(duration, Duration) else seconds_to_ns("duration", duration)
        self.set_time(self.now + Duration(nanoseconds=length_ns))

    def set_time(self, now: Time) -> None:
        """Publish this time, whichever clock it is of.

        Raises:
            TypeError: no `Time`. TimeRangeError: too late for a message.
        """
        _require_time("now", now)
        self._publisher.publish(ClockMessage(clock=now.to_msg()))
        self._now_ns = now.nanoseconds

    def _tick(self) -> None:
        wall_ns = self._wall.now_ns()
        passed_ns, self._wall_ns = wall_ns - self._wall_ns, wall_ns
        self.advance(Duration(nanoseconds=round(passed_ns * self._rate)))

    async def wait_for_subscribers(self, timeout_s: float | None = None, *, count: int = 1) -> Literal[True]:
        """Wait until at least `count` nodes follow; raises `WaitTimeoutError` when the time passed."""
        return await self._publisher.wait_for_subscribers(timeout_s, count=count)


def _checked_rate(rate: object) -> float:
    number = finite_number("rate", rate, "a number of simulated seconds per second")
    if number < 0:
        raise TimeRangeError(f"rate, the simulated seconds per second, must be 0 or more, got {number!r}")
    return number


def _require_time(what: str, value: object) -> None:
    if not isinstance(value, Time):
        raise TypeError(f"{what} must be a Time such as Time(seconds=5), got {value!r:.100}")
