"""Checks and calls of the user's callbacks, in tasks and in threads, and the exceptions that callbacks raise.

Callbacks may be plain functions, async functions, or plain functions that return a coroutine.

Plain functions are called at once, coroutines run in a task. Exceptions are reported once to the owner (the scope of
the node) and not raised. A cancellation of the task itself ends the task; a CancelledError that an awaited object
raises is a failure.

Each call runs in a copy of the `contextvars` context in which the callback was passed, as with `loop.add_reader`, so it
does not depend on the code that causes the call.

Failures are logged, and with ``on_error="raise"`` also raised in the program. The innermost `FailureGuard` of the node
raises the exception: an `async with` on its node or context, or a blocking call; else the `run` or `spin` whose loop
serves the node. Without a guard, `LoopRunner.wait` raises the exception, or the next guard. Only the first exception is
raised, so that the program gets the same exception each time; later ones are logged.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import sys
import threading
import traceback
import types
import weakref
from contextvars import copy_context
from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, TypeVar, get_args

from rosidl_py_gen.base.waiters import complete_threadsafe
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.logs import report_failure

if TYPE_CHECKING:
    import contextvars
    from collections.abc import Callable, Coroutine, Generator, Sequence

    from rosidl_py_gen.runtime.logs import RosLogger
    from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding

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
        complete_threadsafe(done, (value, error))

    threading.Thread(target=call, name=name, daemon=True).start()
    value, error = await done
    try:
        if error is not None:
            raise error
        return value
    finally:
        del error  # its traceback refers to this frame


# ------------------------------------------------------------------------------------------------------------- failures

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
