"""Samples that DDS did not take at once, in order.

A write never blocks: DDS says no when a reliable reader is too far behind. Decides what happens then: the sample waits,
and is tried again on the event loop until it is taken. A queue that is full drops its oldest sample and counts it. Any
thread may send and flush.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding

RETRY_INTERVAL_S = 0.001


class SendQueue:
    """What stands between one endpoint and its writer."""

    def __init__(self, bridge: LoopBinding, depth: int | None, report: Callable[[str], None]) -> None:
        """`report` logs the exception of a sample that had to wait and then could not be sent."""
        self.waiting: deque[Callable[[], bool]] = deque(maxlen=depth)
        """Functions that write, and answer False while DDS wants them to wait."""
        self.dropped = 0
        self._bridge = bridge
        self._report = report
        # A signal handler may publish or close in the middle of a write, in the same thread.
        self._lock = threading.RLock()
        self._retrying_on: asyncio.AbstractEventLoop | None = None

    def send(self, write: Callable[[], bool]) -> None:
        """Call `write` now, or behind all that is waiting; returns at once. Raises what the first try raises."""
        if not self.waiting and write():
            return
        with self._lock:
            self.dropped += len(self.waiting) == self.waiting.maxlen
            self.waiting.append(write)
        if self._retrying_on is not self._bridge.loop:
            self._bridge.call_soon(self._retry)

    def flush(self) -> bool:
        """Send what DDS takes; whether nothing is waiting any more."""
        with self._lock:
            while self.waiting:
                write = self.waiting[0]
                try:
                    if not write():
                        return False
                except RosidlError:
                    self._report("sending what had to wait")
                    self.dropped += 1
                if self.waiting and self.waiting[0] is write:
                    self.waiting.popleft()
        return True

    def _retry(self) -> None:
        loop = self._bridge.loop
        self._retrying_on = None
        if loop is not None and not self.flush():
            self._retrying_on = loop
            loop.call_later(RETRY_INTERVAL_S, self._retry)

    def close(self) -> None:
        """Forget what is waiting."""
        with self._lock:
            self.waiting.clear()
