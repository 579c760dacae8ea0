"""Requests that wait for their turn, because the server keeps few of them.

A ROS server keeps the last 10 requests and overwrites older ones without a word: their calls would never be answered.
So the clients of a service send them in bursts of what the server keeps. The next burst begins when the last one is
answered, or after a pause: handlers may take any time, and more than that many calls may be under way.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any

from rosidl_py_gen.runtime.loop.bridge import current_loop

_PAUSE_S = 0.1


class RequestLine:
    """The waiting calls of all clients of one service in one context, first come, first served."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._line: deque[asyncio.Future[None]] = deque()
        self._begun_s = 0.0
        self._sent = 0
        self._open = 0
        self._burst = 1
        self._timer: asyncio.TimerHandle | None = None

    async def take_turn(self, call: asyncio.Future[Any], burst: int) -> bool:
        """Wait until one more request may be sent, or until `call` is done.

        Args:
            call: done when its time is over; it waits no longer then.
            burst: how many requests the server keeps.

        Returns:
            Whether it is its turn: `over` has to be called then, once the call is answered or given up.
        """
        loop = asyncio.get_running_loop()
        if loop is not self._loop:  # what waited on another loop waits no more
            self._loop, self._line, self._open, self._timer = loop, deque(), 0, None
        self._burst = burst
        now_s = loop.time()
        if not self._line:
            if self._open <= 0 or now_s >= self._begun_s + _PAUSE_S:
                self._begun_s, self._sent = now_s, 0
            if self._sent < burst:
                self._sent += 1
                self._open += 1
                return True
        turn: asyncio.Future[None] = loop.create_future()
        self._line.append(turn)
        if self._timer is None:
            self._timer = loop.call_later(self._begun_s + _PAUSE_S - now_s, self._release)
        try:
            await asyncio.wait((turn, call), return_when=asyncio.FIRST_COMPLETED)
        except asyncio.CancelledError:
            if turn.done():
                self.over()
            raise
        finally:
            waited = not turn.done()
            turn.cancel()  # one that is not needed any more takes nobody's place
        return not waited

    def over(self) -> None:
        """A call that had its turn is answered or given up."""
        self._open -= 1
        if self._open <= 0 and self._line and self._loop is current_loop():
            self._release()

    def _release(self) -> None:
        assert self._loop is not None
        if self._timer is not None:
            self._timer.cancel()
        self._begun_s, self._sent = self._loop.time(), 0
        while self._line and self._sent < self._burst:
            turn = self._line.popleft()
            if not turn.done():
                turn.set_result(None)
                self._sent += 1
                self._open += 1
        self._timer = self._loop.call_later(_PAUSE_S, self._release) if self._line else None
