"""Executors: threads that wait for ready entities and run their callbacks."""

from __future__ import annotations

import inspect
import os
import threading
import time
import warnings
from collections.abc import Callable, Coroutine, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from threading import Condition, Lock, RLock
from types import TracebackType
from typing import TYPE_CHECKING, Any, ContextManager, Generator, List, Optional, Set, Tuple, Type, TypeVar, Union

from rclpy._rclpy_pybind11 import RCLError
from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.entity_execution import execute_entity, find_ready_entities, find_ready_waitables
from rclpy.exceptions import InvalidHandle, NotInitializedException
from rclpy.guard_condition import GuardCondition
from rclpy.service import Service
from rclpy.signals import SignalHandlerGuardCondition
from rclpy.subscription import Subscription
from rclpy.task import Future, Task
from rclpy.timer import Timer
from rclpy.utilities import get_default_context, resolve_context, timeout_sec_to_nsec
from rclpy.waitable import NumberOfEntities, Waitable
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from typing_extensions import Self

    from rclpy.handles import ContextHandle
    from rclpy.node import Node

WaitableEntityType = TypeVar("WaitableEntityType")
_Work = tuple[Task[Any], Any, Any]
_ReadyWork = tuple[Task[Any] | None, Any, Any]
_Execution = Callable[[], Coroutine[Any, Any, None]]
_Take = Callable[[Any], _Execution | None]


async def await_or_execute(callback: Callable[..., Any], *args: Any) -> Any:
    """Call a function; if it is async, await the result, and return the result.

    Programs replace this function to see the calls of callbacks; executors use the replacement.
    """
    if inspect.iscoroutinefunction(callback):
        return await callback(*args)
    return callback(*args)


_AWAIT_OR_EXECUTE = await_or_execute


class TimeoutException(Exception):
    """Raised by a wait of an executor when no entity was ready in time."""


class ShutdownException(Exception):
    """Raised when the executor was shut down."""


class ExternalShutdownException(Exception):
    """Raised when the context was shut down."""


class ConditionReachedException(Exception):
    """Raised by a wait of an executor when the wait's condition has become true."""


class TimeoutObject:
    """Timeout in seconds that the program may change between the waits that use it."""

    timeout: float

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout


_Timeout = float | TimeoutObject | None
_SELECTOR_RESOLUTION_S = 0.001
"""Resolution of a selector's timeout, which counts whole milliseconds; a shorter wait is divided into short sleeps."""
_SHORT_SLEEP_S = 0.0005


def _always_false() -> bool:
    return False


