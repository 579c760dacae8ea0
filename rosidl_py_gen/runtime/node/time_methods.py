"""The time methods of a node: timers, rates, and publishing simulated time.

Decides which clock each of them follows. May import what is below the node, never the node.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.entities.timer import Timer
from rosidl_py_gen.runtime.node.sim_time import SimTimePublisher
from rosidl_py_gen.runtime.time.clock import Clock
from rosidl_py_gen.runtime.time.timer_schedule import period_to_ns
from rosidl_py_gen.runtime.time.values import ClockType, Time

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.time.rate import Rate


class TimeMethods:
    """Time methods of `Node`. Each one raises `ClosedError` when the node is closed."""

    _scope: EntityScope
    clock: Clock
    _names: NodeNames

    if TYPE_CHECKING:

        def _require_open(self) -> None: ...

    def create_timer(
        self, period_s: float, callback: Callable[[], object] | None = None, *, clock: Clock | None = None
    ) -> Timer:
        """Every `period_s` seconds of this node's clock, which may be simulated, or of `clock`.

        Raises:
            TypeError: no number, function or clock. TimeRangeError: a negative period. ClosedError.
        """
        self._require_open()
        timer = Timer(self._scope, period_to_ns(period_s), callback, self.clock if clock is None else clock)
        if callback is not None:
            self._scope.with_callbacks[id(timer)] = timer
        return timer

    def create_wall_timer(self, period_s: float, callback: Callable[[], object] | None = None) -> Timer:
        """Every `period_s` seconds of the steady clock, which nothing can turn back."""
        return self.create_timer(period_s, callback, clock=self._scope.make_clock(ClockType.STEADY_TIME))

    def create_rate(self, frequency_hz: float) -> Rate:
        """``await rate.sleep()`` keeps a loop at this frequency of the node's clock."""
        from rosidl_py_gen.runtime.time.rate import Rate

        return Rate(self.clock, frequency_hz)

    def create_sim_time_publisher(
        self, *, rate: float = 0.0, start: Time | None = None, period_s: float = 0.01
    ) -> SimTimePublisher:
        """Publish ``/clock`` by hand (`advance`, `set_time`), or by itself with `rate` simulated seconds a second."""
        self._require_open()
        begin = Time(clock_type=ClockType.ROS_TIME) if start is None else start
        return SimTimePublisher(self._scope, self._names.resolve_topic("/clock"), begin, rate, period_s)
