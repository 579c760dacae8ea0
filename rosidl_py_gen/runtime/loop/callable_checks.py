"""Helpers around functions that users hand in: plain or async, and on which thread."""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import inspect
import threading
import types
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Generator

T = TypeVar("T")

_TASKS_KNOW = hasattr(asyncio.Task, "cancelling")


def require_callable(callback: object, what: str, hint: str = "") -> None:
    """Raise `TypeError` for what is neither callable nor None, before anything is created."""
    if callback is not None and not callable(callback):
        raise TypeError(f"{what} must be a function, got {callback!r:.100}{hint}")


def is_async(function: object) -> bool:
    """Whether calling it gives a coroutine: async functions, and objects whose `__call__` is one."""
    called = getattr(type(function), "__call__", None)  # noqa: B004 - the method itself, not whether there is one
    return inspect.iscoroutinefunction(function) or inspect.iscoroutinefunction(called)


def is_own_cancel() -> bool:
    """Whether the CancelledError at hand is meant for the current task, and not the outcome of something awaited.

    For tasks of `start_task`; on Python 3.10 others cannot tell.
    """
    task = asyncio.current_task()
    cancelling = getattr(task, "cancelling", None)
    return cancelling is not None and cancelling() > 0


def start_task(loop: asyncio.AbstractEventLoop, coroutine: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
    """A task that knows whether it was cancelled."""
    return loop.create_task(coroutine) if _TASKS_KNOW else _CountingTask(coroutine, loop=loop)


@types.coroutine
def in_context(context: contextvars.Context, coroutine: Coroutine[Any, Any, T]) -> Generator[Any, Any, T]:
    """Await a coroutine in a context other than the task's: each of its steps is entered by itself."""
    step: Callable[[Any], Any] = coroutine.send
    value: Any = None
    while True:
        try:
            awaited = context.run(step, value)
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
        try:
            step, value = coroutine.send, (yield awaited)
        except BaseException as error:
            step, value = coroutine.throw, error


class _CountingTask(asyncio.Task[T]):
    """What tasks of Python 3.11 can do."""

    _cancels = 0

    def cancel(self, msg: Any = None) -> bool:
        self._cancels += 1
        return super().cancel(msg)

    def cancelling(self) -> int:
        return self._cancels


async def in_thread(name: str, function: Callable[..., Any], *arguments: object) -> Any:
    """Call a plain function in a thread of its own, and return or raise what it does.

    A daemon thread, and none of asyncio's pool: that has a few threads for the whole program, and waits for all of them
    when the loop ends, so a function that does not return would keep the process alive.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[tuple[Any, BaseException | None]] = loop.create_future()
    context = contextvars.copy_context()

    def deliver(outcome: Any, error: BaseException | None) -> None:
        if not done.done():
            done.set_result((outcome, error))

    def call() -> None:
        outcome, failure = None, None
        try:
            outcome = context.run(function, *arguments)
        except BaseException as error:
            failure = error
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody waits any more
            loop.call_soon_threadsafe(deliver, outcome, failure)

    threading.Thread(target=call, name=name, daemon=True).start()
    outcome, failure = await done
    try:
        if failure is not None:
            raise failure
        return outcome
    finally:
        del failure  # its traceback holds this frame
