"""Clocks of asyncio nodes."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from rclpy.clock import BaseClock, ClockChange, JumpThreshold
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.exceptions import TimeSourceChangedError

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.clock import JumpHandle, TimeJump
    from rclpy.time import Time

_SOURCE_CHANGES = (ClockChange.ROS_TIME_ACTIVATED, ClockChange.ROS_TIME_DEACTIVATED)


def watch_jumps(clock: BaseClock, on_jump: Callable[[TimeJump], None]) -> JumpHandle:
    """Call a function after each jump forward and each change of the source of time, until the returned handle is
    unregistered.
    """
    threshold = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None, on_clock_change=True)
    return clock.create_jump_callback(threshold, post_callback=on_jump)


def is_source_change(jump: TimeJump) -> bool:
    """Return True if a jump means that simulated time started or stopped."""
    return jump.clock_change in _SOURCE_CHANGES


class AsyncClock(BaseClock):
    """Clock that coroutines can sleep by; it reads simulated time while that is active."""

    def __init__(self, *, clock_type: ClockType = ClockType.SYSTEM_TIME) -> None:
        super().__init__(clock_type=clock_type)
        self._rosidl_sleeps: dict[asyncio.Future[None], Time | None] = {}
        self._rosidl_is_destroyed = False
        self._rosidl_jump_handle = watch_jumps(self, self._rosidl_on_jump)

    def _rosidl_on_jump(self, jump: TimeJump) -> None:
        is_change = is_source_change(jump)
        now = None if is_change else self.now()
        for future, end in tuple(self._rosidl_sleeps.items()):
            if is_change:
                _call_in_loop(future, _reject)
            elif end is not None and now is not None and now >= end:
                _call_in_loop(future, _resolve)

    def rosidl_destroy_clock(self) -> None:
        """Cancel all sleeps of the clock, and refuse new sleeps."""
        if self._rosidl_is_destroyed:
            return
        self._rosidl_is_destroyed = True
        self._rosidl_jump_handle.unregister()
        for future in tuple(self._rosidl_sleeps):
            future.cancel()
        self.handle.destroy_when_not_in_use()

    async def sleep(self, duration_sec: float) -> None:
        """Sleep for a number of seconds of the clock.

        Raises:
            TimeSourceChangedError: simulated time started or stopped.
            asyncio.CancelledError: the node was destroyed during the sleep.
            RuntimeError: the node was destroyed before.
        """
        if self._rosidl_is_destroyed:
            raise RuntimeError("Cannot sleep on a destroyed clock")
        duration = Duration(seconds=duration_sec)
        if duration.nanoseconds <= 0:
            await asyncio.sleep(0)
            return
        loop = asyncio.get_running_loop()
        future: asyncio.Future[None] = loop.create_future()
        timer: asyncio.TimerHandle | None = None
        end: Time | None = None
        if self.clock_type == ClockType.ROS_TIME and self.ros_time_is_active:
            end = self.now() + duration
        else:
            timer = loop.call_later(duration_sec, _resolve, future)
        self._rosidl_sleeps[future] = end
        try:
            await future
        finally:
            del self._rosidl_sleeps[future]
            if timer is not None:
                timer.cancel()


def _call_in_loop(future: asyncio.Future[None], function: Callable[[asyncio.Future[None]], None]) -> None:
    """Call a function with a future in the thread of the future's event loop, because another thread may have changed
    the time.
    """
    loop = future.get_loop()
    if loop is asyncio._get_running_loop():
        function(future)
    elif not loop.is_closed():
        loop.call_soon_threadsafe(function, future)


def _resolve(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)


def _reject(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_exception(TimeSourceChangedError())
