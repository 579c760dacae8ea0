"""An event loop that takes in what arrives while it still waits.

With `add_reader` the loop comes round once more before a task sees what a descriptor brought: one round finds it
readable and completes a future, the next one runs the task. Here the function of a descriptor is called by the
selector, before asyncio looks what there is to do, and the task runs in the same round.

Decides that this is no other loop but asyncio's own, with a selector of ours handed to its constructor. The selector
waits in an epoll of its own for these descriptors and for the epoll of `selectors`, which has all others: both are
looked at each time, so that neither can keep the other waiting. Where there is no epoll, `add_reader` has to do.
"""

from __future__ import annotations

import asyncio
import select
import selectors
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_MOST_EVENTS = 16
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


class EventLoop(asyncio.SelectorEventLoop):
    """asyncio's event loop with one method more; on Linux only."""

    def __init__(self) -> None:
        self._watching = _Selector()
        super().__init__(self._watching)

    def watch(self, descriptor: int, function: Callable[[], None]) -> None:
        """Call `function` while `descriptor` is readable, before the callbacks of the same round; it must not raise."""
        self._watching.watch(descriptor, function)

    def unwatch(self, descriptor: int) -> None:
        """Undo `watch`; without effect when the loop is closed."""
        self._watching.unwatch(descriptor)


class _Selector(selectors.DefaultSelector):
    """Calls functions for some descriptors, and tells asyncio of the others."""

    def __init__(self) -> None:
        super().__init__()
        self._epoll = select.epoll()
        self._epoll.register(self.fileno(), select.EPOLLIN)
        self._functions: dict[int, Callable[[], None]] = {}

    def watch(self, descriptor: int, function: Callable[[], None]) -> None:
        self._epoll.register(descriptor, select.EPOLLIN)
        self._functions[descriptor] = function

    def unwatch(self, descriptor: int) -> None:
        if self._functions.pop(descriptor, None) is not None:
            self._epoll.unregister(descriptor)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        events: list[tuple[selectors.SelectorKey, int]] = []
        for descriptor, _ in self._epoll.poll(timeout, _MOST_EVENTS):
            function = self._functions.get(descriptor)
            if function is None:
                events += super().select(0)
            else:
                function()
        return events

    def close(self) -> None:
        self._functions.clear()
        self._epoll.close()
        super().close()
