"""Exceptions of the user's callbacks: they are logged, and with ``on_error="raise"`` also raised in the program.

The innermost `FailureGuard` of the node raises the exception: an `async with` on its node or context, or a blocking
call; else the `run` or `spin` whose loop serves the node. Without a guard, `LoopRunner.wait` raises the exception, or
the next guard. Only the first exception is raised, so that the program gets the same exception each time; later ones
are logged.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
import traceback
import weakref
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar, get_args

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.logs.loggers import report_failure

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Sequence

    from rosidl_py_gen.runtime.logs.loggers import RosLogger
    from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding

T = TypeVar("T")

OnError: TypeAlias = Literal["log", "raise"]
"""Type of the setting `on_error`: an exception of a callback is only logged, or logged and raised in the program."""

_guards: list[FailureGuard] = []
"""Failure guards of all threads whose `with` blocks are active, newest last."""
_with_pending_error: weakref.WeakSet[CallbackFailures] = weakref.WeakSet()


class CallbackFailedError(RosidlError):
    """Raised if several callbacks failed in a test; `errors` are their exceptions, oldest first."""

    def __init__(self, errors: Sequence[BaseException]) -> None:
        self.errors = tuple(errors)
        lines = [f"{len(self.errors)} callbacks failed"]
        for number, error in enumerate(self.errors, 1):
            lines.append(f"{number}:\n" + "".join(traceback.format_exception(error)).rstrip())
        super().__init__("\n".join(lines))

    def __reduce__(self) -> tuple[type[CallbackFailedError], tuple[tuple[BaseException, ...]]]:
        return type(self), (self.errors,)


class CallbacksNeverRanError(RosidlError):
    """Raised if no event loop has served a node with callbacks before the node was closed, or its test ended."""


def require_on_error(value: object) -> OnError:
    """Return `value` if it is ``"log"`` or ``"raise"``; raise `ValueError` otherwise."""
    if value == "log" or value == "raise":
        return value
    raise ValueError(f"on_error must be {' or '.join(map(repr, get_args(OnError)))}, got {value!r:.100}")


class CallbackFailures:
    """Exceptions of the callbacks of one node, which are logged or also raised.

    Attributes:
        loop_binding: binding of the node's context to the loop that serves it.
        on_error: ``"raise"`` if an exception is also raised in the program.
        pending_error: first exception, until it is raised; None if there is none.
    """

    def __init__(self, loop_binding: LoopBinding, on_error: OnError) -> None:
        self.loop_binding = loop_binding
        self.on_error = on_error
        self.pending_error: BaseException | None = None

    def report(self, activity: str, logger: RosLogger) -> None:
        """Log the exception that is being handled; with ``on_error="raise"``, also make a guard of the node raise it.

        Without a guard, the exception is raised by the thread that waits in a `LoopRunner` and runs the loop, or by the
        next guard.
        """
        if self.on_error == "log":
            report_failure(activity, logger)
            return
        report_failure(activity, logger, "the program ends with it, because of on_error='raise'")
        error = sys.exc_info()[1]
        if error is None or self.pending_error is not None:
            return
        self.pending_error = error
        _with_pending_error.add(self)
        for guard in reversed(tuple(_guards)):
            if guard.covers(self):
                guard.trigger(self)
                return
        shared = self.loop_binding.shared
        if shared is not None and self.loop_binding.in_loop_thread() and shared.fail_leader(error):
            self.pending_error = None

    def raise_pending(self) -> None:
        """Raise the first exception of a callback that was not raised yet, if there is one."""
        error, self.pending_error = self.pending_error, None
        if error is None:
            return
        context = error.__context__
        try:
            raise error
        finally:
            error.__context__ = context  # so that the traceback does not show the cancellation

    async def run_guarded(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Await a coroutine; the exception of a callback of the node cancels the coroutine and is raised instead."""
        try:
            with FailureGuard(lambda failures: failures is self):
                return await coroutine
        finally:
            coroutine.close()  # cancelled before its first step


class FailureGuard:
    """Context manager in a task that raises exceptions of callbacks, for the nodes for which `covers` returns True.

    A failure of a callback cancels the task once, as the end of the time does in `asyncio.timeout`. On exit, the guard
    withdraws this cancellation. Unless there is another cancellation, the guard replaces the CancelledError by the
    exception of the callback.
    """

    def __init__(self, covers: Callable[[CallbackFailures], bool]) -> None:
        self.covers = covers
        self._loop: asyncio.AbstractEventLoop
        self._task: asyncio.Task[Any] | None = None
        self._failed: CallbackFailures | None = None
        self._is_open = False
        self._cancelled = False

    def __enter__(self) -> None:
        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        self._is_open = True
        _guards.append(self)
        for failures in tuple(_with_pending_error):
            if failures.pending_error is not None and self.covers(failures):
                self.trigger(failures)

    def trigger(self, failures: CallbackFailures) -> None:
        """Cancel the task of the guard, because a callback of a node has failed. Thread: any."""
        if self._failed is not None:
            return
        self._failed = failures
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._cancel)

    def _cancel(self) -> None:
        if self._is_open and not self._cancelled and self._task is not None:
            self._cancelled = self._task.cancel()

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        _guards.remove(self)
        self._is_open = False
        others = 0
        if self._cancelled and (uncancel := getattr(self._task, "uncancel", None)):  # from Python 3.11 on
            others = uncancel()
        is_own_cancel = isinstance(error, asyncio.CancelledError) and self._cancelled and not others
        if self._failed is not None and (error is None or is_own_cancel):
            self._failed.raise_pending()
