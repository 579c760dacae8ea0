"""asyncio event loops: one with priority descriptors (Linux only), and one for tests, on which waiting takes no time.

With `add_reader`, one iteration of the loop finds a descriptor readable and completes a future, and only the next one
runs the waiting task. Functions of priority descriptors are called inside `select`, before asyncio collects its
callbacks, so that the task runs in the same iteration. The ordinary callback of a descriptor follows only if its
function returns True.

The selector has its own epoll with the priority descriptors and, nested in it, the epoll of `selectors`, which has all
others. Both are polled at each select, so neither can starve the other.

On a `VirtualTimeLoop` time stands still while a callback is ready, and then jumps to the next timer. While other
threads are active, the loop waits in real time. If no event is possible any more, the test fails instead of blocking
forever. It is not for DDS, Zenoh, processes or sockets, whose events need real time.
"""

from __future__ import annotations

import asyncio
import select
import selectors
import sys
import threading
import time
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.transport.api import ClockFunctions

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

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


# --------------------------------------------------------------------------------------------------------- virtual time

T = TypeVar("T")

_THREAD_CHECK_INTERVAL_S = 0.05
"""Interval of checks whether other threads are still active, in seconds of real time."""


class VirtualTimeDeadlockError(RosidlError):
    """Raised if a test waits for an event that cannot happen, or takes more real time than the loop's limit."""


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """Event loop whose time passes only when the loop waits; its `clocks`, for a `MemoryTransport`, show the same time.

    Args:
        limit_s: maximum real time of `run`, in seconds.
    """

    def __init__(self, limit_s: float = 60.0) -> None:
        self._now_s = 0.0
        self._jobs = 0
        self._limit_s = limit_s
        self._end_s = float("inf")
        self._others = set(threading.enumerate())
        super().__init__(_VirtualTimeSelector(self))
        epoch_ns = time.time_ns()
        self.clocks = ClockFunctions(
            lambda: epoch_ns + round(self._now_s * NS_PER_S), lambda: round(self._now_s * NS_PER_S)
        )

    def time(self) -> float:
        """Return the seconds since the loop was created."""
        return self._now_s

    def run(self, main: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine as `asyncio.run` does, and close the loop.

        Raises:
            VirtualTimeDeadlockError: `main` waits for an event that cannot happen, or has not ended after `limit_s`.
        """
        self._end_s = time.monotonic() + self._limit_s
        asyncio.set_event_loop(self)
        try:
            return self.run_until_complete(main)
        finally:
            self._end_s = float("inf")
            try:
                end_tasks(self)
                self.run_until_complete(self.shutdown_asyncgens())
                self.run_until_complete(self.shutdown_default_executor())
            finally:
                asyncio.set_event_loop(None)
                self.close()

    def run_in_executor(self, executor: Any, func: Callable[..., Any], *args: Any) -> asyncio.Future[Any]:  # type: ignore[override]
        """Run a function in a thread of an executor; while it runs, the loop's time is real time."""
        job = super().run_in_executor(executor, func, *args)
        self._jobs += 1

        def on_done(_: asyncio.Future[Any]) -> None:
            self._jobs -= 1

        job.add_done_callback(on_done)
        return job

    def other_threads_active(self) -> bool:
        """Return True if a function of `run_in_executor` runs, or a thread that was started after the loop was created.

        The calling thread and the threads of asyncio's pool do not count.
        """
        current = threading.current_thread()
        return self._jobs > 0 or any(
            thread is not current and not thread.name.startswith("asyncio_")
            for thread in threading.enumerate()
            if thread not in self._others
        )

    def advance_s(self, seconds: float | None, *, waited: bool = False) -> None:
        """Advance the loop's time by `seconds`, the time until the next timer, or None if there is no timer.

        With `waited`, the loop has already waited for `seconds` of real time.

        Raises:
            VirtualTimeDeadlockError: there is no timer, or the limit of real time is over.
        """
        if time.monotonic() > self._end_s:
            self._end_s = float("inf")
            limit = f"{self._limit_s} s of real time"
            raise VirtualTimeDeadlockError(f"the test has not ended after {limit}{self._tasks_text()}")
        if seconds is None and not waited:
            raise VirtualTimeDeadlockError(f"nothing will ever wake this test{self._tasks_text()}")
        self._now_s += seconds or 0.0

    def _tasks_text(self) -> str:
        return "".join(f"\n  pending: {task!r:.500}" for task in asyncio.all_tasks(self))


class _VirtualTimeSelector(selectors.DefaultSelector):
    """Selector that waits only while other threads are active, and otherwise advances the loop's time."""

    def __init__(self, loop: VirtualTimeLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is not None and timeout <= 0:
            return super().select(0)
        threads_active = self._loop.other_threads_active()  # before select, which sees the last event of a thread
        events = super().select(0)
        if events:
            return events
        if not threads_active:
            self._loop.advance_s(timeout)
            return []
        start_s = time.monotonic()
        events = super().select(_THREAD_CHECK_INTERVAL_S if timeout is None else min(timeout, _THREAD_CHECK_INTERVAL_S))
        self._loop.advance_s(time.monotonic() - start_s, waited=True)
        return events
