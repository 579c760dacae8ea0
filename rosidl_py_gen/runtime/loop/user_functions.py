"""Functions of the user: checks, and calls in a task, a context or a thread."""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import inspect
import threading
import types
from numbers import Integral
from typing import TYPE_CHECKING, Any, TypeVar

from rosidl_py_gen.base.waiters import set_result_if_pending

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Generator

T = TypeVar("T")

_HAS_CANCELLING = hasattr(asyncio.Task, "cancelling")


def require_callable(callback: object, subject: str, hint: str = "") -> None:
    """Raise `TypeError` unless a callback is callable or None."""
    if callback is not None and not callable(callback):
        raise TypeError(f"{subject} must be a function, got {callback!r:.100}{hint}")


def require_concurrency(value: object) -> None:
    """Raise `TypeError` or `ValueError` unless the number of concurrent calls is an integer of at least 1."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"concurrency must be an int, the maximum number of calls at once, got {value!r:.100}")
    if value < 1:
        raise ValueError(f"concurrency must be 1 or more, got {value!r}")


def is_async(function: object) -> bool:
    """Return True for async functions, and for objects with an async `__call__`."""
    called = getattr(type(function), "__call__", None)  # noqa: B004 - the method itself, not whether there is one
    return inspect.iscoroutinefunction(function) or inspect.iscoroutinefunction(called)


def is_own_cancel() -> bool:
    """Return True if the current task was cancelled itself, so that a CancelledError is not that of an awaited object.

    Only for tasks of `start_task`, because Python 3.10 has no `Task.cancelling`.
    """
    task = asyncio.current_task()
    cancelling = getattr(task, "cancelling", None)
    return cancelling is not None and cancelling() > 0


def start_task(loop: asyncio.AbstractEventLoop, coroutine: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
    """Create a task that supports `is_own_cancel`."""
    return loop.create_task(coroutine) if _HAS_CANCELLING else _CountingTask(coroutine, loop=loop)


@types.coroutine
def in_context(context: contextvars.Context, coroutine: Coroutine[Any, Any, T]) -> Generator[Any, Any, T]:
    """Await a coroutine in another context than the task's, which each of its steps enters."""
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
    """Task with `cancelling` for Python 3.10."""

    _cancels = 0

    def cancel(self, msg: Any = None) -> bool:
        self._cancels += 1
        return super().cancel(msg)

    def cancelling(self) -> int:
        return self._cancels


async def in_thread(name: str, function: Callable[..., Any], *arguments: object) -> Any:
    """Call a plain function in a daemon thread of its own, and return or raise its outcome.

    asyncio's pool has few threads, and waits for all of them when the loop ends, so that a function that does not
    return would keep the process alive.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[tuple[Any, BaseException | None]] = loop.create_future()
    context = contextvars.copy_context()

    def call() -> None:
        value, error = None, None
        try:
            value = context.run(function, *arguments)
        except BaseException as raised:
            error = raised
        with contextlib.suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(set_result_if_pending, done, (value, error))

    threading.Thread(target=call, name=name, daemon=True).start()
    value, error = await done
    try:
        if error is not None:
            raise error
        return value
    finally:
        del error  # its traceback refers to this frame
