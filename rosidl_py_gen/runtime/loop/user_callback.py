"""Functions that users hand in, and what may come of calling them.

A function may be plain, async, or plain and answer a coroutine, as a lambda around an async function does. Decides that
the first is called at once and the others run in a task; that an exception is reported to the owner, once, and goes
nowhere else by itself (`failures.py` decides what becomes of it); and which cancellation is which: one of the task
itself ends it, one that comes out of something the function awaited is a failure like any other.

Decides in which `contextvars` context a call runs: in a copy, of its own, of the one in which the function was handed
in, as `loop.add_reader` does. Where the call comes from (a publisher in the same process, a timer that was reset in its
callback, the goal that ended before) makes no difference then.
"""

from __future__ import annotations

import asyncio
import inspect
from contextvars import copy_context
from types import CoroutineType
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from rosidl_py_gen.runtime.loop.callable_checks import in_context, is_async, is_own_cancel

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

T = TypeVar("T")

_ENDS = (KeyboardInterrupt, SystemExit, GeneratorExit)
"""What a function raises to end the program or itself, and is no failure."""


class Owner(Protocol):
    """On whose behalf a function is called: the scope of a node."""

    closed: bool
    """Its tasks are being cancelled."""

    def create_task(self, coroutine: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """Run a coroutine as a task that ends with the owner."""

    def report_failure(self, doing: str) -> None:
        """Log the exception being handled; see `failures.py` for what else it may do."""


def ignore(answer: object) -> None:
    """What most callbacks answer means nothing."""


class UserCallback:
    """One function of the user; `what` names it in logs: "the callback of /chatter"."""

    __slots__ = ("_closed", "_context", "_function", "_owner", "is_async", "what")

    def __init__(self, owner: Owner, function: Callable[..., Any], what: str) -> None:
        self._owner = owner
        self._closed = False
        self._context = copy_context()
        self._function = function
        self.what = what
        self.is_async = is_async(function)

    def call(self, *arguments: object, on_result: Callable[[Any], object] = ignore) -> asyncio.Task[Any] | None:
        """Call it, on the loop's thread; `on_result` gets what it answers, and may fail like the function itself.

        Returns:
            None when all is done, otherwise the task that goes on with it.
        """
        context = self._context.copy()
        if self.is_async:
            return context.run(self._start, lambda: self._function(*arguments), on_result)
        try:
            answer = context.run(self._function, *arguments)
            if not isinstance(answer, CoroutineType):
                if on_result is not ignore:
                    context.run(on_result, answer)
                return None
        except _ENDS:
            raise
        except BaseException:  # CancelledError of a future that was cancelled; those of pytest.fail and the like
            context.run(self._owner.report_failure, self.what)
            return None
        task = context.run(self._start, lambda: answer, on_result)
        task.add_done_callback(lambda _: answer.close())  # one that was cancelled has not begun it
        return task

    def _start(self, before_select: Callable[[], Any], then: Callable[[Any], object]) -> asyncio.Task[None]:
        return self._owner.create_task(self._finish(before_select, then))

    async def run(self, *arguments: object) -> None:
        """Call it inside a task of `Owner.start` that goes on with the next call: cheaper than a task for each."""
        await in_context(self._context.copy(), self._finish(lambda: self._function(*arguments), ignore))

    async def _finish(self, before_select: Callable[[], Any], then: Callable[[Any], object]) -> None:
        # Begun in here, so that a task that is cancelled before leaves no coroutine behind.
        try:
            answer = before_select()
            then(await answer if inspect.isawaitable(answer) else answer)
        except asyncio.CancelledError:
            if self._closed or self._owner.closed or is_own_cancel():
                raise
            self._owner.report_failure(self.what)
        except _ENDS:
            raise
        except BaseException:
            self._owner.report_failure(self.what)

    def close(self) -> None:
        """Note that the endpoint is closed: when what the function awaits is cancelled then, that is no failure."""
        self._closed = True
