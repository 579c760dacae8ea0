"""A queue that is read with ``async for`` and can end.

Decides that what was pushed before `close` is still delivered, that a full queue drops its oldest item and counts it,
and that several readers share the items. Any thread may push and close.
"""

from __future__ import annotations

import contextlib
from collections import deque
from typing import Generic, TypeVar

from rosidl_py_gen.base.waiters import Waiters

T = TypeVar("T")


class AsyncQueue(Generic[T]):
    """Items in order of arrival; `depth` None keeps all."""

    def __init__(self, depth: int | None = None) -> None:
        self._items: deque[T] = deque(maxlen=depth)
        self._waiters = Waiters()
        self._error: BaseException | None = None
        self.closed = False
        """True once nothing can be added any more; what is left can still be read."""
        self.dropped = 0
        """How many items were pushed out by newer ones."""

    def _push(self, item: T) -> None:
        """Add an item, from any thread; ignored after `close`."""
        if self.closed:
            return
        if len(self._items) == self._items.maxlen:
            self.dropped += 1
        self._items.append(item)
        self._waiters.wake()

    @property
    def waiting(self) -> int:
        """How many items can be read without waiting."""
        return len(self._items)

    def take(self) -> T | None:
        """The oldest item, without waiting; None when there is none. From any thread."""
        with contextlib.suppress(IndexError):
            return self._items.popleft()
        return None

    def close(self, error: BaseException | None = None) -> None:
        """End the stream once it is drained; with an error, readers get that instead of a plain end. Any thread may."""
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
