"""Futures and tasks of rclpy, which executors run; they differ from the futures and tasks of asyncio."""

from __future__ import annotations

import inspect
import sys
import threading
import warnings
import weakref
from collections.abc import Callable, Coroutine, Generator
from enum import Enum
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from rclpy.executors import Executor

T = TypeVar("T")
_last_awaited = threading.local()
"""Thread-local storage; its `future` is the future that a coroutine of the thread awaited last."""


class FutureState(Enum):
    """State of a future."""

    PENDING = "PENDING"
    CANCELLED = "CANCELLED"
    FINISHED = "FINISHED"


class Future(Generic[T]):
    """Result that is set later. Thread: any.

    Unlike in asyncio, `result` never waits, and returns None until the result is set; and a cancelled future is not
    `done`. An exception that was never retrieved is printed to stderr when the future is deleted.
    """

    def __init__(self, *, executor: Executor | None = None) -> None:
        self._state = FutureState.PENDING
        self._result: T | None = None
        self._exception: BaseException | None = None
        self._exception_fetched = False
        self._callbacks: list[Callable[[Future[T]], object]] = []
        self._rosidl_wakers: list[Callable[[], object]] = []
        """Functions that wake up waiting executors; called when the future ends, by the thread that ends it."""
        self._lock = threading.Lock()
        self._executor: Callable[[], Executor | None] = _no_executor if executor is None else weakref.ref(executor)

    def __del__(self) -> None:
        if getattr(self, "_exception", None) is not None and not self._exception_fetched:
            print(f"The following exception was never retrieved: {self._exception}", file=sys.stderr)

    def __await__(self) -> Generator[None, None, T | None]:
        """Yield None until the future ends, and return its result.

        asyncio accepts None, too: its loop resumes the coroutine in each iteration.
        """
        while self._pending():
            _last_awaited.future = self
            yield
        return self.result()

    def _pending(self) -> bool:
        return self._state is FutureState.PENDING

    def cancel(self) -> None:
        """Cancel the future unless it has ended; afterwards `cancelled` returns True, but `done` returns False."""
        with self._lock:
            if not self._pending():
                return
            self._state = FutureState.CANCELLED
        self._rosidl_run_callbacks()

    def cancelled(self) -> bool:
        return self._state is FutureState.CANCELLED

    def done(self) -> bool:
        """Return True if the future has a result or an exception; False if it was cancelled."""
        return self._state is FutureState.FINISHED

    def result(self) -> T | None:
        """Return the result, None if it is not set yet; raise the exception if one was set."""
        error = self.exception()
        if error is not None:
            raise error
        return self._result

    def exception(self) -> BaseException | None:
        """Return the exception that was set, None if there is none."""
        self._exception_fetched = True
        return self._exception

    def set_result(self, result: T) -> None:
        with self._lock:
            self._result = result
            self._state = FutureState.FINISHED
            is_waited_for = self._callbacks or self._rosidl_wakers
        if is_waited_for:
            self._rosidl_run_callbacks()

    def set_exception(self, exception: BaseException) -> None:
        with self._lock:
            self._exception = exception
            self._exception_fetched = False
            self._state = FutureState.FINISHED
        self._rosidl_run_callbacks()

    def _rosidl_run_callbacks(self) -> None:
        """Schedule the done callbacks in the executor of the future, or call them if it has no executor."""
        with self._lock:
            executor = self._executor()
            callbacks, self._callbacks = self._callbacks, []
            wakers, self._rosidl_wakers = self._rosidl_wakers, []
        for callback in callbacks:
            if executor is not None:
                executor.create_task(callback, self)
                continue
            try:
                callback(self)
            except Exception as error:
                warnings.warn(f"Unhandled exception in done callback: {error}", stacklevel=3)
        for wake in wakers:
            wake()

    def _set_executor(self, executor: Executor | None) -> None:
        with self._lock:
            self._executor = _no_executor if executor is None else weakref.ref(executor)

    def _rosidl_wake_at_end(self, wake: Callable[[], object]) -> None:
        """Call a function when the future ends, only once even if the function is added twice."""
        with self._lock:
            if self._pending() and wake not in self._rosidl_wakers:
                self._rosidl_wakers.append(wake)

    def add_done_callback(self, callback: Callable[[Future[T]], object]) -> None:
        """Call ``callback(future)`` when the future ends.

        The callback runs as a task of the future's executor, or without executor in the thread that ends the future. If
        the future has ended already, the callback is scheduled or called now; in the latter case its exceptions are
        raised here.
        """
        with self._lock:
            if self._pending():
                self._callbacks.append(callback)
                return
            executor = self._executor()
        if executor is not None:
            executor.create_task(callback, self)
        else:
            callback(self)

    def remove_done_callback(self, callback: Callable[[Future[T]], object]) -> bool:
        """Remove a callback of `add_done_callback`; return False if it is not registered."""
        with self._lock:
            if callback not in self._callbacks:
                return False
            self._callbacks.remove(callback)
            return True


