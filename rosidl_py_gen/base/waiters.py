"""Waiting on an event loop: the loop of this thread, ends of futures from any thread, and `Waiters`.

`Waiters` decide what `asyncio.Event` and `asyncio.Condition` leave open here: those who wait may be on different loops
and may have a time limit that costs no task, whoever wakes them may be in any thread, and a loop that was closed with
somebody waiting on it disturbs nobody. The state itself belongs to the user of this file; he changes it first and wakes
then.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar("T")


def current_loop() -> asyncio.AbstractEventLoop | None:
    """The loop that this thread runs just now."""
    return asyncio._get_running_loop()


def set_result_if_pending(future: asyncio.Future[T], result: T) -> None:
    """Let whoever waits go on, on the future's loop; nothing happens when nobody can any more."""
    if not future.done() and not future.get_loop().is_closed():
        future.set_result(result)


def complete_threadsafe(future: asyncio.Future[Any], result: object, error: BaseException | None = None) -> None:
    """`set_result_if_pending` from any thread, with an error if there is one."""
    loop = future.get_loop()
    if loop is not current_loop():
        with contextlib.suppress(RuntimeError):  # it is closed
            loop.call_soon_threadsafe(complete_threadsafe, future, result, error)
    elif not future.done():
        future.set_result(result) if error is None else future.set_exception(error)


class Waiters:
    """Everybody who waits for one thing, in order of arrival."""

    __slots__ = ("_futures",)

    def __init__(self) -> None:
        self._futures: deque[asyncio.Future[None]] = deque()

    def __bool__(self) -> bool:
        """Whether anybody waits."""
        return any(not future.done() for future in tuple(self._futures))

    async def wait(self, predicate: Callable[[], object], timeout_s: float | None = None) -> bool:
        """Wait until `predicate()` is true, which is looked at now and after each `wake`; False when the time passed.

        A time limit of 0 lets the loop do once what it has to do.
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
                # Listed before another look: who changes something behind it, in another thread, finds us here.
                future = loop.create_future()
                self._futures.append(future)
                try:
                    if predicate():
                        return True
                    await future
                finally:
                    if future in self._futures:
                        with contextlib.suppress(ValueError):  # woken in this moment
                            self._futures.remove(future)
            return True
        finally:
            if timer is not None:
                timer.cancel()

    def wake(self) -> None:
        """Let all look again; from any thread."""
        futures = self._futures
        if not futures:
            return
        here = current_loop()
        try:
            while True:
                future = futures.popleft()
                loop = future.get_loop()
                if loop is not here:
                    with contextlib.suppress(RuntimeError):  # closed with somebody waiting
                        loop.call_soon_threadsafe(set_result_if_pending, future, None)
                elif not future.done():
                    future.set_result(None)
        except IndexError:  # that was the last one, or another thread took it in this moment
            pass
