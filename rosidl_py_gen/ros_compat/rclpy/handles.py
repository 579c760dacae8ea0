"""Handles of contexts, nodes and endpoints of rosidl_py_gen.runtime, and base classes of the entities that own one:
publishers, subscriptions, clients and services.

A handle counts uses, and closes the object after the last use. ``with handle`` prevents other threads from closing the
object, and raises InvalidHandle after its destruction.
"""

from __future__ import annotations

import contextlib
import threading
import weakref
from collections import deque
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rclpy._rclpy_pybind11 import InvalidHandle, RCLError
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType

    from typing_extensions import Self

    from rclpy.clock import BaseClock
    from rclpy.event_handler import EventHandler
    from rclpy.qos import QoSProfile
    from rclpy.service_introspection import ServiceIntrospectionState

T = TypeVar("T")
C = TypeVar("C", bound=Any)
"""Type variable for the endpoint, node or context that a handle closes."""
_DESTROYED_TEXT = "cannot use Destroyable because destruction was requested"


class Destroyable:
    """Object that counts its uses (``with`` blocks), and is destroyed when no use is left."""

    def __init__(self, parent: Destroyable | None = None) -> None:
        self._users = 0
        self._is_destruction_requested = self._is_destroyed = False
        self._users_lock = threading.RLock()
        self._parent = parent
        if parent is not None:
            parent.__enter__()

    @property
    def pointer(self) -> int:
        """Number that identifies the handle."""
        return id(self)

    @property
    def is_valid(self) -> bool:
        """False after a call of `destroy_when_not_in_use`."""
        return not self._is_destruction_requested

    def __enter__(self) -> Self:
        with self._users_lock:
            if self._is_destruction_requested:
                raise InvalidHandle(_DESTROYED_TEXT)
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
        self._destroy_if_unused()

    def destroy_when_not_in_use(self) -> None:
        """Refuse new uses of the object, and destroy it when the last current use ends; may be called twice."""
        with self._users_lock:
            self._is_destruction_requested = True
        self._destroy_if_unused()

    def _destroy_if_unused(self) -> None:
        with self._users_lock:
            if not self._is_destruction_requested or self._users or self._is_destroyed:
                return
            self._is_destroyed = True
        self._destroy()
        if self._parent is not None:
            self._parent.__exit__()

    def _destroy(self) -> None:
        """Release the resources of the object; called once, when no use is left."""


@contextlib.contextmanager
def denied_as_rcl_error() -> Iterator[None]:
    """Convert the runtime's `SecurityError` in a block to RCLError: security denies the creation of an endpoint."""
    try:
        yield
    except runtime.SecurityError as error:
        raise RCLError(str(error)) from error


