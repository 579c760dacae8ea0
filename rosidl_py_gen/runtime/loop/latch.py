"""Something that happens once, and any number of tasks that wait for it.

Decides what `asyncio.Event` leaves open here: waiters may belong to different loops, may have a timeout that costs no
task, and one whose loop is closed does not break whoever sets the latch.
"""

from __future__ import annotations

import asyncio


class Latch:
    """Set on the loop's thread, or where no loop runs; read from any thread."""

    __slots__ = ("_waiters", "is_set")

    def __init__(self) -> None:
        self.is_set = False
        self._waiters: list[asyncio.Future[None]] = []

    def set(self) -> None:
        """Let it happen; may be called again without effect."""
        self.is_set = True
        waiters, self._waiters = self._waiters, []
        for waiter in waiters:
            _wake(waiter)

    async def wait(self, timeout_s: float | None = None) -> bool:
        """Return when it has happened, or False when the time passed."""
        if self.is_set:
            return True
        loop = asyncio.get_running_loop()
        waiter: asyncio.Future[None] = loop.create_future()
        self._waiters.append(waiter)
        timer = None if timeout_s is None else loop.call_later(max(0.0, timeout_s), _wake, waiter)
        try:
            await waiter
        finally:
            if timer is not None:
                timer.cancel()
            if waiter in self._waiters:
                self._waiters.remove(waiter)
        return self.is_set


def _wake(waiter: asyncio.Future[None]) -> None:
    if not waiter.done() and not waiter.get_loop().is_closed():
        waiter.set_result(None)
