"""A request under way, and when it may be sent to servers that keep few of them.

A ROS server keeps the last 10 requests and overwrites older ones without a word: their calls would never be answered.
So the clients of a service send them in bursts of what the server keeps. The next burst begins when the last one is
answered, or after a pause: handlers may take any time, and more than that many calls may be under way.
"""

from __future__ import annotations

import asyncio
import itertools
import weakref
from collections import deque
from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.runtime.loop.callbacks import current_loop

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.loop.time_limits import TimeLimits

ResponseT = TypeVar("ResponseT")

request_numbers = itertools.count(1)
"""Sequence numbers of requests, one counter for the process (protocol.md 5.1)."""


class PendingRequest(Generic[ResponseT]):
    """A request under way.

    Attributes:
        number: the middleware's, when it was sent with an identity.
        limits: what watches its time, if that is limited.
        servers: the endpoints of those that were there when it was sent; before, when it was made.
    """

    __slots__ = (
        *("encoded", "has_turn", "is_sent", "limits", "number", "on_error", "on_reply", "sequence", "servers"),
        "timeout_s",
    )

    def __init__(
        self,
        encoded: bytes,
        on_reply: Callable[[ResponseT, bytes | None], object],
        on_error: Callable[[Exception], object],
        timeout_s: float | None = None,
    ) -> None:
        self.encoded = encoded
        self.timeout_s = timeout_s
        self.on_reply = on_reply
        self.on_error = on_error
        self.sequence = next(request_numbers)
        self.number = 0
        self.has_turn = False
        self.is_sent = False
        self.limits: TimeLimits | None = None
        self.servers: frozenset[bytes] = frozenset()

    def is_lost(self, present: frozenset[bytes]) -> bool:
        """Whether there were servers, and none of these endpoints belongs to one that could answer."""
        return bool(self.servers) and (self.servers.isdisjoint(present) if self.is_sent else not present)


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
