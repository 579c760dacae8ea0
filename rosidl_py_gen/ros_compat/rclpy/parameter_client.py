"""Parameters of another node."""

from __future__ import annotations

import time  # noqa: F401
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, List, Optional, Union  # noqa: F401, UP035

from rcl_interfaces.msg import Parameter as ParameterMsg  # noqa: F401  imported from here by programs
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)

from rclpy.callback_groups import CallbackGroup as CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks as SubscriptionEventCallbacks
from rclpy.node import Node as Node
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file
from rclpy.qos import QoSProfile, qos_profile_parameter_events, qos_profile_services_default
from rclpy.qos_overriding_options import QoSOverridingOptions as QoSOverridingOptions
from rclpy.subscription import Subscription as Subscription
from rclpy.task import Future as Future

if TYPE_CHECKING:
    from rclpy.client import Client

    Callback = Callable[[Future[Any]], Any]


class AsyncParameterClient:
    """Asks the parameter services of `remote_node_name`; futures give their responses once an executor took them.

    Each method takes a `callback` that is called with the future when that is done.
    """

    def __init__(
        self,
        node: Node,
        remote_node_name: str,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> None:
        self.remote_node_name = remote_node_name
        self.node = node
        self._rosidl_clients: list[Client] = []

        def client(srv_type: Any, name: str) -> Client:
            full = f"{remote_node_name}/{name}"
            made = node.create_client(srv_type, full, qos_profile=qos_profile, callback_group=callback_group)
            self._rosidl_clients.append(made)
            return made

        self._get_parameter_client = client(GetParameters, "get_parameters")
        self._list_parameter_client = client(ListParameters, "list_parameters")
        self._set_parameter_client = client(SetParameters, "set_parameters")
        self._get_parameter_types_client = client(GetParameterTypes, "get_parameter_types")
        self._describe_parameters_client = client(DescribeParameters, "describe_parameters")
        self._set_parameters_atomically_client = client(SetParametersAtomically, "set_parameters_atomically")

    def services_are_ready(self) -> bool:
        """Whether all six services are there."""
        return all(client.service_is_ready() for client in self._rosidl_clients)

    def wait_for_services(self, timeout_sec: float | None = None) -> bool:
        """Wait until they are; None means for ever. Needs no executor. False when the time passed."""
        with self.node.handle as handle:
            return handle.context.wait(self.services_are_ready, None if timeout_sec is None else max(0.0, timeout_sec))

    @staticmethod
    def _rosidl_send(client: Client, request: Any, callback: Callback | None) -> Future[Any]:
        future: Future[Any] = client.call_async(request)
        if callback:
            future.add_done_callback(callback)
        return future

    def list_parameters(
        self, prefixes: list[str] | None = None, depth: int | None = None, callback: Callback | None = None
    ) -> Future[Any]:
        """Which parameters there are, below prefixes and down to a depth; by default all."""
        request = ListParameters.Request(prefixes=prefixes or [], depth=depth or 0)
        return self._rosidl_send(self._list_parameter_client, request, callback)

    def get_parameters(self, names: list[str], callback: Callback | None = None) -> Future[Any]:
        """Values by name."""
        return self._rosidl_send(self._get_parameter_client, GetParameters.Request(names=names), callback)

    def set_parameters(self, parameters: Sequence[Any], callback: Callback | None = None) -> Future[Any]:
        """Set each, as Parameter or as message."""
        request = SetParameters.Request(parameters=_messages(parameters))
        return self._rosidl_send(self._set_parameter_client, request, callback)

    def describe_parameters(self, names: list[str], callback: Callback | None = None) -> Future[Any]:
        """Descriptors by name."""
        return self._rosidl_send(self._describe_parameters_client, DescribeParameters.Request(names=names), callback)

    def get_parameter_types(self, names: list[str], callback: Callback | None = None) -> Future[Any]:
        """Types by name, as numbers of `Parameter.Type`."""
        return self._rosidl_send(self._get_parameter_types_client, GetParameterTypes.Request(names=names), callback)

    def set_parameters_atomically(self, parameters: Sequence[Any], callback: Callback | None = None) -> Future[Any]:
        """Set all of them or none, each as Parameter or as message."""
        request = SetParametersAtomically.Request(parameters=_messages(parameters))
        return self._rosidl_send(self._set_parameters_atomically_client, request, callback)

    def delete_parameters(self, names: list[str], callback: Callback | None = None) -> Future[Any]:
        """Undeclare them; only those of dynamic type can be."""
        return self.set_parameters([Parameter(name) for name in names], callback)

    def load_parameter_file(
        self, parameter_file: str, use_wildcard: bool = False, callback: Callback | None = None
    ) -> Future[Any]:
        """Set what `rclpy.parameter.parameter_dict_from_yaml_file` reads."""
        found = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters(list(found.values()), callback=callback)

    def load_parameter_file_atomically(
        self, parameter_file: str, use_wildcard: bool = False, callback: Callback | None = None
    ) -> Future[Any]:
        """The same, all or none."""
        found = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters_atomically(list(found.values()), callback=callback)

    def on_parameter_event(
        self,
        callback: Callable[..., Any],
        qos_profile: QoSProfile = qos_profile_parameter_events,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
        raw: bool = False,
    ) -> Subscription:
        """Have every rcl_interfaces/ParameterEvent of all nodes."""
        return self.node.create_subscription(
            ParameterEvent,
            "/parameter_events",
            callback,
            qos_profile,
            callback_group=callback_group,
            event_callbacks=event_callbacks,
            qos_overriding_options=qos_overriding_options,
            raw=raw,
        )


def _messages(parameters: Sequence[Any]) -> list[Any]:
    return [one.to_parameter_msg() if isinstance(one, Parameter) else one for one in parameters]