class ContextHandle(Destroyable):
    """Handle of a context of rosidl_py_gen.runtime, with the event loop that spinning threads run."""

    def __init__(self, args: list[str], domain_id: int | None) -> None:
        super().__init__()
        self.loop_runner = runtime.LoopRunner()
        try:
            self.runtime = runtime.Context(domain_id, args=args, loop_runner=self.loop_runner)
        except BaseException as error:
            self.loop_runner.close()
            if isinstance(error, (runtime.EnvironmentSettingError, runtime.SecurityError)):
                raise RCLError(f"failed to initialize rcl: {error}") from None
            raise
        self.change_token: object = None
        """Object that is replaced by a new object at each change for which an executor may wait, so that a change can
        be noticed."""
        self._topic_handles: set[weakref.ref[Handle[Any]]] = set()
        """Publishers and subscriptions whose own event callbacks, if they have any, report incompatible peers."""
        self.runtime.on_incompatible_endpoint = self._on_incompatible_endpoint
        self.creation_lock = threading.RLock()
        """Lock for creating and counting endpoints.

        The graph contains an endpoint before it is matched; a program that counts it then and publishes would lose the
        message.
        """
        self._is_ok = True
        self._loop_users = 0
        self._stop_loop_thread = threading.Event()
        self._loop_users_lock = threading.Lock()
        self._lock = threading.Lock()
        self._is_closed = False

    def add_topic_handle(self, handle: Handle[Any]) -> None:
        """Register an endpoint that itself reports incompatible peers on its topic; the context does not log them."""
        self._topic_handles.add(weakref.ref(handle, self._topic_handles.discard))

    def _on_incompatible_endpoint(self, text: str, topic: str) -> None:
        """Log an incompatible peer, unless an endpoint on the topic reports it by its own callbacks. Thread: loop."""
        handles = [reference() for reference in tuple(self._topic_handles)]  # other threads add some
        if all(handle is None or handle.entity.topic != topic for handle in handles):
            runtime.get_logger("rclpy").warning(text)

    def ok(self) -> bool:
        return self._is_ok

    def require_ok(self) -> None:
        """Raise RCLError if the context was shut down."""
        if not self._is_ok:
            raise RCLError("the context is shut down")

    def get_domain_id(self) -> int:
        return self.runtime.domain_id

    def notify(self) -> None:
        """Make waiting executors check their conditions again. Thread: any, and signal handlers."""
        self.change_token = object()
        self.loop_runner.wake()

    def mark_shut_down(self) -> None:
        """Make `ok` return False and end all waits. Thread: any, and signal handlers."""
        self._is_ok = False
        self.notify()

    def shutdown(self) -> None:
        """Leave the domain; raise RCLError if the context was shut down before."""
        was_ok = self._is_ok
        self.mark_shut_down()
        self.close()
        if not was_ok:
            raise RCLError("failed to shutdown: rcl_shutdown already called on the given context")

    def close(self) -> None:
        """Leave the domain and close the event loop; may be called twice."""
        with self._lock:
            if self._is_closed:
                return
            self._is_closed = True
        self._is_ok = False
        self.runtime.close()
        self.loop_runner.close()

    def _destroy(self) -> None:
        self.close()

    def start_loop_thread(self) -> None:
        """Run the event loop in a thread until `stop_loop_thread` has been called as often as this method.

        Executors may run it, too.
        """
        with self._loop_users_lock:
            self._loop_users += 1
            if self._loop_users == 1:
                self._stop_loop_thread = stop = threading.Event()
                threading.Thread(target=self.wait, args=(stop.is_set, None), name="rclpy loop", daemon=True).start()

    def stop_loop_thread(self) -> None:
        with self._loop_users_lock:
            self._loop_users -= 1
            if self._loop_users == 0:
                self._stop_loop_thread.set()
                self.notify()

    def wait(self, until: Callable[[], object], timeout_sec: float | None) -> bool:
        """Run the event loop until `until()` is true, the context is shut down or the time has passed.

        Returns:
            The last result of `until`, as a bool.
        """
        limit = None if timeout_sec is None or timeout_sec == float("inf") else max(0.0, float(timeout_sec))
        with contextlib.suppress(runtime.ClosedError):
            self.loop_runner.wait(lambda: not self._is_ok or until(), limit)
        return bool(until())


class Handle(Destroyable, Generic[C]):
    """Handle of an endpoint or node of rosidl_py_gen.runtime.

    If the handle is deleted without being destroyed, the event loop closes the endpoint.

    Attributes:
        logger_name: name of the node's logger.
        events: queues of reported events, by rcl's number of their kind.
        on_arrival: function that is called after each arrival. Thread: loop.
        marked_kinds: for a node, the kinds of its endpoints, such as ``clients``, of which some may be ready. Executors
            check no other endpoints.
    """

    def __init__(
        self,
        context: ContextHandle,
        entity: C,
        parent: Destroyable | None = None,
        *,
        logger_name: str = "",
        kind: str = "",
    ) -> None:
        super().__init__(parent)
        self.context = context
        self.entity = entity
        self.logger_name = logger_name
        self.events: dict[int, deque[Any]] = {}
        self.on_arrival: Callable[[], object] | None = None
        self._has_more: Callable[[], bool] = lambda: False
        self._may_be_ready = False
        self.marked_kinds: set[str] = set()
        self._kind = kind
        self._node = parent if isinstance(parent, Handle) else None

    def create_endpoint_handle(self, entity: Any, kind: str) -> Handle[Any]:
        """Return the handle of a new endpoint of this node; the endpoint notifies the handle of arrivals."""
        handle: Handle[Any] = Handle(self.context, entity, self, logger_name=self.logger_name, kind=kind)
        if hasattr(entity, "on_ready"):
            handle.set_ready_check(lambda: entity.is_ready)
            entity.on_ready(_weak_notifier(handle))
        return handle

    def set_ready_check(self, is_ready: Callable[[], bool]) -> None:
        """Set the function that returns True if something can be taken from the endpoint."""
        self._has_more = is_ready

    def is_ready(self) -> bool:
        """Return True if something can be taken from the endpoint."""
        if not self._may_be_ready or self._is_destruction_requested:
            return False
        self._may_be_ready = False  # before the check, as a message may arrive during it
        if self._has_more():
            self._mark_ready()
        return self._may_be_ready

    def may_be_ready(self) -> bool:
        """Return True if the endpoint may be ready, without checking it; for endpoints that `take_from` reads."""
        if not self._may_be_ready or self._is_destruction_requested:
            return False
        self._mark_ready()
        return True

    def take_from(self, take: Callable[[C], T]) -> T:
        """Call `take` with the endpoint and return its result; the endpoint stays marked as ready if it has more.

        Raises:
            InvalidHandle: the endpoint was destroyed.
        """
        if self._is_destruction_requested:
            raise InvalidHandle(_DESTROYED_TEXT)
        self._may_be_ready = False
        item = take(self.entity)
        if self._has_more():
            self._mark_ready()
        return item

    def _mark_ready(self) -> None:
        self._may_be_ready = True
        if self._node is not None:
            self._node.marked_kinds.add(self._kind)

    def notify_arrival(self) -> None:
        """Record that something may be taken from the endpoint, and wake up executors. Thread: loop."""
        self._mark_ready()
        self.context.notify()
        if self.on_arrival is not None:
            self.on_arrival()

    def _destroy(self) -> None:
        self.entity.close()
        self.context.notify()

    def __del__(self) -> None:
        if getattr(self, "_is_destroyed", True):
            return
        self._is_destroyed = self._is_destruction_requested = True
        with contextlib.suppress(RuntimeError):  # the loop is closed, and thus the entity
            self.context.loop_runner.loop.call_soon_threadsafe(_close, self.entity, self._parent)

    @contextlib.contextmanager
    def in_use(self, *, require_ok: bool = True) -> Iterator[C]:
        """Return a context manager with the endpoint, which cannot be closed in the block.

        The runtime's errors after a shutdown become RCLError. Without `require_ok`, the endpoint may be used after a
        signal has shut the context down.
        """
        with self:
            if require_ok:
                self.context.require_ok()
            try:
                yield self.entity
            except runtime.ClosedError as error:
                raise RCLError(str(error)) from error


