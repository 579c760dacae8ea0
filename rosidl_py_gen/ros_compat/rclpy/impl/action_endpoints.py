"""The five endpoints behind an action client or server: three services and two topics."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any

from rclpy.handles import ContextHandle, Destroyable
from rclpy.type_support import check_for_type_support
from rclpy.waitable import Waitable
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.callback_groups import CallbackGroup
    from rclpy.handles import Handle
    from rclpy.node import Node
    from rclpy.waitable import WaitSet


class ActionEndpoints(Destroyable):
    """Those of one action, made in the runtime's node and closed together."""

    def __init__(self, node: Handle[runtime.Node], name: str) -> None:
        if not name:
            raise ValueError("the name of an action must not be empty")
        super().__init__(node)
        self.context: ContextHandle = node.context
        self._node = node.entity
        self._name = name
        self._made: list[Any] = []

    def client(self, srv_type: Any, part: str, qos: runtime.QoSProfile) -> Any:
        """A client of one of the services."""
        return self._retain(self._node.create_client(srv_type, f"{self._name}/_action/{part}", qos))

    def service(self, srv_type: Any, part: str, qos: runtime.QoSProfile) -> Any:
        """One of the services; requests are taken."""
        return self._with_arrival_hook(self._node.create_service(srv_type, f"{self._name}/_action/{part}", None, qos))

    def subscription(self, msg_type: Any, part: str, qos: runtime.QoSProfile) -> Any:
        """A subscription to one of the topics; messages are taken."""
        return self._with_arrival_hook(
            self._node.create_subscription(msg_type, f"{self._name}/_action/{part}", qos=qos)
        )

    def publisher(self, msg_type: Any, part: str, qos: runtime.QoSProfile) -> Any:
        """A publisher of one of the topics."""
        return self._retain(self._node.create_publisher(msg_type, f"{self._name}/_action/{part}", qos))

    def _retain(self, endpoint: Any) -> Any:
        self._made.append(endpoint)
        return endpoint

    def _with_arrival_hook(self, endpoint: Any) -> Any:
        endpoint.on_ready(self.context.notify_arrival)
        return self._retain(endpoint)

    @contextlib.contextmanager
    def under_construction(self) -> Iterator[ActionEndpoints]:
        """A block that makes them; closes those there are when one cannot be made."""
        try:
            yield self
        except BaseException:
            self.destroy_when_not_in_use()
            raise

    def _destroy(self) -> None:
        for endpoint in reversed(self._made):
            endpoint.close()
        self.context.notify()


class ActionWaitable(Waitable):
    """What clients and servers of actions have in common: a node, a type and endpoints."""

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
        """Nothing to add: what comes wakes the executor by itself."""

    def __enter__(self) -> None:
        self._rosidl_endpoints.__enter__()

    def __exit__(self, t: object, v: object, tb: object) -> None:
        self._rosidl_endpoints.__exit__()

    def destroy(self) -> None:
        """End it."""
        self._rosidl_endpoints.destroy_when_not_in_use()
        self._node.remove_waitable(self)
