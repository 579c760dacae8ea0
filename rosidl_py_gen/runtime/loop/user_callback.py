"""Calls of callbacks, which may be plain functions, async functions, or plain functions that return a coroutine.

Plain functions are called at once, coroutines run in a task. Exceptions are reported to the owner, once, and not
raised. A cancellation of the task itself ends it; a CancelledError of an awaited object is a failure.

Each call runs in a copy of the `contextvars` context in which the callback was passed, as with `loop.add_reader`, so it
does not depend on the code that causes the call.
"""

from __future__ import annotations

import asyncio
import inspect
from contextvars import copy_context
from types import CoroutineType
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from rosidl_py_gen.runtime.loop.user_functions import in_context, is_async, is_own_cancel

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

T = TypeVar("T")

_EXIT_EXCEPTIONS = (KeyboardInterrupt, SystemExit, GeneratorExit)
"""Exceptions that end the program or the coroutine, and are not failures."""


class Owner(Protocol):
    """Owner of a callback: the scope of a node. `closed`: its tasks are being cancelled."""

    closed: bool

    def create_task(self, coroutine: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """Run a coroutine as a task that ends with the owner."""

    def report_failure(self, activity: str) -> None:
        """Report the exception being handled; see `callback_failures.py`."""


def ignore(value: object) -> None:
    """Ignore the value that a callback returned."""


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
        """Call the callback, then `on_result` with its value, whose exceptions are reported, too. Thread: loop.

        Returns:
            The task that continues the call; None if it is complete.
        """
        context = self._context.copy()
        if self.is_async:
            return context.run(self._start, lambda: self._function(*arguments), on_result)
        try:
            value = context.run(self._function, *arguments)
            if not isinstance(value, CoroutineType):
                if on_result is not ignore:
                    context.run(on_result, value)
                return None
        except _EXIT_EXCEPTIONS:
            raise
        except (
            BaseException
        ):  # includes CancelledError of a cancelled future, and exceptions such as that of pytest.fail
            context.run(self._owner.report_failure, self.subject)
            return None
        task = context.run(self._start, lambda: value, on_result)
        task.add_done_callback(lambda _: value.close())  # a cancelled task may not have started it
        return task

    def _start(self, function: Callable[[], Any], on_result: Callable[[Any], object]) -> asyncio.Task[None]:
        return self._owner.create_task(self._finish(function, on_result))

    async def run(self, *arguments: object) -> None:
        """Call the callback inside a task of `Owner.create_task`: cheaper than a task for each call."""
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
        """Record that the entity is closed, after which a CancelledError is not a failure."""
        self._closed = True
