"""An event loop that takes in what arrives while it still waits.

With `add_reader` the loop comes round once more before a task sees what a descriptor brought: one round finds it
readable and completes a future, the next one runs the task. Here the selector calls a function for a descriptor, before
asyncio looks what there is to do, and the task runs in the same round. The callback of `add_reader` follows, as an
ordinary one, if the function left something to do for it.

Decides that this is no other loop but asyncio's own, with a selector of ours handed to its constructor. The selector
waits in an epoll of its own for these descriptors and for the epoll of `selectors`, which has all others: both are
looked at each time, so that neither can keep the other waiting. Where there is no epoll, `add_reader` has to do.
"""

from __future__ import annotations

import asyncio
import select
import selectors
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

_MAX_EVENTS = 16
"""At a time; the kernel hands out those that did not fit first the next time."""


def new_event_loop() -> asyncio.AbstractEventLoop:
    """A new event loop: what `asyncio.new_event_loop` makes, but on Linux one that brings what arrives to tasks sooner
    in place of asyncio's own.

    `run` uses it; ``asyncio.Runner(loop_factory=new_event_loop)`` and test frameworks can, too.
    """
    loop = asyncio.new_event_loop()
    if sys.platform == "linux" and type(loop) is asyncio.SelectorEventLoop:
        loop.close()
        return EventLoop()
    return loop


def end_tasks(loop: asyncio.AbstractEventLoop) -> set[asyncio.Task[Any]]:
    """Cancel what is left of a loop that does not run, wait for it, and return it."""
    tasks = asyncio.all_tasks(loop)
    for task in tasks:
        task.cancel()
    if tasks:
        loop.run_until_complete(asyncio.wait(tasks))
    return tasks


class EventLoop(asyncio.SelectorEventLoop):
    """asyncio's event loop with one method more; on Linux only."""

    def __init__(self, selector: PriorityReaderSelector | None = None) -> None:
        self._watching = PriorityReaderSelector() if selector is None else selector
        self._callbacks: dict[int, Callable[[], None]] = {}
        super().__init__(self._watching)

    def add_priority_reader(self, descriptor: int, early: Callable[[], bool], callback: Callable[[], None]) -> None:
        """Call `early` while `descriptor` is readable, before the callbacks of the same round; it must not raise.
        `callback` is one of them when that answers True.
        """
        self._watching.functions[descriptor] = early
        self._callbacks[descriptor] = callback
        self.add_reader(descriptor, callback)

    def remove_priority_reader(self, descriptor: int) -> None:
        """Undo `add_priority_reader`; without effect when the loop is closed."""
        self._callbacks.pop(descriptor, None)
        self._watching.forget(descriptor)

    def run_priority_readers(self, timeout: float | None) -> bool:
        """Wait, and call the functions of `add_priority_reader`, without a round of the loop; whether it has to make
        one now.
        """
        descriptors = self._watching.select_priority(timeout)
        for descriptor in descriptors:
            if descriptor in self._callbacks:
                self.call_soon(self._callbacks[descriptor])
        return bool(descriptors)


class PriorityReaderSelector(selectors.DefaultSelector):
    """Calls functions for some descriptors, and tells asyncio of the others."""

    def __init__(self) -> None:
        super().__init__()
        self._epoll = select.epoll()
        self._epoll.register(self.fileno(), select.EPOLLIN)
        self._poll = self._epoll.poll
        self._keys: dict[int, selectors.SelectorKey] = {}
        self.functions: dict[int, Callable[[], bool]] = {}
        """What to call first, by descriptor; those that are registered afterwards are looked at here."""

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        if fileobj not in self.functions:
            return super().register(fileobj, events, data)
        self._epoll.register(fileobj, select.EPOLLIN)
        key = self._keys[fileobj] = selectors.SelectorKey(fileobj, fileobj, events, data)
        return key

    def forget(self, descriptor: int) -> None:
        """Undo the registration of one that is looked at here; without effect when it is not (any more)."""
        if self.functions.pop(descriptor, None) is not None:
            del self._keys[descriptor]
            self._epoll.unregister(descriptor)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        events: list[tuple[selectors.SelectorKey, int]] = []
        for descriptor in self.select_priority(timeout):
            if descriptor in self._keys:
                events.append((self._keys[descriptor], selectors.EVENT_READ))
            elif descriptor not in self.functions:
                events += super().select(0)
        return events

    def select_priority(self, timeout: float | None) -> list[int]:
        """Wait, and call functions; the descriptors that asyncio has to be told of."""
        rest: list[int] = []
        for descriptor, _ in self._poll(timeout, _MAX_EVENTS):
            function = self.functions.get(descriptor)
            if function is None or function():
                rest.append(descriptor)
        return rest

    def close(self) -> None:
        self.functions.clear()
        self._keys.clear()
        self._epoll.close()
        super().close()
