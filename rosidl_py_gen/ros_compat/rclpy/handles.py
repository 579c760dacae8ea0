"""Handles: what entities hold in the runtime, in use by several threads, and destroyed when none uses it any more.

There is no C below: a handle is a small object around an endpoint of the runtime. `with handle` keeps it from being
destroyed meanwhile, and raises InvalidHandle after it was.
"""

from __future__ import annotations

import contextlib
import threading
import weakref
from collections import deque
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from rclpy._rclpy_pybind11 import InvalidHandle, RCLError
from rclpy.incompatible_qos import Mismatches, WatchedEndpoint
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType

    from typing_extensions import Self


class Closable(Protocol):
    """An endpoint, node or context of the runtime."""

    def close(self) -> None: ...


T = TypeVar("T")
C = TypeVar("C", bound=Closable)
_DESTROYED = "cannot use Destroyable because destruction was requested"


class Destroyable:
    """Counts its users."""

    def __init__(self, parent: Destroyable | None = None) -> None:
        """`parent` is not destroyed before this is."""
        self._users = 0
        self._is_destroyed = self._is_over = False
        self._users_lock = threading.RLock()
        self._parent = parent
        if parent is not None:
            parent.__enter__()

    @property
    def pointer(self) -> int:
        """A number of its own."""
        return id(self)

    @property
    def is_valid(self) -> bool:
        """False once it is to be destroyed."""
        return not self._is_destroyed

    def __enter__(self) -> Self:
        with self._users_lock:
            if self._is_destroyed:
                raise InvalidHandle(_DESTROYED)
            self._users += 1
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None = None,
        error: BaseException | None = None,
        trace: TracebackType | None = None,
    ) -> None:
        with self._users_lock:
            self._users -= 1
            is_to_end = self._is_destroyed
        if is_to_end:
            self._destroy_if_unused()

    def destroy_when_not_in_use(self) -> None:
        """Refuse new uses, and destroy it after the last one under way; may be called twice."""
        with self._users_lock:
            self._is_destroyed = True
        self._destroy_if_unused()

    def _destroy_if_unused(self) -> None:
        with self._users_lock:
            if not self._is_destroyed or self._users or self._is_over:
                return
            self._is_over = True
        self._destroy()
        if self._parent is not None:
            self._parent.__exit__()

    def _destroy(self) -> None:
        """Nobody uses it any more."""


class ContextHandle(Destroyable):
    """What `rclpy.init` opens: a context of the runtime, and the loop that whoever spins runs."""

    def __init__(self, args: list[str], domain_id: int | None) -> None:
        super().__init__()
        self.driver = runtime.LoopRunner()
        try:
            self.runtime = runtime.Context(domain_id, args=args, loop_runner=self.driver)
        except BaseException as error:
            self.driver.close()
            if isinstance(error, runtime.EnvironmentSettingError):
                raise RCLError(f"failed to initialize rcl: {error}") from None
            raise
        self.news: object = None
        """Another object whenever something happened that an executor may wait for."""
        self.mismatches = Mismatches(self.runtime, self.driver, self.notify_arrival)
        self.creating = threading.RLock()
        """Held while an endpoint is created, and while endpoints are counted: the graph shows one before it is
        connected with those that are there, and what is published in between would be lost.
        """
        self._is_ok = True
        self._lock = threading.Lock()
        self._is_closed = False

    def ok(self) -> bool:
        """Whether it was not shut down."""
        return self._is_ok

    def require_ok(self) -> None:
        """Raises RCLError when it was shut down."""
        if not self._is_ok:
            raise RCLError("the context is shut down")

    def get_domain_id(self) -> int:
        """The number of the domain."""
        return self.runtime.domain_id

    def notify_arrival(self) -> None:
        """Something happened; on the loop."""
        self.news = object()
        self.driver.wake()  # here that only asks whether the loop is to be left, in this round of it

    def notify(self) -> None:
        """Something happened: whoever waits looks again. From any thread, and from signal handlers."""
        self.news = object()
        self.driver.wake()

    def mark_shut_down(self) -> None:
        """What a signal handler may do: `ok` is False from now on, and waits end."""
        self._is_ok = False
        self.notify()

    def shutdown(self) -> None:
        """Leave the domain. Raises RCLError when that was done."""
        was_ok = self._is_ok
        self.mark_shut_down()
        self.close()
        if not was_ok:
            raise RCLError("failed to shutdown: rcl_shutdown already called on the given context")

    def close(self) -> None:
        """Leave the domain; may be called twice."""
        with self._lock:
            if self._is_closed:
                return
            self._is_closed = True
        self._is_ok = False
        self.runtime.close()
        self.driver.close()

    def _destroy(self) -> None:
        self.close()

    def wait(self, until: Callable[[], object], timeout_sec: float | None) -> bool:
        """Run the loop until something holds, the context is shut down, or the time has passed; None and negative
        numbers mean for ever. What `until` answers, or raises, at the end.
        """
        limit = None if timeout_sec is None or timeout_sec < 0 or timeout_sec == float("inf") else float(timeout_sec)
        with contextlib.suppress(runtime.ClosedError):
            self.driver.wait(lambda: not self._is_ok or until(), limit)
        return bool(until())


