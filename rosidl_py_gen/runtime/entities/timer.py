"""Timers on the event loop.

Decides what a tick does; when one is due is `time/clock_timer.py`. Callbacks run like those of subscriptions; while
an async
one runs, periods that pass are skipped and counted. Timers may be made, reset and closed in any thread; what touches
the event loop is handed over to it.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from rosidl_py_gen.base.signatures import require_signature
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import Waiters
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.entities.entity_scope import entity_repr
from rosidl_py_gen.runtime.entities.pollable import CallbackInUseError, PollableEntity
from rosidl_py_gen.runtime.loop.user_callback import UserCallback
from rosidl_py_gen.runtime.time.clock import Clock
from rosidl_py_gen.runtime.time.clock_timer import ClockTimer
from rosidl_py_gen.runtime.time.timer_schedule import TimerCall, TimerSchedule, period_to_ns
from rosidl_py_gen.runtime.time.values import ClockType, Duration

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope


class Timer(PollableEntity):
    """Made by `Node.create_timer` and `create_wall_timer`."""

    def __init__(self, scope: EntityScope, period_ns: int, callback: Callable[[], object] | None, clock: Clock) -> None:
        """Raises `TypeError` for a callback or clock that is none, `TimeRangeError` for a negative period."""
        if callback is not None and not callable(callback):
            raise TypeError(f"callback must be a function without arguments, or None, got {callback!r:.100}")
        if callback is not None:
            require_signature(callback, "a timer's callback")
        if not isinstance(clock, Clock):
            raise TypeError(f"clock must be a Clock such as node.clock, got {clock!r:.100}")
        super().__init__(scope)
        self._clock = clock
        self._callback = None if callback is None else UserCallback(scope, callback, "a timer's callback")
        self._schedule = TimerSchedule(period_ns, clock.now_ns(), waits_at_zero=clock.clock_type is ClockType.ROS_TIME)
        self._schedule_lock = threading.Lock()  # a reset in another thread must not get lost in a call
        self._worker: asyncio.Task[None] | None = None
        self._waiters = Waiters()
        self._tick: list[Duration] = []
        """Where whoever waits finds the next tick."""
        self.missed = 0
        """How many periods passed without a call and were skipped."""
        self.call_count = 0
        """How many times the timer was called, or ticked."""
        self._due = ClockTimer(clock, self._schedule, lambda: scope.bridge.loop, self._on_due)
        self._starts = scope.bridge.on_start(self._due.arm_threadsafe)
        scope.register(self)

    # ------------------------------------------------------------------------------------------------------ ticking

    async def tick(self) -> Duration:
        """Wait until the timer is due; returns the time since the previous tick (since creation for the first).

        A tick that became due while nobody waited is given at once; further ones that were missed are skipped.

        Raises:
            ClosedError: the timer was closed, also while waiting.
        """
        self._require_takeable()
        self._scope.bridge.running_loop()
        if self._schedule.is_ready(self._clock.now_ns()):
            return self._call()
        self._due.arm()
        tick = self._tick
        await self._waiters.wait(lambda: tick or self._closed)
        if not tick:
            self._scope.require_open(self._closed, "a timer")
        return tick[0]

    def __aiter__(self) -> Timer:
        return self

    async def __anext__(self) -> Duration:
        try:
            return await self.tick()
        except ClosedError:
            raise StopAsyncIteration from None

    def take(self) -> Duration | None:
        """The tick that is due, as the time since the previous one; None when none is. From any thread, never waits.

        Ticks that were missed are skipped and counted.

        Raises:
            CallbackInUseError: the timer has a callback. ClosedError: it, or its node, is closed.
        """
        self._require_takeable()
        now_ns = self._clock.now_ns()
        with self._schedule_lock:
            if not self._schedule.is_ready(now_ns):
                return None
            call = self._schedule.mark_called(now_ns)
        self._due.arm_threadsafe()
        return self._count(call)

    def _require_takeable(self) -> None:
        if self._callback is not None:
            raise CallbackInUseError("this timer has a callback; it cannot be waited for too")
        self._scope.require_open(self._closed, "a timer")

    def _described(self) -> str:
        return "a timer"

    def _is_ready(self) -> bool:
        return self.is_ready

    def _call(self) -> Duration:
        return self._count(self._advance())

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
            if not self._waiters:  # it stays due
                if self._tell is not None:
                    self._tell()
                return
            self._tick.append(self._call())
            self._tick = []
            self._waiters.wake()
        elif self._worker is None or self._worker.done():
            self._call()
            self._worker = self._callback.call()
        else:
            self.missed += 1 + self._advance().missed
        self._due.arm()

    # -------------------------------------------------------------------------------------------------------- state

    @property
    def period(self) -> Duration:
        """Time between two calls."""
        return Duration(nanoseconds=self._schedule.period_ns)

    def change_period(self, period_s: float) -> None:
        """Use another period from the next call on; the call already due stays where it is.

        Raises:
            TypeError: no number. TimeRangeError: negative or not finite.
        """
        self._schedule.change_period(period_to_ns(period_s))
        self._due.arm_threadsafe()

    @property
    def is_canceled(self) -> bool:
        """True between `cancel` and `reset`."""
        return self._schedule.canceled

    @property
    def is_ready(self) -> bool:
        """True when a call is due."""
        return self._schedule.is_ready(self._clock.now_ns())

    def time_until_next_call(self) -> Duration | None:
        """Negative when overdue; None while canceled, or while simulated time has not begun."""
        left_ns = self._schedule.time_until_ns(self._clock.now_ns())
        return None if left_ns is None else Duration(nanoseconds=left_ns)

    def cancel(self) -> None:
        """Stop until `reset`; whoever waits for a tick keeps waiting."""
        self._schedule.cancel()
        self._due.arm_threadsafe()

    def reset(self) -> None:
        """Start a period now; ends a cancellation.

        Raises:
            ClosedError: the timer or its node is closed.
        """
        self._scope.require_open(self._closed, "a timer")
        now_ns = self._clock.now_ns()
        with self._schedule_lock:
            self._schedule.reset(now_ns)
        self._due.arm_threadsafe()

    def __repr__(self) -> str:
        period = f"{self._schedule.period_ns / NS_PER_S:g} s"
        parts = period, self._clock.clock_type.name, *["canceled"] * self.is_canceled
        return entity_repr(self, *parts, peers=lambda: self.call_count, peer="call")

    def close(self) -> None:
        """Stop for ever; whoever waits for a tick gets `ClosedError`. May be called twice."""
        if not self._begin_close():
            return
        self._starts.close()
        if self._callback is not None:
            self._callback.close()
        self._due.close()
        self._waiters.wake()