class Task(Future[T]):
    """Function or coroutine that an executor runs; created by `Executor.create_task`.

    Calling the task runs the function, or resumes the coroutine up to its next unfinished ``await``.
    """

    def __init__(
        self,
        handler: Callable[..., Any] | Coroutine[Any, Any, T],
        args: tuple[Any, ...] | list[Any] | None = None,
        kwargs: dict[str, Any] | None = None,
        executor: Executor | None = None,
    ) -> None:
        super().__init__(executor=executor)
        self._handler: Callable[..., Any] | Coroutine[Any, Any, T] | None = handler
        self._args = () if args is None else tuple(args)
        self._kwargs = {} if kwargs is None else kwargs
        if inspect.iscoroutinefunction(handler):
            self._handler = handler(*self._args, **self._kwargs)
            self._args, self._kwargs = (), {}
        self._executing = False
        self.rosidl_is_dispatched = False
        """True if an executor has passed the task to a thread that will call it."""
        self._rosidl_awaited_future: Future[Any] | None = None
        self._task_lock = threading.Lock()

    def __call__(self) -> None:
        """Run or resume the task; do nothing if another thread runs the task, or if it has ended."""
        if not self._pending() or self._executing or not self._task_lock.acquire(blocking=False):
            return
        try:
            if not self._pending():
                return
            self._executing, self._rosidl_awaited_future = True, None
            try:
                self._rosidl_step()
            except BaseException:  # for example KeyboardInterrupt, which ends the program
                self._state, self._handler = FutureState.CANCELLED, None
                raise
            finally:
                self._executing = self.rosidl_is_dispatched = False
        finally:
            self._task_lock.release()

    def _rosidl_step(self) -> None:
        handler = self._handler
        try:
            if inspect.iscoroutine(handler):
                _last_awaited.future = None
                try:
                    handler.send(None)
                    self._rosidl_store_awaited_future(_last_awaited.future)
                    return
                except StopIteration as end:
                    result = end.value
            else:
                assert callable(handler)
                result = handler(*self._args, **self._kwargs)
        except Exception as error:
            self.set_exception(error)
        else:
            self.set_result(result)
        self._handler, self._args, self._kwargs = None, (), {}

    def _rosidl_store_awaited_future(self, awaited: Future[Any] | None) -> None:
        """Store the future that the coroutine awaits.

        Without such a future, the executor resumes the coroutine at each pass.
        """
        executor = self._executor()
        if awaited is not None and executor is not None:
            self._rosidl_awaited_future = awaited
            awaited._rosidl_wake_at_end(executor.wake)

    def _rosidl_has_resumable_task(self) -> bool:
        if self.rosidl_is_dispatched or self._executing or not self._pending():
            return False
        return self._rosidl_awaited_future is None or not self._rosidl_awaited_future._pending()

    def executing(self) -> bool:
        return self._executing

    def cancel(self) -> None:
        """Cancel the task and close its coroutine."""
        if self._pending() and inspect.iscoroutine(self._handler):
            self._handler.close()
        super().cancel()


def _no_executor() -> None:
    """Return None, like a weak reference whose object was deleted; used for futures without executor."""
