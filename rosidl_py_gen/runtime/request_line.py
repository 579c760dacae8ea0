"""Requests that wait for their turn, because the server keeps few of them.

A ROS server keeps the last 10 requests and overwrites older ones without a word: their calls would never be answered.
So a client sends them in bursts of what the server keeps, with a pause in between that a server needs to take them.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any

_PAUSE_S = 0.01


class RequestLine:
    """The waiting calls of one client, first come, first served."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._line: deque[asyncio.Future[None]] = deque()
        self._begun_s = 0.0
        self._sent = 0
        self._releasing = False

    async def take_turn(self, call: asyncio.Future[Any], burst: int, *, alone: bool) -> None:
        """Wait until one more request may be sent, or until `call` is done.

        Args:
            call: done when its time is over; it waits no longer then.
            burst: how many requests the server keeps.
            alone: no other call is under way, so the server has none to lose.
        """
        loop = asyncio.get_running_loop()
        if loop is not self._loop:  # what waited on another loop waits no more
            self._loop, self._line, self._releasing = loop, deque(), False
        now_s = loop.time()
        if not self._line:
            if alone or now_s >= self._begun_s + _PAUSE_S:
                self._begun_s, self._sent = now_s, 0
            if self._sent < burst:
                self._sent += 1
                return
        turn: asyncio.Future[None] = loop.create_future()
        self._line.append(turn)
        if not self._releasing:
            self._releasing = True
            loop.call_later(self._begun_s + _PAUSE_S - now_s, self._release, burst)
        try:
            await asyncio.wait((turn, call), return_when=asyncio.FIRST_COMPLETED)
        finally:
            turn.cancel()  # one that is not needed any more takes nobody's place

    def _release(self, burst: int) -> None:
        assert self._loop is not None
        self._begun_s, self._sent = self._loop.time(), 0
        while self._line and self._sent < burst:
            turn = self._line.popleft()
            if not turn.done():
                turn.set_result(None)
                self._sent += 1
        self._releasing = bool(self._line)
        if self._releasing:
            self._loop.call_later(_PAUSE_S, self._release, burst)
