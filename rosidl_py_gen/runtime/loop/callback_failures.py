"""What becomes of an exception that a user's function raises: it is logged, and with ``on_error="raise"`` it ends more.

Decides who gets it then: the innermost `async with` on its node or context, or blocking call, that is under way; else
the `run` or `spin` whose loop serves the node. Each is a `FailureGuard`: it cancels its task, as `asyncio.timeout`
does, and
raises the exception in place of the cancellation. Without any, the `Driver.wait` that runs the loop raises it. What
nobody could take is kept for the next guard. The first one counts: what else fails until the end is logged only, so
that the program gets the same exception every time.
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
"""What a callback that raises does to the program: nothing but a log entry, or its end."""

_guards: list[FailureGuard] = []
"""Those under way, in all threads, newest last."""
_with_kept: weakref.WeakSet[CallbackFailures] = weakref.WeakSet()


class CallbackFailedError(RosidlError):
    """Several functions of the user raised in a test; `errors` are their exceptions, oldest first."""

    def __init__(self, errors: Sequence[BaseException]) -> None:
        self.errors = tuple(errors)
        parts = [f"{len(self.errors)} callbacks failed"]
        for number, error in enumerate(self.errors, 1):
            parts.append(f"{number}:\n" + "".join(traceback.format_exception(error)).rstrip())
        super().__init__("\n".join(parts))

    def __reduce__(self) -> tuple[type[CallbackFailedError], tuple[tuple[BaseException, ...]]]:
        return type(self), (self.errors,)


class CallbacksNeverRanError(RosidlError):
    """No event loop has served a node with callbacks, until it was closed or its test ended."""


def require_on_error(value: object) -> OnError:
    """Raises `ValueError` for anything else."""
    if value == "log" or value == "raise":
        return value
    raise ValueError(f"on_error must be {' or '.join(map(repr, get_args(OnError)))}, got {value!r:.100}")


class CallbackFailures:
    """What the functions of one node raised."""

    def __init__(self, bridge: LoopBinding, on_error: OnError) -> None:
        self.loop_binding = bridge
        self.on_error = on_error
        self.kept: BaseException | None = None
        """What was not raised yet; whoever takes it raises it."""

    def report(self, doing: str, logger: RosLogger) -> None:
        """Log the exception being handled; with ``on_error="raise"`` also end whoever guards this node."""
        if self.on_error == "log":
            report_failure(doing, logger)
            return
        report_failure(doing, logger, "the program ends with it, because of on_error='raise'")
        error = sys.exc_info()[1]
        if error is None or self.kept is not None:
            return
        self.kept = error
        _with_kept.add(self)
        for guard in reversed(tuple(_guards)):
            if guard.covers(self):
                guard.trigger(self)
                return
        shared = self.loop_binding.shared
        if shared is not None and self.loop_binding.in_loop_thread() and shared.fail_leader(error):
            self.kept = None

    def raise_kept(self) -> None:
        """Raise what was not raised yet, if there is something."""
        error, self.kept = self.kept, None
        if error is None:
            return
        context = error.__context__
        try:
            raise error
        finally:
            error.__context__ = context  # not the cancellation that is being handled

    async def run_guarded(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Await a coroutine that a failure ends."""
        try:
            with FailureGuard(lambda failures: failures is self):
                return await coroutine
        finally:
            coroutine.close()  # cancelled before its first step


class FailureGuard:
    """While this is entered, in a task, a failure of the nodes it `covers` cancels the task and is raised instead."""

    def __init__(self, concerns: Callable[[CallbackFailures], bool]) -> None:
        self.covers = concerns
        self._loop: asyncio.AbstractEventLoop
        self._task: asyncio.Task[Any] | None = None
        self._failed: CallbackFailures | None = None
        self._is_open = False
        self._cancelled = False

    def __enter__(self) -> None:
        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        self._is_open = True
        _guards.append(self)
        for failures in tuple(_with_kept):
            if failures.kept is not None and self.covers(failures):
                self.trigger(failures)

    def trigger(self, failures: CallbackFailures) -> None:
        """Something failed; from any thread."""
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
        is_ours = isinstance(error, asyncio.CancelledError) and self._cancelled and not others
        if self._failed is not None and (error is None or is_ours):
            self._failed.raise_kept()
