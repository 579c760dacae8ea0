"""Schedule of the demo, which calls each task at its rate, in real or in simulated time.

Tasks run one after the other, at times that only their rates determine. So a robot drives in the same way however busy
the machine is, which timers of nodes could not guarantee.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import math
from collections.abc import Callable

from rosidl_py_gen.runtime import ClockType, Node, Time

_MAX_DELAY_S = 0.5
"""Delay in seconds after which the schedule restarts from the current time instead of catching up, as after a suspended
process."""
_NS_PER_S = 1_000_000_000


class Schedule:
    """Schedule that calls tasks when they are due, in real or in simulated time.

    Args:
        node: its clock is the time, unless that is simulated; with simulated time it publishes ``/clock``.
        advance: called with the seconds that have passed, before the tasks that are due then.
        speed: simulated seconds per second; None for real time.
    """

    def __init__(self, node: Node, advance: Callable[[float], None], *, speed: float | None = None) -> None:
        self.elapsed_s = 0.0
        """Seconds of the schedule's time since its start."""
        self._clock = node.clock
        self._advance = advance
        self._speed = speed
        self._sim_time = None if speed is None else node.create_sim_time_publisher()
        self.now = self._clock.now() if self._sim_time is None else self._sim_time.now
        """Time of the current task, for the stamps of messages."""
        self._numbers = itertools.count()
        self._tasks: list[tuple[float, int, Callable[[], float], Callable[[], None]]] = []

    def every(self, rate_hz: Callable[[], float], task: Callable[[], None]) -> None:
        """Register a task that is called repeatedly.

        Its rate may change at any time, with effect after the next call.
        """
        self._push(self.elapsed_s, rate_hz, task)

    def _push(self, after_s: float, rate_hz: Callable[[], float], task: Callable[[], None]) -> None:
        due_s = round(after_s + 1 / rate_hz(), 9)  # nanoseconds, so that errors do not add up
        heapq.heappush(self._tasks, (due_s, next(self._numbers), rate_hz, task))

    async def run(self, duration_s: float = math.inf) -> None:
        """Call all registered tasks when they are due, until the duration has passed."""
        loop = asyncio.get_running_loop()
        start_s, speed = loop.time(), self._speed or 1.0
        while self._tasks and self._tasks[0][0] <= duration_s:
            due_s, _, rate_hz, task = heapq.heappop(self._tasks)
            delay_s = loop.time() - (start_s + due_s / speed)
            if delay_s > _MAX_DELAY_S:
                start_s += delay_s
            await asyncio.sleep(max(0.0, -delay_s))
            if due_s > self.elapsed_s:
                self._advance(due_s - self.elapsed_s)
                self.elapsed_s = due_s
                self._read_clock()
            task()
            self._push(due_s, rate_hz, task)

    def _read_clock(self) -> None:
        if self._sim_time is None:
            self.now = self._clock.now()
        else:  # before the tasks, so that no stamp is later than the time on /clock
            self.now = Time(nanoseconds=round(self.elapsed_s * _NS_PER_S), clock_type=ClockType.ROS_TIME)
            self._sim_time.set_time(self.now)
