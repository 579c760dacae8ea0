"""Base classes of the entities that own a handle: publishers, subscriptions, clients and services."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from typing_extensions import Self

    from rclpy.clock import BaseClock
    from rclpy.event_handler import EventHandler
    from rclpy.handles import Handle
    from rclpy.qos import QoSProfile
    from rclpy.service_introspection import ServiceIntrospectionState

E = TypeVar("E", bound=Any)


class Entity(Generic[E]):
    """Base of publishers, subscriptions, clients and services of a node."""

    def __init__(self, handle: Handle[E], on_destroy: Callable[[Any], None] | None = None) -> None:
        self._rosidl_handle = handle
        self.rosidl_on_destroy = on_destroy

    @property
    def handle(self) -> Handle[E]:
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


class TopicEntity(Entity[E]):
    """Base of publishers and subscriptions."""

    def __init__(
        self,
        handle: Handle[E],
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


class ServiceEntity(Entity[E]):
    """Base of clients and servers of services."""

    def __init__(
        self,
        handle: Handle[E],
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
