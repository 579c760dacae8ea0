"""Sender that waits for the loop's next iteration, so that a reply that is being sent goes first."""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding

T = TypeVar("T")


class DeferredSender(Generic[T]):
    """Passes items to `send`, which must not raise, in the loop's next iteration, or at once outside of the loop.

    Items keep their order.
    """

    def __init__(self, loop_binding: LoopBinding, send: Callable[[T], None]) -> None:
        self._loop_binding = loop_binding
        self._send = send
        self._waiting: deque[T] = deque()
        self._lock = threading.RLock()

    def add(self, item: T) -> None:
        """Add an item. Thread: any."""
        self._waiting.append(item)
        if self._loop_binding.in_loop_thread():
            self._loop_binding.call_soon(self.flush)
        else:
            self.flush()

    def flush(self) -> None:
        """Send all waiting items."""
        with self._lock:
            while self._waiting:
                self._send(self._waiting.popleft())

    close = flush
    """Send all waiting items; the writer is older, so it is still open."""
