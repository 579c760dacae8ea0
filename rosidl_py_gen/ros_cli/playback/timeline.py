"""Time of a recording during playback."""

from __future__ import annotations

import asyncio

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.ros_cli.command_node import now_s


class Timeline:
    """Clock that runs at a rate, pauses and jumps. Thread: loop."""

    def __init__(self, at_ns: int, rate: float, *, is_paused: bool = False) -> None:
        self._at_ns = at_ns
        self._since_s = now_s()
        self.rate = rate
        """Speed; 2.0 is twice as fast."""
        self.is_paused = is_paused
        self._wake_up: asyncio.Future[bool] | None = None
        self._changes = 0

    def now_ns(self) -> int:
        """Return the time of the recording, in nanoseconds."""
        if self.is_paused:
            return self._at_ns
        return self._at_ns + round((now_s() - self._since_s) * self.rate * NS_PER_S)

    def pause(self) -> None:
        """Stop the time."""
        self.jump(self.now_ns())
        self.is_paused = True

    def resume(self) -> None:
        """Continue the time."""
        self.jump(self.now_ns())
        self.is_paused = False

    def set_rate(self, rate: float) -> bool:
        """Set the rate; returns False if it is not a positive number."""
        if not 0 < rate < float("inf"):
            return False
        self.jump(self.now_ns())
        self.rate = rate
        return True

    def jump(self, at_ns: int) -> None:
        """Set the time, and wake up `until`."""
        self._at_ns, self._since_s = at_ns, now_s()
        self.wake()

    def wake(self) -> None:
        """Make `until` return."""
        self._changes += 1
        if self._wake_up is not None and not self._wake_up.done():
            self._wake_up.set_result(False)

    async def until(self, at_ns: int | None) -> bool:
        """Wait for a time, None without end; returns False if the time was changed, so that it must be rechecked."""
        if not self.is_paused and at_ns is not None:
            left_s = self._since_s + (at_ns - self._at_ns) / NS_PER_S / self.rate - now_s()
            if left_s <= 0:
                before = self._changes
                await asyncio.sleep(0)
                return before == self._changes
        else:
            left_s = None
        loop = asyncio.get_running_loop()
        waiting: asyncio.Future[bool] = loop.create_future()
        self._wake_up = waiting
        due = None if left_s is None else loop.call_later(left_s, _set_due, waiting)
        try:
            return await waiting
        finally:
            self._wake_up = None
            if due is not None:
                due.cancel()


def _set_due(waiting: asyncio.Future[bool]) -> None:
    if not waiting.done():
        waiting.set_result(True)
