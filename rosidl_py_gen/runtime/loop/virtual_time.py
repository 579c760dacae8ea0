"""An event loop for tests, on which waiting takes no time.

Decides when time passes: while something is ready to run it stands still; when nothing is, it is at once the time of
the next timer. While another thread is under way, which may have something to say, the loop waits as any other, and
time passes as on the wall. When nothing can ever happen any more, the test fails instead of hanging.

Not for nodes on DDS or Zenoh, nor for processes or sockets: what comes from outside takes real time.
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
from rosidl_py_gen.runtime.transport.clock_functions import ClockFunctions

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

T = TypeVar("T")

_LOOK_S = 0.05
"""How long to wait for other threads before looking whether there still are any."""


class VirtualTimeDeadlockError(RosidlError):
    """A test waits for something that cannot happen any more."""


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An event loop whose time passes only by waiting. `clocks` go as it does; give them to a `MemoryTransport`.

    Args:
        limit_s: real seconds that `run` may take, so that a test that never ends fails, too.
    """

    def __init__(self, limit_s: float = 60.0) -> None:
        self._now_s = 0.0
        self._jobs = 0
        self._limit_s = limit_s
        self._end_s = float("inf")
        self._others = set(threading.enumerate())
        super().__init__(_ConditionSelector(self))
        epoch_ns = time.time_ns()
        self.clocks = ClockFunctions(
            lambda: epoch_ns + round(self._now_s * NS_PER_S), lambda: round(self._now_s * NS_PER_S)
        )

    def time(self) -> float:
        """Seconds since the loop was made."""
        return self._now_s

    def run(self, main: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine as `asyncio.run` does, on this loop, which is closed then.

        Raises:
            VirtualTimeDeadlockError: `main` waits for what cannot happen, or has not ended after `limit_s`.
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
        """Run a function in a thread; time passes as on the wall until it is done."""
        job = super().run_in_executor(executor, func, *args)
        self._jobs += 1
        job.add_done_callback(self._done)
        return job

    def _done(self, job: asyncio.Future[Any]) -> None:
        self._jobs -= 1

    def other_threads_active(self) -> bool:
        """Whether a thread that began after this loop may have something to say; those of asyncio's pool rest."""
        here = threading.current_thread()
        return self._jobs > 0 or any(
            thread is not here and not thread.name.startswith("asyncio_")
            for thread in threading.enumerate()
            if thread not in self._others
        )

    def advance_s(self, seconds: float | None, *, waited: bool = False) -> None:
        """Let time pass; raises `VirtualTimeDeadlockError` when there is nothing to wait for."""
        if time.monotonic() > self._end_s:
            self._end_s = float("inf")
            raise VirtualTimeDeadlockError(f"not over after {self._limit_s} s{self._shown_tasks()}")
        if seconds is None and not waited:
            raise VirtualTimeDeadlockError(f"nothing will ever wake this test{self._shown_tasks()}")
        self._now_s += seconds or 0.0

    def _shown_tasks(self) -> str:
        return "".join(f"\n  pending: {task!r:.500}" for task in asyncio.all_tasks(self))


class _ConditionSelector(selectors.DefaultSelector):
    """Waits only for other threads; otherwise lets the loop's time pass."""

    def __init__(self, loop: VirtualTimeLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is not None and timeout <= 0:
            return super().select(0)
        others_work = self._loop.other_threads_active()  # asked first: what a thread says before it ends is heard below
        found = super().select(0)
        if found:
            return found
        if not others_work:
            self._loop.advance_s(timeout)
            return []
        began_s = time.monotonic()
        found = super().select(_LOOK_S if timeout is None else min(timeout, _LOOK_S))
        self._loop.advance_s(time.monotonic() - began_s, waited=True)
        return found
