"""Timers on the event loop.

The module `time/clock_timer.py` computes when a timer is due. Callbacks run like callbacks of subscriptions; periods
that pass while an async callback runs are skipped and counted. Timers may be created, reset and closed in any thread.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import Waiters
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.entities.entity_scope import PollableEntity, entity_repr, user_callback
from rosidl_py_gen.runtime.time.clock import Clock
from rosidl_py_gen.runtime.time.clock_timer import ClockTimer, TimerCall, TimerSchedule, period_to_ns
from rosidl_py_gen.runtime.time.values import ClockType, Duration

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope


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