class Executor:
    """Base class of executors, which finds ready entities; programs may subclass it and define `spin_once`.

    Args:
        context: an open context. [default: the default context]

    Raises:
        NotInitializedException: the context was never opened.
        RCLError: the context is shut down.
    """

    rosidl_has_one_thread = False

    def __init__(self, *, context: Context | None = None) -> None:
        super().__init__()
        self._context = resolve_context(context)
        if self._context.handle is None:
            raise NotInitializedException("cannot create executor")
        if not self._context.handle.ok():
            raise RCLError("failed to create executor: the context is shut down")
        self._rosidl_handle: ContextHandle = self._context.handle
        self._nodes: set[Node] = set()
        self._nodes_lock = threading.RLock()
        self._tasks: list[_Work] = []
        self._tasks_lock = threading.Lock()
        self._rosidl_spins: list[None] = []  # an element for each spin; its methods are atomic
        self._is_shutdown = False
        self._cb_iter: Iterator[_ReadyWork] | None = None
        self._last_args: tuple[Any, ...] | None = None
        self._last_kwargs: dict[str, Any] | None = None
        self._context.on_shutdown(self.wake)

    @property
    def context(self) -> Context:
        return self._context

    def create_task(
        self, callback: Callable[..., Any] | Coroutine[Any, Any, Any], *args: Any, **kwargs: Any
    ) -> Task[Any]:
        """Schedule a function or coroutine for execution by this executor, and return a future of its result."""
        task: Task[Any] = Task(callback, args, kwargs, executor=self)
        self._rosidl_retain_task(task, None, None)
        self.wake()
        return task

    def create_future(self) -> Future[Any]:
        """Return a future whose callbacks this executor runs."""
        return Future(executor=self)

    @property
    def is_spinning(self) -> bool:
        """True while a thread spins this executor."""
        return bool(self._rosidl_spins)

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Stop the executor: all spinning threads return. Returns True at once, as in rclpy; ignores `timeout_sec`."""
        self._is_shutdown = True
        self.wake()
        with self._nodes_lock:
            self._nodes = set()
        self._cb_iter = self._last_args = self._last_kwargs = None
        return True

    def add_node(self, node: Node) -> bool:
        """Serve a node, which leaves its previous executor; return False if this executor serves the node already."""
        with self._nodes_lock:
            if node in self._nodes:
                return False
            self._nodes.add(node)
        node.executor = self
        self.wake()
        return True

    def remove_node(self, node: Node) -> None:
        """Stop serving a node."""
        with self._nodes_lock:
            if node not in self._nodes:
                return
            self._nodes.remove(node)
        self.wake()

    def wake(self) -> None:
        """Make spinning threads check their conditions again. Thread: any."""
        self._rosidl_handle.notify()

    def get_nodes(self) -> list[Node]:
        return list(self._nodes)

    def spin(self) -> None:
        """Run callbacks until the context or the executor is shut down."""
        self._rosidl_spins.append(None)
        try:
            while self._context.ok() and not self._is_shutdown:
                self.spin_once()
        finally:
            self._rosidl_spins.pop()

    def spin_until_future_complete(self, future: Future[Any], timeout_sec: float | None = None) -> None:
        """Run callbacks until a future is done or cancelled, or the time has passed."""
        self._rosidl_wake_at_end(future)
        end = None if timeout_sec is None or timeout_sec < 0 else self._rosidl_now_s() + timeout_sec
        remaining = None if timeout_sec is None or end is None else TimeoutObject(timeout_sec)
        self._rosidl_spins.append(None)
        try:
            while self._context.ok() and not future.done() and not future.cancelled() and not self._is_shutdown:
                self.spin_once_until_future_complete(future, remaining)
                if end is not None and remaining is not None:
                    remaining.timeout = end - self._rosidl_now_s()
                    if remaining.timeout <= 0:
                        return
        finally:
            self._rosidl_spins.pop()

    def _rosidl_now_s(self) -> float:
        return self._rosidl_handle.loop_runner.loop.time()

    def _rosidl_wake_at_end(self, future: Future[Any]) -> None:
        if isinstance(future, Future):
            future._rosidl_wake_at_end(self.wake)
        else:
            future.add_done_callback(lambda _: self.wake())

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait for one ready callback and run it.

        Args:
            timeout_sec: maximum time to wait; None or negative: unlimited; 0: do not wait.
        """
        self._rosidl_spins.append(None)
        try:
            self._rosidl_spin_once(timeout_sec)
        finally:
            self._rosidl_spins.pop()

    def spin_once_until_future_complete(self, future: Future[Any], timeout_sec: _Timeout = None) -> None:
        """Wait for one ready callback and run it; return without running a callback if a future is done."""
        self._rosidl_wake_at_end(future)
        self._rosidl_spins.append(None)
        try:
            self._rosidl_spin_once(timeout_sec, future.done)
        finally:
            self._rosidl_spins.pop()

    def _rosidl_spin_once(self, timeout_sec: _Timeout = None, condition: Callable[[], bool] = _always_false) -> None:
        raise NotImplementedError

    def _make_handler(self, entity: Any, node: Node) -> Task[Any]:
        async def execute() -> None:
            continuation = execute_entity(self, entity, self._is_shutdown)
            if continuation is not None:
                self._rosidl_retain_task(task, entity, node)
                await continuation

        task: Task[Any] = Task(execute(), executor=self)
        task.rosidl_is_dispatched = True
        return task

    def _rosidl_retain_task(self, task: Task[Any], entity: Any, node: Node | None) -> None:
        with self._tasks_lock:
            self._tasks.append((task, entity, node))

    def rosidl_replaced_take(self, entity: Any) -> _Take | None:
        """Return the method ``_take_...`` for an entity, if the program has replaced that method or `await_or_execute`.

        Otherwise return None. Execution then needs no coroutine, which saves a tenth of the time of a callback.
        """
        name = entity.rosidl_take_method
        take: _Take = getattr(self, name)
        is_replaced = await_or_execute is not _AWAIT_OR_EXECUTE or getattr(take, "__func__", None) is not _TAKES[name]
        return take if is_replaced else None

    def _take_timer(self, tmr: Timer) -> _Execution | None:
        return _calls(tmr.rosidl_take(self))

    def _take_subscription(self, sub: Subscription) -> _Execution | None:
        arguments = sub.rosidl_take_arguments()
        return None if arguments is None else _calls(sub.callback, *arguments)

    def _take_client(self, client: Client) -> _Execution | None:
        call = client.rosidl_take(self)
        if call is None:
            return None

        async def execute() -> None:
            call()

        return execute

    def _take_service(self, srv: Service) -> _Execution | None:
        request = srv.rosidl_take_request()
        if request is None:
            return None

        async def execute() -> None:
            response = await await_or_execute(srv.callback, request.message, srv.srv_type.Response())
            srv.send_response(response, request)

        return execute

    def _take_guard_condition(self, gc: GuardCondition) -> _Execution | None:
        return _calls(gc.rosidl_take(self))

    def _take_waitable(self, waitable: Waitable) -> _Execution | None:
        return waitable.rosidl_take(self)

    def can_execute(self, entity: Any) -> bool:
        """Return True if the callback of an entity may run now: its group allows that, and it is not scheduled yet."""
        return not entity._executor_event and bool(entity.callback_group.can_execute(entity))

    def _rosidl_resumable_tasks(self, nodes: Iterable[Node]) -> Iterator[_Work]:
        """Yield the tasks of nodes that can start or continue, newest first."""
        if not self._tasks:
            return
        with self._tasks_lock:
            tasks = list(self._tasks)
        for task, entity, node in reversed(tasks):
            if (node is None or node in nodes) and task._rosidl_has_resumable_task():
                task.rosidl_is_dispatched = True
                yield task, entity, node
        with self._tasks_lock:
            self._tasks = [work for work in self._tasks if not (work[0].done() or work[0].cancelled())]

    def _rosidl_has_resumable_task(self, nodes: Iterable[Node]) -> bool:
        if not self._tasks:
            return False
        with self._tasks_lock:
            return any(
                task._rosidl_has_resumable_task() and (node is None or node in nodes) for task, _, node in self._tasks
            )

    def _rosidl_wait(
        self, nodes: list[Node] | None, end: float | None, condition: Callable[[], bool]
    ) -> list[tuple[Any, Node]]:
        """Wait for ready entities and return them with their nodes; return [] if something else ends the wait."""
        handle, has_polled, can_execute = self._rosidl_handle, False, self.can_execute
        try:
            while True:
                old_token = handle.change_token
                nodes_to_scan = self.get_nodes() if nodes is None else nodes
                ready, limit, has_waitables = find_ready_entities(nodes_to_scan, can_execute)
                if not has_polled and (end is not None or ready or self._rosidl_has_resumable_task(nodes_to_scan)):
                    has_polled = True
                    handle.loop_runner.wait(timeout_s=0)  # process messages that have arrived since the last wait
                    continue
                if has_waitables:
                    ready = find_ready_waitables(nodes_to_scan, can_execute) + ready
                if (
                    ready
                    or self._is_shutdown
                    or not handle.ok()
                    or condition()
                    or self._rosidl_has_resumable_task(nodes_to_scan)
                ):
                    return ready
                remaining = None if end is None else end - self._rosidl_now_s()
                if remaining is not None and remaining <= 0:
                    return []
                if remaining is not None and (limit is None or remaining < limit):
                    limit = remaining

                def has_changed(old_token: object = old_token) -> bool:
                    return handle.change_token is not old_token or (condition is not _always_false and condition())

                has_polled = True
                handle.loop_runner.wait(
                    has_changed, 0 if limit is not None and limit < _SELECTOR_RESOLUTION_S else limit
                )
                if limit is not None and limit < _SELECTOR_RESOLUTION_S and not has_changed():
                    time.sleep(min(limit, _SHORT_SLEEP_S))
        except runtime.ClosedError:  # shut down during the wait
            return []

    def _wait_for_ready_callbacks(
        self,
        timeout_sec: _Timeout = None,
        nodes: list[Node] | None = None,
        condition: Callable[[], bool] = _always_false,
    ) -> Iterator[_ReadyWork]:
        limit = timeout_sec.timeout if isinstance(timeout_sec, TimeoutObject) else timeout_sec
        end = None if limit is None or limit < 0 else self._rosidl_now_s() + float(limit)
        has_yielded = False
        while not has_yielded and not self._is_shutdown and not condition():
            for work in self._rosidl_resumable_tasks(self.get_nodes() if nodes is None else nodes):
                has_yielded = True
                yield work
            if not self._context.ok():
                activity = "create timer" if limit and limit > 0 else "initialize wait set"
                raise RCLError(f"failed to {activity}: the given context is not valid")
            ready = self._rosidl_wait(nodes, self._rosidl_now_s() if has_yielded else end, condition)
            if self._is_shutdown:
                raise ShutdownException
            if not self._context.ok():
                raise ExternalShutdownException
            for index, (entity, node) in enumerate(ready):  # the first needs no check, as nothing ran since the scan
                if not index or (
                    self.can_execute(entity) and (not isinstance(entity, Timer) or entity.rosidl_is_ready())
                ):
                    has_yielded = True
                    entity._executor_event = True  # not ready again before an item was taken
                    yield None, entity, node
            if not has_yielded and end is not None and self._rosidl_now_s() >= end:
                raise TimeoutException
        if self._is_shutdown:
            raise ShutdownException
        if condition():
            raise ConditionReachedException

    def wait_for_ready_callbacks(self, *args: Any, **kwargs: Any) -> _Work:
        """Return the next task to call, and its entity and node, which may be None.

        The method accepts ``timeout_sec=None`` in seconds (None or negative: unlimited; 0: do not wait), ``nodes=None``
        (by default all nodes of the executor), and ``condition``, a function that ends the wait when it returns True.

        Raises:
            TimeoutException: no entity was ready in time.
            ShutdownException: the executor was shut down.
            ExternalShutdownException: the context was shut down.
            ConditionReachedException: `condition` returned True.
        """
        task, entity, node = self._rosidl_next_work(args, kwargs)
        return self._make_handler(entity, node) if task is None else task, entity, node

    def _rosidl_next_work(self, args: tuple[Any, ...], kwargs: dict[str, Any]) -> _ReadyWork:
        while True:
            if self._cb_iter is None or self._last_args != args or self._last_kwargs != kwargs:
                self._last_args, self._last_kwargs = args, kwargs
                self._cb_iter = self._wait_for_ready_callbacks(*args, **kwargs)
            try:
                return next(self._cb_iter)
            except StopIteration:
                self._cb_iter = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exc_tb: TracebackType | None
    ) -> None:
        self.shutdown()


