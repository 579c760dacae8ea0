"""Checks and calls of the user's callbacks, in tasks and in threads.

Callbacks may be plain functions, async functions, or plain functions that return a coroutine.

Plain functions are called at once, coroutines run in a task. Exceptions are reported once to the owner (the scope of
the node) and not raised. A cancellation of the task itself ends the task; a CancelledError that an awaited object
raises is a failure.

Each call runs in a copy of the `contextvars` context in which the callback was passed, as with `loop.add_reader`, so it
does not depend on the code that causes the call.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import threading
import types
from contextvars import copy_context
from numbers import Integral
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from rosidl_py_gen.base.waiters import set_result_if_pending

if TYPE_CHECKING:
    import contextvars
    from collections.abc import Callable, Coroutine, Generator

T = TypeVar("T")

_HAS_CANCELLING = hasattr(asyncio.Task, "cancelling")
_EXIT_EXCEPTIONS = (KeyboardInterrupt, SystemExit, GeneratorExit)
"""Exceptions that end the program or the coroutine, and are not failures."""


class Owner(Protocol):
    """Owner of a callback: the scope of a node. `closed` is True once the owner's tasks are being cancelled."""

    closed: bool

    def create_task(self, coroutine: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """Run a coroutine as a task that ends with the owner."""

    def report_failure(self, activity: str) -> None:
        """Log the exception being handled; with ``on_error="raise"`` of the node, also raise it in the program."""


def ignore(value: object) -> None:
    """Ignore the value that a callback has returned; used where no result handler is needed."""


class UserCallback:
    """Callback of the user; `subject` is its name in logs, such as "the callback of /chatter"."""

    __slots__ = ("_closed", "_context", "_function", "_owner", "is_async", "subject")

    def __init__(self, owner: Owner, function: Callable[..., Any], subject: str) -> None:
        self._owner = owner
        self._closed = False
        self._context = copy_context()
        self._function = function
        self.subject = subject
        self.is_async = is_async(function)

    def call(self, *arguments: object, on_result: Callable[[Any], object] = ignore) -> asyncio.Task[Any] | None:
        """Call the callback, then `on_result` with its value; report exceptions of both to the owner. Thread: loop.

        Returns:
            The task that continues the call; None if it is complete.
        """
        context = self._context.copy()
        if self.is_async:
            coroutine = self._finish(lambda: self._function(*arguments), on_result)
            return context.run(self._owner.create_task, coroutine)
        try:
            value = context.run(self._function, *arguments)
            if not isinstance(value, types.CoroutineType):
                if on_result is not ignore:
                    context.run(on_result, value)
                return None
        except _EXIT_EXCEPTIONS:
            raise
        except (
            BaseException
        ):  # includes CancelledError of a cancelled future, and exceptions such as pytest.fail.Exception
            context.run(self._owner.report_failure, self.subject)
            return None
        task = context.run(self._owner.create_task, self._finish(lambda: value, on_result))
        task.add_done_callback(lambda _: value.close())  # a cancelled task may not have started it
        return task

    async def run(self, *arguments: object) -> None:
        """Call the callback in the calling task, and await the coroutine that it returns.

        The task must be one of `Owner.create_task`. This is cheaper than a task for each call. Exceptions are reported
        to the owner.
        """
        await in_context(self._context.copy(), self._finish(lambda: self._function(*arguments), ignore))

    async def _finish(self, function: Callable[[], Any], on_result: Callable[[Any], object]) -> None:
        # Called here, so that a task that is cancelled before its start leaves no coroutine.
        try:
            value = function()
            on_result(await value if inspect.isawaitable(value) else value)
        except asyncio.CancelledError:
            if self._closed or self._owner.closed or is_own_cancel():
                raise
            self._owner.report_failure(self.subject)
        except _EXIT_EXCEPTIONS:
            raise
        except BaseException:
            self._owner.report_failure(self.subject)

    def close(self) -> None:
        """Record that the callback's entity is closed, so that a CancelledError no longer counts as a failure."""
        self._closed = True


def require_callable(callback: object, subject: str, hint: str = "") -> None:
    """Raise `TypeError` unless `callback` is callable or None; the text begins with `subject` and ends with `hint`."""
    if callback is not None and not callable(callback):
        raise TypeError(f"{subject} must be a function, got {callback!r:.100}{hint}")


def require_concurrency(value: object) -> None:
    """Raise an error unless `value`, a maximum number of concurrent calls, is an integer of at least 1.

    Raises:
        TypeError: the value is not an integer.
        ValueError: the value is less than 1.
    """
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"concurrency must be an int, the maximum number of calls at once, got {value!r:.100}")
    if value < 1:
        raise ValueError(f"concurrency must be 1 or more, got {value!r}")


def is_async(function: object) -> bool:
    """Return True for async functions, and for objects with an async `__call__`."""
    called = getattr(type(function), "__call__", None)  # noqa: B004 - the method itself, not whether there is one
    return inspect.iscoroutinefunction(function) or inspect.iscoroutinefunction(called)


def is_own_cancel() -> bool:
    """Return True if the CancelledError being handled comes from a cancellation of the current task itself.

    Otherwise an awaited object has raised the CancelledError.

    Only for tasks of `start_task`, because Python 3.10 has no `Task.cancelling`.
    """
    task = asyncio.current_task()
    cancelling = getattr(task, "cancelling", None)
    return cancelling is not None and cancelling() > 0


def start_task(loop: asyncio.AbstractEventLoop, coroutine: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
    """Create a task in which `is_own_cancel` works, also on Python 3.10."""
    return loop.create_task(coroutine) if _HAS_CANCELLING else _CountingTask(coroutine, loop=loop)


@types.coroutine
def in_context(context: contextvars.Context, coroutine: Coroutine[Any, Any, T]) -> Generator[Any, Any, T]:
    """Await a coroutine whose steps run in the given `contextvars` context, instead of the context of the task."""
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
    """Task that has the method `cancelling`, which Python 3.10 lacks."""

    _cancels = 0

    def cancel(self, msg: Any = None) -> bool:
        self._cancels += 1
        return super().cancel(msg)

    def cancelling(self) -> int:
        return self._cancels


async def in_thread(name: str, function: Callable[..., Any], *arguments: object) -> Any:
    """Call a plain function in a new daemon thread with a name, and return its value or raise its exception.

    asyncio's pool has few threads, and waits for all of them when the loop ends, so that a function that does not
    return would keep the process alive.
    """
    loop = asyncio.get_running_loop()
    done: asyncio.Future[tuple[Any, BaseException | None]] = loop.create_future()
    context = copy_context()

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
