"""Timers of asyncio nodes."""

from __future__ import annotations

import asyncio
import inspect
from typing import TYPE_CHECKING, Any

from rclpy.executors import await_or_execute
from rclpy.experimental.async_clock import is_source_change, watch_jumps
from rclpy.impl.async_entities import EntityTask
from rclpy.timer import BaseTimer

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.clock import TimeJump
    from rclpy.context import Context
    from rclpy.experimental.async_clock import AsyncClock


class AsyncTimer(BaseTimer):
    """Timer, created by `AsyncNode.create_timer`. The next call is not due before the previous call has ended."""

    def __init__(
        self,
        timer_period_ns: int,
        clock: AsyncClock,
        context: Context,
        callback: Callable[..., Any],
        autostart: bool,
        on_destroy: Callable[[AsyncTimer], None],
        tg: Any = None,
    ) -> None:
        self._rosidl_change = asyncio.Event()
        self._rosidl_loop: asyncio.AbstractEventLoop | None = None
        super().__init__(callback, timer_period_ns, clock, on_destroy=on_destroy, context=context, autostart=autostart)
        self.rosidl_task = EntityTask(self._rosidl_run, self.destroy, tg)

    @property
    def callback(self) -> Callable[..., Any]:
        """Function, plain or async, that the timer calls: it takes no argument or a `TimerInfo`."""
        return self._rosidl_callback

    @callback.setter
    def callback(self, callback: Callable[..., Any]) -> None:
        for arguments in ((), (object(),)):
            try:
                inspect.signature(callback).bind(*arguments)
            except TypeError:
                continue
            self._rosidl_callback, self._rosidl_takes_info = callback, bool(arguments)
            return
        raise RuntimeError("Timer callback must accept zero arguments or one argument (TimerInfo)")

    def destroy(self) -> None:
        """Destroy the timer, and cancel the running callback."""
        self.rosidl_task.cancel()
        super().destroy()

    def cancel(self) -> None:
        super().cancel()
        self._rosidl_notify()

    def reset(self) -> None:
        super().reset()
        self._rosidl_notify()

    def _rosidl_notify(self) -> None:
        """Make the task of the timer check again when the timer is due, because the schedule has changed.

        Thread: any.
        """
        loop = self._rosidl_loop
        if loop is None or loop is asyncio._get_running_loop():
            self._rosidl_change.set()
        elif not loop.is_closed():
            loop.call_soon_threadsafe(self._rosidl_change.set)

    def _rosidl_on_jump(self, jump: TimeJump) -> None:
        if is_source_change(jump) or self.is_ready():
            self._rosidl_notify()

    async def _rosidl_run(self) -> None:
        self._rosidl_loop = asyncio.get_running_loop()
        with watch_jumps(self.clock, self._rosidl_on_jump):
            while self.handle.is_valid:
                self._rosidl_change.clear()
                if self.is_ready():
                    await self._rosidl_call()
                    await asyncio.sleep(0)  # other tasks run, also if the period is shorter than the callback
                else:
                    await self._rosidl_wait()

    async def _rosidl_wait(self) -> None:
        """Wait until the timer is due, or a change requires a new check."""
        remaining_ns = self.time_until_next_call()
        timeout_s = None if remaining_ns is None or self.clock.ros_time_is_active else max(0, remaining_ns) / 1e9
        change = self._rosidl_change
        alarm = None if timeout_s is None else asyncio.get_running_loop().call_later(timeout_s, change.set)
        try:
            await change.wait()
        finally:
            if alarm is not None:
                alarm.cancel()

    async def _rosidl_call(self) -> None:
        with self.handle as handle:
            times_ns = handle.call_timer()
        await await_or_execute(self.callback, *([self._rosidl_info(*times_ns)] if self._rosidl_takes_info else []))