_TAKES = {name: function for name, function in vars(Executor).items() if name.startswith("_take_")}
_WAIT_FOR_READY_CALLBACKS = Executor.wait_for_ready_callbacks


def _calls(callback: Callable[..., Any] | None, *args: Any) -> _Execution | None:
    """Return a coroutine function that calls a callback by `await_or_execute`; None if the callback is None."""
    if callback is None:
        return None

    async def execute() -> None:
        await await_or_execute(callback, *args)

    return execute


class SingleThreadedExecutor(Executor):
    """Executor that runs callbacks in the spinning thread; exceptions of callbacks leave `spin`."""

    rosidl_has_one_thread = True

    def _rosidl_spin_once(self, timeout_sec: _Timeout = None, condition: Callable[[], bool] = _always_false) -> None:
        wait = self.wait_for_ready_callbacks
        is_replaced = getattr(wait, "__func__", None) is not _WAIT_FOR_READY_CALLBACKS  # by a subclass, or a program
        handler: Task[Any] | None
        try:
            if is_replaced:
                handler, entity, node = wait(timeout_sec, None, condition)
            else:
                handler, entity, node = self._rosidl_next_work((timeout_sec, None, condition), {})
        except (ShutdownException, TimeoutException, ConditionReachedException):
            return
        if handler is None:  # run here, without a task
            continuation = execute_entity(self, entity, self._is_shutdown)
            if continuation is None:
                return
            handler = Task(continuation, executor=self)
            handler.rosidl_is_dispatched = True
            self._rosidl_retain_task(handler, entity, node)
        handler()
        handler.result()


