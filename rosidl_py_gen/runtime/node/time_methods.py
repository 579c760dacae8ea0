"""Time methods of a node: timers, rates, and the publisher of simulated time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.entities.timer import Timer
from rosidl_py_gen.runtime.node.node_base import NodeBase
from rosidl_py_gen.runtime.node.sim_time import SimTimePublisher
from rosidl_py_gen.runtime.time.clock import Clock
from rosidl_py_gen.runtime.time.timer_schedule import period_to_ns
from rosidl_py_gen.runtime.time.values import ClockType, Time

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.time.rate import Rate


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
        """Create a rate: ``await rate.sleep()`` keeps a loop at this frequency of the node's clock."""
        from rosidl_py_gen.runtime.time.rate import Rate

        return Rate(self.clock, frequency_hz)

    def create_sim_time_publisher(
        self, *, rate: float = 0.0, start: Time | None = None, period_s: float = 0.01
    ) -> SimTimePublisher:
        """Create a publisher of ``/clock``, for `advance` and `set_time`, or with `rate` simulated seconds per second.

        Args:
            rate: 0 publishes only on request.
            start: None starts at 0.
            period_s: time between two messages.

        Raises:
            TypeError: an argument has the wrong type.
            TimeRangeError: an argument is out of range.
            ClosedError: the node is closed.
        """
        self._require_open()
        start = Time(clock_type=ClockType.ROS_TIME) if start is None else start
        return SimTimePublisher(self._scope, self._names.resolve_topic("/clock"), start, rate, period_s)
