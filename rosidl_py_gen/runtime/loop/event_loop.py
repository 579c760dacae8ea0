"""asyncio's event loop with priority descriptors, whose functions its selector calls inside `select`; Linux only.

With `add_reader`, one iteration of the loop finds a descriptor readable and completes a future, and only the next one
runs the waiting task. Functions of priority descriptors are called inside `select`, before asyncio collects its
callbacks, so that the task runs in the same iteration. The ordinary callback of a descriptor follows only if its
function returns True.

The selector has its own epoll with the priority descriptors and, nested in it, the epoll of `selectors`, which has all
others. Both are polled at each select, so neither can starve the other.
"""

from __future__ import annotations

import asyncio
import select
import selectors
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

MAX_EVENTS = 16
"""Maximum number of events that one poll returns; the kernel returns the remaining events first at the next poll."""


def new_event_loop() -> asyncio.AbstractEventLoop:
    """Create the loop of `asyncio.new_event_loop`.

    On Linux, create a faster `EventLoop` in place of asyncio's own loop. The function `run` uses such a loop. Other
    programs and test frameworks can use it by ``asyncio.Runner(loop_factory=new_event_loop)``.
    """
    loop = asyncio.new_event_loop()
    if sys.platform == "linux" and type(loop) is asyncio.SelectorEventLoop:
        loop.close()
        return EventLoop()
    return loop


def end_tasks(loop: asyncio.AbstractEventLoop) -> set[asyncio.Task[Any]]:
    """Cancel all tasks of a loop that does not run, run the tasks to their end, and return them."""
    tasks = asyncio.all_tasks(loop)
    for task in tasks:
        task.cancel()
    if tasks:
        loop.run_until_complete(asyncio.wait(tasks))
    return tasks


class EventLoop(asyncio.SelectorEventLoop):
    """asyncio's event loop extended by priority readers: functions that its selector calls immediately when a
    descriptor is readable.
    """

    def __init__(self, selector: PriorityReaderSelector | None = None) -> None:
        self._priority_selector = PriorityReaderSelector() if selector is None else selector
        self._callbacks: dict[int, Callable[[], None]] = {}
        super().__init__(self._priority_selector)

    def add_priority_reader(self, descriptor: int, early: Callable[[], bool], callback: Callable[[], None]) -> None:
        """Call `early` inside `select` whenever `descriptor` is readable; if it returns True, call `callback` later.

        `early` must not raise.
        """
        self._priority_selector.functions[descriptor] = early
        self._callbacks[descriptor] = callback
        self.add_reader(descriptor, callback)

    def remove_priority_reader(self, descriptor: int) -> None:
        """Stop watching a descriptor that was passed to `add_priority_reader`; without effect if the loop is closed."""
        self._callbacks.pop(descriptor, None)
        self._priority_selector.unregister_priority(descriptor)

    def run_priority_readers(self, timeout: float | None) -> bool:
        """Wait for events and call the priority readers, without an iteration of the loop.

        Returns:
            True if an iteration of the loop is necessary.
        """
        descriptors = self._priority_selector.select_priority(timeout)
        for descriptor in descriptors:
            if descriptor in self._callbacks:
                self.call_soon(self._callbacks[descriptor])
        return bool(descriptors)


class PriorityReaderSelector(selectors.DefaultSelector):
    """Selector that calls the functions of priority descriptors, and returns the events of all others.

    Attributes:
        functions: function of each priority descriptor, which must be set before the descriptor is registered.
    """

    def __init__(self) -> None:
        super().__init__()
        self._epoll = select.epoll()
        self._epoll.register(self.fileno(), select.EPOLLIN)
        self._poll = self._epoll.poll
        self._keys: dict[int, selectors.SelectorKey] = {}
        self.functions: dict[int, Callable[[], bool]] = {}

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        if fileobj not in self.functions:
            return super().register(fileobj, events, data)
        self._epoll.register(fileobj, select.EPOLLIN)
        key = self._keys[fileobj] = selectors.SelectorKey(fileobj, fileobj, events, data)
        return key

    def unregister_priority(self, descriptor: int) -> None:
        """Unregister a priority descriptor; without effect for other descriptors."""
        if self.functions.pop(descriptor, None) is not None:
            del self._keys[descriptor]
            self._epoll.unregister(descriptor)

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        events: list[tuple[selectors.SelectorKey, int]] = []
        has_ordinary = False
        # `select_priority`, without the call and the list: this is the way of each message.
        for descriptor, _ in self._poll(timeout, MAX_EVENTS):
            function = self.functions.get(descriptor)
            if function is None:
                has_ordinary = True
            elif function() and descriptor in self._keys:
                events.append((self._keys[descriptor], selectors.EVENT_READ))
        return events + super().select(0) if has_ordinary else events

    def select_priority(self, timeout: float | None) -> list[int]:
        """Wait for events and call the functions of readable priority descriptors.

        Returns:
            The descriptors that need an iteration of the loop: ordinary ones, and those whose function returned True.
        """
        remaining: list[int] = []
        for descriptor, _ in self._poll(timeout, MAX_EVENTS):
            function = self.functions.get(descriptor)
            if function is None or function():
                remaining.append(descriptor)
        return remaining

    def close(self) -> None:
        self.functions.clear()
        self._keys.clear()
        self._epoll.close()
        super().close()