class MultiThreadedExecutor(Executor):
    """Executor that runs callbacks in a thread pool; an exception of a callback leaves a later `spin_once`.

    Args:
        num_threads: size of the pool. [default: number of processors that the process may use]
        context: an open context. [default: the default context]
    """

    def __init__(self, num_threads: int | None = None, *, context: Context | None = None) -> None:
        super().__init__(context=context)
        if num_threads is None:
            affinity = getattr(os, "sched_getaffinity", None)
            num_threads = (len(affinity(0)) if affinity is not None else os.cpu_count()) or 2
        if num_threads == 1:
            text = "MultiThreadedExecutor is used with a single thread.\nUse the SingleThreadedExecutor instead."
            warnings.warn(text, stacklevel=2)
        self._futures: list[Task[Any]] = []
        self._executor = ThreadPoolExecutor(num_threads)

    def shutdown(self, timeout_sec: float | None = None, *, wait_for_threads: bool | None = None) -> bool:
        """Stop the executor: all spinning threads return.

        Args:
            timeout_sec: without effect.
            wait_for_threads: wait for the running callbacks, which must not call this method. [default: do not wait]
        """
        is_done = super().shutdown(timeout_sec)
        if wait_for_threads is not None:
            self._executor.shutdown(wait=wait_for_threads)
        return is_done

    def _rosidl_spin_once(self, timeout_sec: _Timeout = None, condition: Callable[[], bool] = _always_false) -> None:
        try:
            handler, _, _ = self.wait_for_ready_callbacks(timeout_sec, None, condition)
        except (ExternalShutdownException, ShutdownException, TimeoutException, ConditionReachedException):
            return
        self._executor.submit(handler)
        self._futures.append(handler)
        for future in self._futures[:]:
            if future.done():
                self._futures.remove(future)
                future.result()
