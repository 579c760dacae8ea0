"""Tasks for a changing set of keys, such as topics or nodes, and decoding of messages and requests of viewers.

Small messages are decoded on the event loop, large ones in a thread. The thread is a daemon, because asyncio and the
interpreter would wait for a thread of a pool at exit.
"""

from __future__ import annotations

import asyncio
import threading
import time
from concurrent.futures import Future
from functools import partial
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen import decode, from_json
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr.type_queries import referenced_classes
from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.foxglove import limits

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Coroutine

    from rosidl_py_gen import Message

K = TypeVar("K")


class KeyedTasks(Generic[K]):
    """Tasks by key: ``run(key)`` runs as a task while the key is wanted.

    A task acquires the semaphore `limiter` while it sends requests to nodes.
    """

    def __init__(self, run: Callable[[K], Coroutine[Any, Any, None]], max_concurrent: int = 8) -> None:
        self._run = run
        self.limiter = asyncio.Semaphore(max_concurrent)
        self._tasks: dict[K, asyncio.Task[None]] = {}

    def update(self, wanted: Collection[K]) -> None:
        """Start a task for each new key in `wanted`, and cancel the tasks of keys that `wanted` does not contain."""
        for key in self._tasks.keys() - wanted:
            self._tasks.pop(key).cancel()
        for key in wanted:
            if key not in self._tasks:
                self._tasks[key] = asyncio.ensure_future(self._run(key))

    def forget(self, key: K) -> None:
        """Make the next `update` start a new task for a key, without cancelling the old task."""
        self._tasks.pop(key, None)

    def __contains__(self, key: K) -> bool:
        return key in self._tasks

    async def wait(self, timeout_s: float) -> None:
        """Wait until all tasks have ended, or the timeout has passed."""
        if self._tasks:
            await asyncio.wait(self._tasks.values(), timeout=timeout_s)

    async def close(self) -> None:
        """Cancel all tasks, and wait until they have ended."""
        tasks = [*self._tasks.values()]
        self.update(())
        await asyncio.gather(*tasks, return_exceptions=True)


T = TypeVar("T")
_Job = tuple["Future[Any]", "Callable[[], Any]"]


class Worker:
    """Daemon thread that runs functions in order, and skips functions that were cancelled.

    The thread pauses after each function for as long as the function took, because much of the work holds the GIL.
    """

    def __init__(self) -> None:
        self._jobs: SimpleQueue[_Job | None] = SimpleQueue()
        self._thread: threading.Thread | None = None

    async def run(self, function: Callable[..., T], *args: Any) -> T:
        """Run a function in the thread of the worker and return its result."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="rosidl-py foxglove", daemon=True)
            self._thread.start()
        future: Future[T] = Future()
        self._jobs.put((future, partial(function, *args)))
        return await asyncio.wrap_future(future)

    def _work(self) -> None:
        while job := self._jobs.get():
            future, function = job
            began = time.monotonic()
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(function())
                except BaseException as error:
                    future.set_exception(error)
            del job, future, function  # results may be large
            if (took_s := time.monotonic() - began) > limits.PAUSE_FROM_S:
                time.sleep(took_s)

    def close(self) -> None:
        """Make the thread of the worker end after the queued functions, without waiting for its end."""
        self._jobs.put(None)


class Decoder:
    """Decoder for viewers' messages of one class, which refuses messages whose objects may need too much memory."""

    def __init__(self, cls: type[Message], encoding: str = "cdr") -> None:
        self._cls = cls
        self._is_json = encoding == "json"
        self._has_nested = _has_variable_elements(cls)
        counted: dict[Any, int] = {}
        _count_values(cls, counted)
        self._defaults = max(counted.values())

    async def run(self, data: bytes, worker: Worker, convert: Callable[[Message], T]) -> T:
        """Decode a message and return `convert(message)`; raises `RosidlError` if it is invalid or too large."""
        values = self._require_small(data)
        if max(len(data), values) <= limits.MAX_INLINE:
            return convert(self._decoded(data))
        return await worker.run(lambda: convert(self._decoded(data)))

    def _decoded(self, data: bytes) -> Message:
        if self._is_json:
            return from_json(self._cls, data)
        if self._cls._TYPE.fields:
            return decode(self._cls, data, arrays=True)
        return self._cls()  # viewers do not always encode a message without fields as ROS 2 does

    def _require_small(self, data: bytes) -> int:
        """Raise `CommandError` if a message is too large; return the maximum number of values in JSON, 0 for CDR."""
        if not self._is_json:
            if self._has_nested and len(data) > limits.MAX_NESTED_BYTES:
                most = f"expected at most {limits.MAX_NESTED_BYTES}"
                kind = "a type with a sequence of strings, or of messages that vary in size"
                raise CommandError(f"got {len(data)} bytes, {most} for {kind}")
            return 0
        if len(data) > limits.MAX_TEXT:
            raise CommandError(f"got {len(data)} bytes of JSON, expected at most {limits.MAX_TEXT}; CDR may be larger")
        values = data.count(b"{") * self._defaults
        if values > limits.MAX_DEFAULTS:
            raise CommandError(f"got JSON for up to {values} values, expected at most {limits.MAX_DEFAULTS}; use CDR")
        return values


def _classes(cls: type[Message]) -> list[Any]:
    return [*referenced_classes(cls).values()]


def _has_variable_elements(cls: type[Message]) -> bool:
    """Return True if a class contains elements of varying size: a sequence of strings, or messages with strings or
    sequences.
    """
    fields = [field for one in _classes(cls) for field in one._TYPE.fields]
    elements: list[Any] = [field.cls for field in fields if field.cls and field.type.arity is not Arity.SCALAR]
    return any("string" in field.type.base and field.type.is_sequence for field in fields) or any(
        "string" in field.type.base or field.type.is_sequence
        for element in elements
        for one in _classes(element)
        for field in one._TYPE.fields
    )


def _count_values(cls: Any, counted: dict[Any, int]) -> int:
    """Return how many values a new message of a class has, where eight numbers of an array count as one value.

    `counted` is a cache of the results for the classes inside.
    """
    if cls not in counted:
        total = 1
        for field in cls._TYPE.fields:
            each = _count_values(field.cls, counted) if field.cls else 1
            size = field.type.fixed_count
            total += each * size if field.cls or "string" in field.type.base else 1 + size // 8
        counted[cls] = total
    return counted[cls]
