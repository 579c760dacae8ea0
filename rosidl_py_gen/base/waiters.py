"""Futures that are completed from any thread, and `Waiters`, a condition variable across event loops and threads."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


current_loop: Callable[[], asyncio.AbstractEventLoop | None] = asyncio._get_running_loop
"""Function that returns the event loop which this thread runs; None if it runs none. A C function, because it is called
very often."""


def set_result_if_pending(future: asyncio.Future[T], result: T) -> None:
    """Complete a future unless it is done or its loop is closed. Thread: loop of the future."""
    if not future.done() and not future.get_loop().is_closed():
        future.set_result(result)


def complete_threadsafe(future: asyncio.Future[Any], result: object, error: BaseException | None = None) -> None:
    """Complete a future with a result, or `error` if given, unless it is done or its loop is closed. Thread: any."""
    loop = future.get_loop()
    if loop is not current_loop():
        with contextlib.suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(complete_threadsafe, future, result, error)
    elif not future.done():
        future.set_result(result) if error is None else future.set_exception(error)


class Waiters:
    """Condition variable across event loops and threads: tasks wait in order of arrival until a predicate is true.

    The caller of `wake` changes the state first, then wakes the tasks. A waiting task appends its future and then
    checks the predicate again. So a change that another thread makes after the first check is never missed: either the
    second check sees it, or `wake` finds the future.
    """

    __slots__ = ("_futures",)

    def __init__(self) -> None:
        self._futures: deque[asyncio.Future[None]] = deque()

    def __bool__(self) -> bool:
        """Return True if at least one task waits."""
        while True:
            try:
                return any(not future.done() for future in self._futures)
            except RuntimeError:  # another thread has changed the queue during the iteration
                continue

    async def wait(self, predicate: Callable[[], object], timeout_s: float | None = None) -> bool:
        """Wait until a predicate is true, and return True; return False after the timeout.

        The predicate is checked at once and after each `wake`. The timeout is one `call_later` without a task; with a
        timeout of 0 the loop runs one iteration.
        """
        loop = asyncio.get_running_loop()
        is_over = False

        def end() -> None:
            nonlocal is_over
            is_over = True
            set_result_if_pending(future, None)

        timer = None if timeout_s is None else loop.call_later(timeout_s, end)
        try:
            while not predicate():
                if is_over:
                    return False
                future = loop.create_future()
                self._futures.append(future)
                try:
                    if predicate():
                        return True
                    await future
                finally:
                    if future in self._futures:
                        with contextlib.suppress(ValueError):  # another thread wakes it up at the same time
                            self._futures.remove(future)
            return True
        finally:
            if timer is not None:
                timer.cancel()

    def wake(self) -> None:
        """Make all waiting tasks check their predicates again. Thread: any."""
        futures = self._futures
        if not futures:
            return
        here = current_loop()
        try:
            while True:
                future = futures.popleft()
                loop = future.get_loop()
                if loop is not here:
                    with contextlib.suppress(RuntimeError):  # the loop is closed
                        loop.call_soon_threadsafe(set_result_if_pending, future, None)
                elif not future.done():
                    future.set_result(None)
        except IndexError:  # no future is left, or another thread has popped it
            pass
