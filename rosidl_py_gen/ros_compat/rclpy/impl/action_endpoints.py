"""Endpoints of an action client or server (three services and two topics), and the base class of both."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

from rclpy._rclpy_pybind11 import RCLError
from rclpy.handles import ContextHandle, Destroyable
from rclpy.type_support import check_for_type_support
from rclpy.waitable import Waitable
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.callback_groups import CallbackGroup
    from rclpy.clock import BaseClock
    from rclpy.handles import Handle
    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.service_introspection import ServiceIntrospectionState
    from rclpy.waitable import WaitSet


class ActionEndpoints(Destroyable):
    """Endpoints of one action client or server, created in the runtime's node and closed together."""

    def __init__(self, node: Handle[runtime.Node], name: str) -> None:
        if not name:
            raise ValueError("action name must not be empty")
        super().__init__(node)
        self.context: ContextHandle = node.context
        self._node = node.entity
        self._name = name
        self._endpoints: list[Any] = []

    def create(self, kind: str, type_: Any, name: str, qos: QoSProfile) -> Any:
        """Create a ``client``, ``publisher``, ``service`` or ``subscription`` below the name of the action.

        Services and subscriptions queue what they receive, and wake up executors.
        """
        callback = (None,) if kind in ("service", "subscription") else ()
        create = getattr(self._node, f"create_{kind}")
        endpoint = create(type_, f"{self._name}/_action/{name}", *callback, qos.get_c_qos_profile())
        if callback:
            endpoint.on_ready(self.context.notify)
        self._endpoints.append(endpoint)
        return endpoint

    def configure_introspection(
        self, clock: runtime.Clock, qos: runtime.QoSProfile, state: runtime.IntrospectionState
    ) -> None:
        """Publish requests and responses of the services; `state` selects the contents of the events."""
        for endpoint in self._endpoints:
            if isinstance(endpoint, (runtime.Client, runtime.ServiceServer)):
                endpoint.configure_introspection(clock, qos, state)

    @contextlib.contextmanager
    def in_use(self) -> Iterator[None]:
        """Return a context manager that prevents the destruction of the endpoints in its block.

        It raises RCLError after a shutdown.
        """
        with self:
            try:
                yield
            except runtime.ClosedError as error:
                raise RCLError(str(error)) from error

    @contextlib.contextmanager
    def closing_on_error(self) -> Iterator[ActionEndpoints]:
        """Return a context manager for the creation of endpoints, which closes all of them after an error."""
        try:
            yield self
        except BaseException:
            self.destroy_when_not_in_use()
            raise

    def _destroy(self) -> None:
        for endpoint in reversed(self._endpoints):
            endpoint.close()
        self.context.notify()


class ActionWaitable(Waitable):
    """Base class of action clients and servers: waitable with a node, an action type and endpoints."""

    def __init__(
        self, node: Node, action_type: Any, action_name: str, group: CallbackGroup | None, logger: str
    ) -> None:
        super().__init__(node.default_callback_group if group is None else group)
        check_for_type_support(action_type)
        self._node = node
        self._action_type = action_type
        self._logger = node.get_logger().get_child(logger)
        with node.handle:
            self._rosidl_endpoints = ActionEndpoints(node.handle, action_name)

    def add_to_wait_set(self, wait_set: WaitSet) -> None:
        """Add nothing to the wait set of the executor, because arrivals wake up the executor."""

    def __enter__(self) -> None:
        self._rosidl_endpoints.__enter__()

    def __exit__(self, t: object, v: object, tb: object) -> None:
        self._rosidl_endpoints.__exit__()

    def configure_introspection(
        self, clock: BaseClock, service_event_qos_profile: QoSProfile, introspection_state: ServiceIntrospectionState
    ) -> None:
        """Publish requests and responses of the action's services; `introspection_state` selects the contents."""
        with self._rosidl_endpoints as endpoints:
            endpoints.configure_introspection(
                clock.handle.clock,
                service_event_qos_profile.get_c_qos_profile(),
                runtime.IntrospectionState(int(introspection_state)),
            )

    def destroy(self) -> None:
        """Destroy the action client or server with its endpoints."""
        self._rosidl_endpoints.destroy_when_not_in_use()
        self._node.remove_waitable(self)
