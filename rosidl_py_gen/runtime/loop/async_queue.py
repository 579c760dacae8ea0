"""Queue that is read with ``async for``, and that can be closed."""

from __future__ import annotations

import contextlib
from collections import deque
from typing import Generic, TypeVar

from rosidl_py_gen.base.waiters import Waiters

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
