"""A queue that is read with ``async for`` and can end.

Decides that what was pushed before `close` is still delivered, that a full queue drops its oldest item and counts it,
and that several readers share the items. Readers belong to one event loop; any thread may push and close.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from typing import Generic, TypeVar

from rosidl_py_gen.runtime.loop.bridge import current_loop

T = TypeVar("T")


class Stream(Generic[T]):
    """Items in order of arrival; `depth` None keeps all."""

    def __init__(self, depth: int | None = None) -> None:
        self._items: deque[T] = deque(maxlen=depth)
        self._waiters: list[asyncio.Future[None]] = []
        self._error: BaseException | None = None
        self.closed = False
        self.dropped = 0
        """How many items were pushed out by newer ones."""

    @property
    def has_reader(self) -> bool:
        """True while somebody waits for the next item."""
        return bool(self._waiters)

    def push(self, item: T) -> None:
        """Add an item, from any thread; ignored after `close`."""
        if self.closed:
            return
        if len(self._items) == self._items.maxlen:
            self.dropped += 1
        self._items.append(item)
        self._wake()

    def close(self, error: BaseException | None = None) -> None:
        """End the stream once it is drained; with an error, readers get that instead of a plain end. Any thread may."""
        if not self.closed:
            self._error = error
            self.closed = True
            self._wake()

    def _wake(self) -> None:
        if not self._waiters:
            return
        waiters, self._waiters = self._waiters, []
        here = current_loop()
        for waiter in waiters:
            loop = waiter.get_loop()
            if loop is here:
                _complete(waiter)
            else:
                with contextlib.suppress(RuntimeError):  # the loop was closed, and its reader with it
                    loop.call_soon_threadsafe(_complete, waiter)

    def __aiter__(self) -> Stream[T]:
        return self

    async def __anext__(self) -> T:
        while not self._items:
            if self.closed:
                if self._error is not None:
                    raise self._error
                raise StopAsyncIteration
            waiter: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            self._waiters.append(waiter)
            try:
                # Another thread may have pushed between the look above and the wait; it saw no waiter then.
                if not self._items and not self.closed:
                    await waiter
            finally:
                if waiter in self._waiters:
                    self._waiters.remove(waiter)
        return self._items.popleft()


def _complete(waiter: asyncio.Future[None]) -> None:
    if not waiter.done():
        waiter.set_result(None)
