"""What has to be sent behind the answer to a request.

Decides that it is sent when the loop comes round, which is after what it is doing just now; nobody waits for it then.
Where no loop runs it is sent at once. Items keep their order, whatever threads add them.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding

T = TypeVar("T")


class DeferredSender(Generic[T]):
    """Items that are handed to `send`, which must not raise."""

    def __init__(self, bridge: LoopBinding, send: Callable[[T], None]) -> None:
        self._bridge = bridge
        self._send = send
        self._waiting: deque[T] = deque()
        self._lock = threading.RLock()

    def add(self, item: T) -> None:
        """From any thread."""
        self._waiting.append(item)
        if self._bridge.in_loop_thread():
            self._bridge.call_soon(self.flush)
        else:
            self.flush()

    def flush(self) -> None:
        """Send what waits."""
        with self._lock:
            while self._waiting:
                self._send(self._waiting.popleft())

    close = flush
    """Its owner ends: what waits is sent, through something older that is still open."""