def _weak_notifier(handle: Handle[Any]) -> Callable[[], None]:
    """Return a function that an endpoint calls after an arrival.

    The function refers to the handle weakly, so the handle can be deleted.
    """
    reference = weakref.ref(handle)

    def notify() -> None:
        handle = reference()
        if handle is not None:
            handle.notify_arrival()

    return notify


def _close(entity: Any, parent: Any) -> None:
    entity.close()
    if parent is not None:
        parent.__exit__()


# ------------------------------------------------------------------------------------------------------------- entities


class Entity(Generic[C]):
    """Base of publishers, subscriptions, clients and services of a node."""

    def __init__(self, handle: Handle[C], on_destroy: Callable[[Any], None] | None = None) -> None:
        self._rosidl_handle = handle
        self.rosidl_on_destroy = on_destroy

    @property
    def handle(self) -> Handle[C]:
        return self._rosidl_handle

    @property
    def logger_name(self) -> str:
        """Name of the node's logger."""
        with self.handle as handle:
            return handle.logger_name

    def destroy(self) -> None:
        """Destroy the entity; programs should use the methods of `Node` such as `destroy_publisher`."""
        on_destroy, self.rosidl_on_destroy = self.rosidl_on_destroy, None
        if on_destroy is not None:
            on_destroy(self)
        self.handle.destroy_when_not_in_use()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exc_tb: TracebackType | None
    ) -> None:
        self.destroy()


class TopicEntity(Entity[C]):
    """Base of publishers and subscriptions."""

    def __init__(
        self,
        handle: Handle[C],
        msg_type: type[Any],
        topic: str,
        qos: QoSProfile,
        event_handlers: list[EventHandler],
        on_destroy: Callable[[Any], None] | None = None,
    ) -> None:
        super().__init__(handle, on_destroy)
        self.msg_type = msg_type
        self.topic = topic
        self.qos_profile = qos
        self.event_handlers = event_handlers

    @property
    def topic_name(self) -> str:
        """Name of the topic after expansion and remapping."""
        with self.handle.in_use(require_ok=False) as endpoint:
            return str(endpoint.topic)

    def destroy(self) -> None:
        for handler in self.event_handlers:
            handler.destroy()
        super().destroy()


class ServiceEntity(Entity[C]):
    """Base of clients and servers of services."""

    def __init__(
        self,
        handle: Handle[C],
        srv_type: Any,
        srv_name: str,
        qos: QoSProfile,
        on_destroy: Callable[[Any], None] | None = None,
    ) -> None:
        super().__init__(handle, on_destroy)
        self.rosidl_is_ready = handle.is_ready
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.qos_profile = qos

    @property
    def service_name(self) -> str:
        """Name of the service after expansion and remapping."""
        with self.handle.in_use(require_ok=False) as endpoint:
            return str(endpoint.name)

    def configure_introspection(
        self, clock: BaseClock, service_event_qos_profile: QoSProfile, introspection_state: ServiceIntrospectionState
    ) -> None:
        """Publish requests and responses on ``<service>/_service_event``, with contents as in `introspection_state`."""
        with self.handle.in_use(require_ok=False) as endpoint:
            profile = service_event_qos_profile.get_c_qos_profile()
            state = runtime.IntrospectionState(int(introspection_state))
            endpoint.configure_introspection(clock.handle.clock, profile, state)
