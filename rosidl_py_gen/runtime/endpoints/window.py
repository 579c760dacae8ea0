"""When a request may be sent to servers that keep few of them.

A ROS server keeps the last 10 requests and overwrites older ones without a word: their calls would never be answered.
So the clients of a service send them in bursts of what the server keeps. The next burst begins when the last one is
answered, or after a pause: handlers may take any time, and more than that many calls may be under way.
"""

from __future__ import annotations

import asyncio
import weakref
from collections import deque
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.loop.callbacks import current_loop

if TYPE_CHECKING:
    from collections.abc import Callable


class RequestWindow:
    """Shared by all clients of one service in one context; first come, first served."""

    def __init__(self, pause_s: float) -> None:
        self._pause_s = pause_s
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waiting: deque[Callable[[], bool]] = deque()
        self._begun_s = 0.0
        self._sent = 0
        self._unanswered = 0
        self._kept = 1
        self._timer: asyncio.TimerHandle | None = None

    def enter(self, send: Callable[[], bool], kept: int) -> None:
        """Call `send` as soon as one more request may be sent, perhaps at once; on the loop's thread.

        Args:
            send: answers False when nobody wants its request any more, which then takes nobody's place. After True
                `leave` has to be called, once the request is answered or given up.
            kept: how many requests the server keeps.
        """
        loop = asyncio.get_running_loop()
        if loop is not self._loop:  # what waited on another loop waits no more
            self._loop, self._waiting, self._unanswered, self._timer = loop, deque(), 0, None
        self._kept = kept
        self._waiting.append(send)
        if len(self._waiting) == 1:
            self._send(may_begin=self._unanswered <= 0 or loop.time() >= self._begun_s + self._pause_s)

    def leave(self) -> None:
        """A request that was sent is answered or given up."""
        self._unanswered -= 1
        if self._unanswered <= 0 and self._waiting and self._loop is current_loop():
            self._send(may_begin=True)

    def _send(self, *, may_begin: bool) -> None:
        """Send what fits into this burst, or into a new one; come back when another one may begin."""
        assert self._loop is not None
        if may_begin:
            self._begun_s, self._sent = self._loop.time(), 0
        while self._waiting and self._sent < self._kept:
            self._sent += 1
            self._unanswered += 1
            if not self._waiting.popleft()():
                self._sent -= 1
                self._unanswered -= 1
        if self._timer is not None:
            self._timer.cancel()
        due_s = self._begun_s + self._pause_s
        self._timer = self._loop.call_at(due_s, lambda: self._send(may_begin=True)) if self._waiting else None


class RequestWindows:
    """Those of one context, by request topic."""

    def __init__(self) -> None:
        self._windows: weakref.WeakValueDictionary[str, RequestWindow] = weakref.WeakValueDictionary()

    def of(self, request_topic: str, pause_s: float) -> RequestWindow:
        """The one window of a service; `pause_s` counts for the first client."""
        return self._windows.setdefault(request_topic, RequestWindow(pause_s))
