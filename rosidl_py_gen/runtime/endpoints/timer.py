"""Timers on the event loop.

Decides when to wake up; what is due, and what was missed, is `time/schedule.py`. A timer on simulated time does not
sleep: it looks again whenever its clock jumps. Callbacks run like those of subscriptions; while an async one runs,
periods that pass are skipped and counted. Timers may be made, reset and closed in any thread; what touches the event
loop is handed over to it.
"""

from __future__ import annotations

import asyncio
import threading
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.endpoints.scope import Owned, shown
from rosidl_py_gen.runtime.loop.user_function import UserFunction
from rosidl_py_gen.runtime.time.clock import Clock, on_every_jump
from rosidl_py_gen.runtime.time.schedule import Schedule, TimerCall, period_to_ns
from rosidl_py_gen.runtime.time.values import ClockType, Duration
from rosidl_py_gen.signatures import require_signature
from rosidl_py_gen.stamps import NS_PER_S
from rosidl_py_gen.waiting import Waiters

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.time.clock import TimeJump


class Timer(Owned):
    """Made by `Node.create_timer` and `create_wall_timer`."""

    def __init__(self, scope: Scope, period_ns: int, callback: Callable[[], object] | None, clock: Clock) -> None:
        """Raises `TypeError` for a callback or clock that is none, `TimeRangeError` for a negative period."""
        if callback is not None and not callable(callback):
            raise TypeError(f"callback must be a function without arguments, or None, got {callback!r:.100}")
        if callback is not None:
            require_signature(callback, "a timer's callback")
        if not isinstance(clock, Clock):
            raise TypeError(f"clock must be a Clock such as node.clock, got {clock!r:.100}")
        super().__init__(scope)
        self._clock = clock
        self._callback = None if callback is None else UserFunction(scope, callback, "a timer's callback")
        self._rule = Schedule(period_ns, clock.now_ns(), waits_at_zero=clock.clock_type is ClockType.ROS_TIME)
        self._rule_lock = threading.Lock()  # a reset in another thread must not get lost in a call
        self._handle: asyncio.Handle | None = None
        self._worker: asyncio.Task[None] | None = None
        self._waiters = Waiters()
        self._tick: list[Duration] = []
        """Where whoever waits finds the next tick."""
        self.missed = 0
        """How many periods passed without a call and were skipped."""
        self.call_count = 0
        """How many times the timer was called, or ticked."""
        self._jumps = on_every_jump(clock, self._before_jump, self._after_jump)
        self._starts = scope.bridge.on_start(self._arm_soon)
        scope.own(self)

    # ------------------------------------------------------------------------------------------------------ ticking

    async def tick(self) -> Duration:
        """Wait until the timer is due; returns the time since the previous tick (since creation for the first).

        A tick that became due while nobody waited is given at once; further ones that were missed are skipped.

        Raises:
            ClosedError: the timer was closed, also while waiting.
        """
        self._require_usable()
        self._scope.bridge.running_loop()
        if self._rule.is_ready(self._clock.now_ns()):
            return self._call()
        self._arm()
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

    def _require_usable(self) -> None:
        if self._callback is not None:
            raise TypeError("this timer has a callback; it cannot be waited for too")
        self._scope.require_open(self._closed, "a timer")

    def _call(self) -> Duration:
        call = self._advance()
        self.missed += call.missed
        self.call_count += 1
        return Duration(nanoseconds=call.since_last_ns)

    def _advance(self) -> TimerCall:
        now_ns = self._clock.now_ns()
        with self._rule_lock:
            return self._rule.call(now_ns)

    # ------------------------------------------------------------------------------------------------------ waiting

    def _arm_soon(self) -> None:
        """`_arm` from any thread: a loop that sleeps has to be woken."""
        if self._scope.bridge.in_loop_thread():
            self._arm()
        else:
            self._scope.bridge.call_soon(self._arm)

    def _arm(self) -> None:
        """Look at the clock and come back when the timer is due; runs on the loop."""
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None
        loop = self._scope.bridge.loop
        if self._closed or loop is None:
            return
        left_ns = self._rule.time_until_ns(self._clock.now_ns())
        if left_ns is None:
            return
        if left_ns <= 0:
            self._handle = loop.call_soon(self._fire)
        elif not self._clock.ros_time_is_active:
            self._handle = loop.call_later(left_ns / NS_PER_S, self._fire)

    def _fire(self) -> None:
        self._handle = None
        if self._closed or not self._rule.is_ready(self._clock.now_ns()):
            self._arm()  # woken a little early, or reset meanwhile
            return
        if self._callback is None:
            if not self._waiters:
                return  # it stays due
            self._tick.append(self._call())
            self._tick = []
            self._waiters.wake()
        elif self._worker is None or self._worker.done():
            self._call()
            self._worker = self._callback.call()
        else:
            self.missed += 1 + self._advance().missed
        self._arm()

    def _before_jump(self, jump: TimeJump) -> None:
        if jump.source_changed:
            self._rule.before_source_change(self._clock.now_ns())

    def _after_jump(self, jump: TimeJump) -> None:
        if jump.source_changed:
            self._rule.after_source_change(self._clock.now_ns())
        else:
            self._rule.after_jump(self._clock.now_ns())
        self._scope.bridge.call_soon(self._arm)

    # -------------------------------------------------------------------------------------------------------- state

    @property
    def period(self) -> Duration:
        """Time between two calls."""
        return Duration(nanoseconds=self._rule.period_ns)

    def change_period(self, period_s: float) -> None:
        """Use another period from the next call on; the call already due stays where it is.

        Raises:
            TypeError: no number. TimeRangeError: negative or not finite.
        """
        self._rule.change_period(period_to_ns(period_s))
        self._scope.bridge.call_soon(self._arm)

    @property
    def is_canceled(self) -> bool:
        """True between `cancel` and `reset`."""
        return self._rule.canceled

    @property
    def is_ready(self) -> bool:
        """True when a call is due."""
        return self._rule.is_ready(self._clock.now_ns())

    def time_until_next_call(self) -> Duration | None:
        """Negative when overdue; None while canceled, or while simulated time has not begun."""
        left_ns = self._rule.time_until_ns(self._clock.now_ns())
        return None if left_ns is None else Duration(nanoseconds=left_ns)

    def cancel(self) -> None:
        """Stop until `reset`; whoever waits for a tick keeps waiting."""
        self._rule.cancel()
        self._scope.bridge.call_soon(self._arm)

    def reset(self) -> None:
        """Start a period now; ends a cancellation.

        Raises:
            ClosedError: the timer or its node is closed.
        """
        self._scope.require_open(self._closed, "a timer")
        now_ns = self._clock.now_ns()
        with self._rule_lock:
            self._rule.reset(now_ns)
        self._scope.bridge.call_soon(self._arm)

    def __repr__(self) -> str:
        parts = f"{self._rule.period_ns / NS_PER_S:g} s", self._clock.clock_type.name, *["canceled"] * self.is_canceled
        return shown(self, *parts, peers=lambda: self.call_count, peer="call")

    def close(self) -> None:
        """Stop for ever; whoever waits for a tick gets `ClosedError`. May be called twice."""
        if not self._ends():
            return
        self._starts.close()
        if self._callback is not None:
            self._callback.close()
        self._jumps.close()
        bridge = self._scope.bridge
        if bridge.is_running and not bridge.in_loop_thread():
            bridge.call_soon(self._end)
        else:
            self._end()

    def _end(self) -> None:
        """What `close` has to do on the loop."""
        if self._handle is not None:
            self._handle.cancel()
            self._handle = None
        self._waiters.wake()
