"""Waiting across event loops and threads: futures, `Waiters`, and blocking forms of coroutine methods.

Futures are completed from any thread. `Waiters` is a condition variable across event loops and threads. `blocking`
makes methods such as ``receive_sync`` from ``receive``.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import inspect
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

if TYPE_CHECKING:
    from collections.abc import Coroutine

T = TypeVar("T")


current_loop: Callable[[], asyncio.AbstractEventLoop | None] = asyncio._get_running_loop
"""Function that returns the event loop which this thread runs; None if it runs none. A C function, because it is called
very often."""


def _set_result_if_pending(future: asyncio.Future[T], result: T) -> None:
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
            _set_result_if_pending(future, None)

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
                        loop.call_soon_threadsafe(_set_result_if_pending, future, None)
                elif not future.done():
                    future.set_result(None)
        except IndexError:  # no future is left, or another thread has popped it
            pass


S = TypeVar("S")
P = ParamSpec("P")
R = TypeVar("R")


def blocking(method: Callable[Concatenate[S, P], Coroutine[Any, Any, R]]) -> Callable[Concatenate[S, P], R]:
    """Return the blocking form of a coroutine method, named ``<method>_sync``.

    The class must have an attribute ``_scope`` with a method ``run_blocking``, as `EntityScope` has. The blocking form
    raises `WouldDeadlockError` on the event loop's thread, and else the same errors as the method.
    """
    name = method.__name__

    @functools.wraps(method)
    def run(self: S, /, *arguments: P.args, **keywords: P.kwargs) -> R:
        coroutine = getattr(self, name)(*arguments, **keywords)  # the method of a subclass, if it has one
        result: R = self._scope.run_blocking(coroutine, self, name)  # type: ignore[attr-defined]
        return result

    run.__name__, run.__qualname__ = f"{name}_sync", f"{method.__qualname__}_sync"
    run.__doc__ = _docstring(name, inspect.getdoc(method) or f"Call `{name}`.")
    return run


def _docstring(name: str, text: str) -> str:
    """Return the docstring of a blocking form: the method's docstring, and the exception that only this form raises."""
    before, _, errors = text.partition("\nRaises:\n")
    raises = [*filter(None, [errors.rstrip()]), "    WouldDeadlockError: it is called on the thread of the event loop."]
    return "\n".join([before.rstrip(), "", f"Blocking form of `{name}`, for plain code.", "", "Raises:", *raises])