class Handle(Destroyable, Generic[C]):
    """An endpoint of the runtime. One that is deleted without having been destroyed is closed by the loop later.

    Attributes:
        logger_name: of the node's logger.
        events: what happened to the endpoint, as far as somebody wants to know.
        marked: for a node, the kinds of its endpoints (`ready_scan.ServedEntity`) of which some may be ready. Executors
            check no other endpoints.
    """

    def __init__(
        self,
        context: ContextHandle,
        entity: C,
        parent: Destroyable | None = None,
        *,
        logger_name: str = "",
        kind: int = 0,
    ) -> None:
        super().__init__(parent)
        self.context = context
        self.entity = entity
        self.logger_name = logger_name
        self.events: dict[int, deque[Any]] = {}
        self.watched: WatchedEndpoint | None = None
        self._ask: Callable[[], bool] = _never
        self._may_be_ready = False
        self.marked: set[int] = set()
        self._kind = kind
        self._node = parent if isinstance(parent, Handle) else None

    def handle_of(self, entity: Any, kind: int) -> Handle[Any]:
        """Return the handle of an endpoint of this node, which is told when something arrived for it."""
        handle: Handle[Any] = Handle(self.context, entity, self, logger_name=self.logger_name, kind=kind)
        if hasattr(entity, "on_ready"):
            handle.set_ready(partial(_asked, entity))
            entity.on_ready(_teller(handle))
        return handle

    def set_ready(self, is_ready: Callable[[], bool]) -> None:
        """Say how to know whether something can be taken."""
        self._ask = is_ready

    def is_ready(self) -> bool:
        """Whether something can be taken."""
        if not self._may_be_ready or self._is_destroyed:
            return False
        self._may_be_ready = False  # before it is asked: it may arrive meanwhile
        if self._ask():
            self._mark()
        return self._may_be_ready

    def is_ready_marked(self) -> bool:
        """As `is_ready`, without asking: for what is taken by `take_from` alone."""
        if not self._may_be_ready or self._is_destroyed:
            return False
        self._mark()
        return True

    def take_from(self, take: Callable[[C], T]) -> T:
        """Take something; it stays marked where there is more. InvalidHandle when it was destroyed."""
        entity = self.valid()
        self._may_be_ready = False
        found = take(entity)
        if self._ask():
            self._mark()
        return found

    def _mark(self) -> None:
        self._may_be_ready = True
        if self._node is not None:
            self._node.marked.add(self._kind)

    def valid(self) -> C:
        """The endpoint, for one call that copes with being destroyed meanwhile; InvalidHandle when it was destroyed."""
        if self._is_destroyed:
            raise InvalidHandle(_DESTROYED)
        return self.entity

    def notify_arrival(self) -> None:
        """Something may be taken; on the loop."""
        self._may_be_ready = True
        if self._node is not None:
            self._node.marked.add(self._kind)
        self.context.notify_arrival()

    def _destroy(self) -> None:
        self.entity.close()
        self.context.notify()

    def __del__(self) -> None:
        if getattr(self, "_is_over", True):
            return
        self._is_over = self._is_destroyed = True
        with contextlib.suppress(RuntimeError):  # the loop is closed, and the entity with it
            self.context.driver.loop.call_soon_threadsafe(_close, self.entity, self._parent)

    @contextlib.contextmanager
    def in_use(self) -> Iterator[C]:
        """The endpoint, for one use; what the runtime refuses after a shutdown is an RCLError."""
        with self:
            try:
                yield self.entity
            except runtime.ClosedError as error:
                raise RCLError(str(error)) from error

    @contextlib.contextmanager
    def active(self) -> Iterator[C]:
        """As `in_use`; RCLError also when a signal has shut the context down."""
        with self.in_use() as entity:
            self.context.require_ok()
            yield entity


def _never() -> bool:
    return False


_asked = attrgetter("is_ready")


def _teller(handle: Handle[Any]) -> Callable[[], None]:
    """Return a function for an endpoint to call when something arrived; it does not keep the handle."""
    itself = weakref.ref(handle)

    def tell() -> None:
        told = itself()
        if told is not None:
            told.notify_arrival()

    return tell


def _close(entity: Closable, parent: Any) -> None:
    entity.close()
    if parent is not None:
        parent.__exit__()
