"""Queue that is read with ``async for``, and queues of samples that are sent later.

Samples are sent later because DDS did not accept them, or because a reply must be sent first.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.base.waiters import Waiters, current_loop
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding

T = TypeVar("T")


class AsyncQueue(Generic[T]):
    """Queue of at most `depth` items; None: of any number. Thread: any, except for iterating.

    A full queue drops its oldest item. Items are delivered even after `close`. Several readers share the items.
    Iterating has no blocking form, because items arrive on the event loop; `take` reads without waiting.
    """

    def __init__(self, depth: int | None = None) -> None:
        self._items: deque[T] = deque(maxlen=depth)
        self._waiters = Waiters()
        self._error: BaseException | None = None
        self.closed: bool = False
        """True after `close`; remaining items can still be read."""
        self.dropped: int = 0
        """Number of items that were dropped because the queue was full."""

    def _push(self, item: T) -> None:
        """Add an item; a full queue drops its oldest item. After `close` the item is ignored."""
        if self.closed:
            return
        if len(self._items) == self._items.maxlen:
            self.dropped += 1
        self._items.append(item)
        self._waiters.wake()

    @property
    def waiting(self) -> int:
        """Number of items that can be read without waiting."""
        return len(self._items)

    def take(self) -> T | None:
        """Return the oldest item without waiting; None if there is none."""
        with contextlib.suppress(IndexError):
            return self._items.popleft()
        return None

    def close(self, error: BaseException | None = None) -> None:
        """Close the queue: the iteration ends after the remaining items, or raises `error` then, if an
        error is given.
        """
        if not self.closed:
            self._error = error
            self.closed = True
            self._waiters.wake()

    def __aiter__(self) -> AsyncQueue[T]:
        return self

    async def __anext__(self) -> T:
        while True:
            with contextlib.suppress(IndexError):
                return self._items.popleft()
            if self.closed:
                raise self._error or StopAsyncIteration
            await self._waiters.wait(lambda: self._items or self.closed)


RETRY_INTERVAL_S = 0.001
"""Interval of retries while DDS does not accept a sample, in seconds."""


class SendQueue:
    """Queue of samples that DDS did not accept, because a reliable reader is too slow and writes never block.

    Writing is retried on the event loop until DDS accepts the sample. A full queue drops its oldest sample and counts
    it. Thread: any.

    Args:
        depth: maximum number of waiting samples; None: any number.
        report: logs the exception being handled, which a retry has raised; the sample is dropped.

    Attributes:
        waiting: functions that write a sample, and return False while DDS does not accept it.
    """

    def __init__(self, loop_binding: LoopBinding, depth: int | None, report: Callable[[str], None]) -> None:
        self.waiting: deque[Callable[[], bool]] = deque(maxlen=depth)
        self.dropped = 0
        self._loop_binding = loop_binding
        self._report = report
        # Reentrant, because a signal handler may publish or close during a write in the same thread.
        self._lock = threading.RLock()
        self._retrying_on: asyncio.AbstractEventLoop | None = None

    def send(self, write: Callable[[], bool]) -> None:
        """Send a sample by calling `write`, which returns False while DDS does not accept the sample.

        If samples are waiting, or DDS does not accept the sample, it is queued. An exception of `write` is raised only
        if `write` is called at once.
        """
        if not self.waiting and write():
            return
        with self._lock:
            self.dropped += len(self.waiting) == self.waiting.maxlen
            self.waiting.append(write)
        if self._retrying_on is not self._loop_binding.loop:
            self._loop_binding.call_soon(self._retry)

    def flush(self) -> bool:
        """Send waiting samples until DDS does not accept one; return True if no sample is waiting any more."""
        with self._lock:
            while self.waiting:
                write = self.waiting[0]
                try:
                    if not write():
                        return False
                except RosidlError:
                    self._report("sending a delayed sample")
                    self.dropped += 1
                if self.waiting and self.waiting[0] is write:
                    self.waiting.popleft()
        return True

    def _retry(self) -> None:
        loop = self._loop_binding.loop
        self._retrying_on = None
        if loop is not None and not self.flush():
            self._retrying_on = loop
            loop.call_later(RETRY_INTERVAL_S, self._retry)

    def close(self) -> None:
        """Drop all waiting samples."""
        with self._lock:
            self.waiting.clear()


class DeferredSender(Generic[T]):
    """Queue that passes its items to `send` in the loop's next iteration, or at once if they are added outside the
    loop.

    So a reply that a callback on the loop is sending precedes the items. Items keep their order. `send` must not raise.
    """

    def __init__(self, loop_binding: LoopBinding, send: Callable[[T], None]) -> None:
        self._loop_binding = loop_binding
        self._send = send
        self._waiting: deque[T] = deque()
        self._lock = threading.RLock()

    def add(self, item: T) -> None:
        """Add an item. Thread: any."""
        self._waiting.append(item)
        loop = current_loop()
        if loop is not None and loop is self._loop_binding.bound_loop:
            loop.call_soon(self.flush)
        else:
            self.flush()

    def flush(self) -> None:
        """Send all waiting items now, in their order."""
        with self._lock:
            while self._waiting:
                self._send(self._waiting.popleft())

    close = flush
    """Send all waiting items when the sender is closed. The writer still exists then, as it was created before and is
    closed later."""
