"""Futures, and the tasks that an executor runs. They are rclpy's, not asyncio's."""

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
_awaited = threading.local()
"""Its `future` is the one that a coroutine of this thread awaited last."""


class FutureState(Enum):
    """What became of a future."""

    PENDING = "PENDING"
    CANCELLED = "CANCELLED"
    FINISHED = "FINISHED"


class Future(Generic[T]):
    """A result that is there later. All methods may be called from any thread.

    Differs from asyncio's: `result` never waits and is None while nothing is there, `cancel` does not make it `done`.
    An exception that nobody fetched is told on stderr when the future is deleted.
    """

    def __init__(self, *, executor: Executor | None = None) -> None:
        self._state = FutureState.PENDING
        self._result: T | None = None
        self._exception: BaseException | None = None
        self._exception_fetched = False
        self._callbacks: list[Callable[[Future[T]], object]] = []
        self._rosidl_wakers: list[Callable[[], object]] = []
        """Called at the end by whoever ends it: executors that wait for it."""
        self._lock = threading.Lock()
        self._executor: Callable[[], Executor | None] = _no_executor if executor is None else weakref.ref(executor)

    def __del__(self) -> None:
        if getattr(self, "_exception", None) is not None and not self._exception_fetched:
            print(f"The following exception was never retrieved: {self._exception}", file=sys.stderr)

    def __await__(self) -> Generator[None, None, T | None]:
        """Yields None, which asyncio takes as well: a coroutine of its loop asks again at each of its turns."""
        while self._pending():
            _awaited.future = self
            yield
        return self.result()

    def _pending(self) -> bool:
        return self._state is FutureState.PENDING

    def cancel(self) -> None:
        """Give it up, unless it is over already: `cancelled` is true then, `done` is not."""
        with self._lock:
            if not self._pending():
                return
            self._state = FutureState.CANCELLED
        self._rosidl_tell()

    def cancelled(self) -> bool:
        """Whether it was given up."""
        return self._state is FutureState.CANCELLED

    def done(self) -> bool:
        """Whether there is a result or an exception."""
        return self._state is FutureState.FINISHED

    def result(self) -> T | None:
        """The result; None while there is none. Raises the exception, if there is one."""
        error = self.exception()
        if error is not None:
            raise error
        return self._result

    def exception(self) -> BaseException | None:
        """The exception; None while there is none."""
        self._exception_fetched = True
        return self._exception

    def set_result(self, result: T) -> None:
        """End it with a result."""
        with self._lock:
            self._result = result
            self._state = FutureState.FINISHED
            is_waited_for = self._callbacks or self._rosidl_wakers
        if is_waited_for:
            self._rosidl_tell()

    def set_exception(self, exception: BaseException) -> None:
        """End it with an exception."""
        with self._lock:
            self._exception = exception
            self._exception_fetched = False
            self._state = FutureState.FINISHED
        self._rosidl_tell()

    def _rosidl_tell(self) -> None:
        """Have the callbacks called: by the executor it belongs to, else here and now."""
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
        """Have a function called when it is over; without effect when that is registered, or it is over."""
        with self._lock:
            if self._pending() and wake not in self._rosidl_wakers:
                self._rosidl_wakers.append(wake)

    def _rosidl_forget_waker(self, wake: Callable[[], object]) -> None:
        with self._lock:
            if wake in self._rosidl_wakers:
                self._rosidl_wakers.remove(wake)

    def add_done_callback(self, callback: Callable[[Future[T]], object]) -> None:
        """Have ``callback(future)`` called at the end: as a task of the executor the future belongs to, else by whoever
        ends it. Where it is over already, that is now, and what the callback raises is raised here.
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
        """Take a callback back; False when it was not there (any more)."""
        with self._lock:
            if callback not in self._callbacks:
                return False
            self._callbacks.remove(callback)
            return True


class Task(Future[T]):
    """A function or coroutine that an executor runs; made by `Executor.create_task`.

    Calling it runs the function, or goes on with the coroutine up to its next ``await`` of something that is not there.
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
        self._rosidl_handed_out = False
        """An executor gave it to somebody who is about to call it."""
        self._rosidl_waits_for: Future[Any] | None = None
        self._task_lock = threading.Lock()

    def __call__(self) -> None:
        """Run it, or go on with it; without effect while another thread does, and when it is over."""
        if not self._pending() or self._executing or not self._task_lock.acquire(blocking=False):
            return
        try:
            if not self._pending():
                return
            self._executing, self._rosidl_waits_for = True, None
            try:
                self._rosidl_step()
            except BaseException:  # what ends a program, such as KeyboardInterrupt
                self._state, self._handler = FutureState.CANCELLED, None
                raise
            finally:
                self._executing = self._rosidl_handed_out = False
        finally:
            self._task_lock.release()

    def _rosidl_step(self) -> None:
        handler = self._handler
        try:
            if inspect.iscoroutine(handler):
                _awaited.future = None
                try:
                    handler.send(None)
                    self._rosidl_wait_for(_awaited.future)
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

    def _rosidl_wait_for(self, awaited: Future[Any] | None) -> None:
        """Note what the coroutine waits for. What is no future of ours is asked again at each pass."""
        executor = self._executor()
        if awaited is not None and executor is not None:
            self._rosidl_waits_for = awaited
            awaited._rosidl_wake_at_end(executor.wake)

    def _rosidl_has_resumable_task(self) -> bool:
        """Whether an executor should call it."""
        if self._rosidl_handed_out or self._executing or not self._pending():
            return False
        return self._rosidl_waits_for is None or not self._rosidl_waits_for._pending()

    def executing(self) -> bool:
        """Whether it runs at this moment."""
        return self._executing

    def cancel(self) -> None:
        """Give it up; a coroutine is closed where it stands."""
        if self._pending() and inspect.iscoroutine(self._handler):
            self._handler.close()
        super().cancel()


class EntityTask(Task[None]):
    """A task whose function may answer a coroutine, with which it goes on; then the executor has to keep it."""

    def __init__(
        self,
        executor: Executor,
        begin: Callable[[], Coroutine[Any, Any, None] | None],
        keep: Callable[[Task[Any]], None],
    ) -> None:
        Future.__init__(self, executor=executor)
        self._handler, self._args, self._kwargs = begin, (), {}
        self._executing, self._rosidl_handed_out, self._rosidl_waits_for = False, True, None
        self._task_lock = threading.Lock()
        self._keep: Callable[[Task[Any]], None] | None = keep

    def _rosidl_step(self) -> None:
        keep, self._keep = self._keep, None
        if keep is not None:
            assert callable(self._handler)
            try:
                rest = self._handler()
            except Exception as error:
                self._handler = None
                self.set_exception(error)
                return
            if rest is None:
                self._handler = None
                self.set_result(None)
                return
            self._handler = rest
            keep(self)
        super()._rosidl_step()


def _no_executor() -> None:
    """What a weak reference to nothing answers."""


async def await_or_execute(callback: Callable[..., Any], *args: Any) -> Any:
    """Call a function, and await what an async one answers."""
    if inspect.iscoroutinefunction(callback):
        return await callback(*args)
    return callback(*args)
