"""asyncio event loop for tests, on which waiting takes no real time.

Time stands still while a callback is ready, and then jumps to the next timer. While other threads are active, the loop
waits in real time. If no event is possible any more, the test fails instead of blocking forever. Not for DDS, Zenoh,
processes or sockets, whose events need real time.
"""

from __future__ import annotations

import asyncio
import selectors
import threading
import time
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.loop.event_loop import end_tasks
from rosidl_py_gen.runtime.transport.api import ClockFunctions

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

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
