"""Client for the parameters of another node."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, List, Optional, Union

from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file
from rclpy.qos import QoSProfile, qos_profile_parameter_events, qos_profile_services_default
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.task import Future

if TYPE_CHECKING:
    from rclpy.client import Client

    Callback = Callable[[Future[Any]], Any]


class AsyncParameterClient:
    """Client of the parameter services of another node.

    Each method returns a future of the response; `callback` is called with the future when it is done.
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

        def create(srv_type: Any, name: str) -> Client:
            full = f"{remote_node_name}/{name}"
            client = node.create_client(srv_type, full, qos_profile=qos_profile, callback_group=callback_group)
            self._rosidl_clients.append(client)
            return client

        self._get_parameter_client = create(GetParameters, "get_parameters")
        self._list_parameter_client = create(ListParameters, "list_parameters")
        self._set_parameter_client = create(SetParameters, "set_parameters")
        self._get_parameter_types_client = create(GetParameterTypes, "get_parameter_types")
        self._describe_parameters_client = create(DescribeParameters, "describe_parameters")
        self._set_parameters_atomically_client = create(SetParametersAtomically, "set_parameters_atomically")

    def services_are_ready(self) -> bool:
        """Return True if all six services are available."""
        return all(client.service_is_ready() for client in self._rosidl_clients)

    def wait_for_services(self, timeout_sec: float | None = None) -> bool:
        """Wait until all six services are available; return False if the time has passed. No executor is needed."""
        with self.node.handle as handle:
            return handle.context.wait(self.services_are_ready, timeout_sec)

    @staticmethod
    def _rosidl_send(client: Client, request: Any, callback: Callback | None) -> Future[Any]:
        future: Future[Any] = client.call_async(request)
        if callback:
            future.add_done_callback(callback)
        return future

    def list_parameters(
        self, prefixes: list[str] | None = None, depth: int | None = None, callback: Callback | None = None
    ) -> Future[Any]:
        """Request the names of parameters below prefixes and down to a depth; by default of all parameters."""
        request = ListParameters.Request(prefixes=prefixes or [], depth=depth or 0)
        return self._rosidl_send(self._list_parameter_client, request, callback)

    def get_parameters(self, names: list[str], callback: Callback | None = None) -> Future[Any]:
        return self._rosidl_send(self._get_parameter_client, GetParameters.Request(names=names), callback)

    def set_parameters(self, parameters: Sequence[Any], callback: Callback | None = None) -> Future[Any]:
        """Request to set parameters, each a Parameter or a message, one after the other."""
        request = SetParameters.Request(parameters=_to_messages(parameters))
        return self._rosidl_send(self._set_parameter_client, request, callback)

    def describe_parameters(self, names: list[str], callback: Callback | None = None) -> Future[Any]:
        return self._rosidl_send(self._describe_parameters_client, DescribeParameters.Request(names=names), callback)

    def get_parameter_types(self, names: list[str], callback: Callback | None = None) -> Future[Any]:
        """Request the types of parameters, given by name, as numbers of `Parameter.Type`."""
        return self._rosidl_send(self._get_parameter_types_client, GetParameterTypes.Request(names=names), callback)

    def set_parameters_atomically(self, parameters: Sequence[Any], callback: Callback | None = None) -> Future[Any]:
        """Request to set all given parameters or none, each a Parameter or a message."""
        request = SetParametersAtomically.Request(parameters=_to_messages(parameters))
        return self._rosidl_send(self._set_parameters_atomically_client, request, callback)

    def delete_parameters(self, names: list[str], callback: Callback | None = None) -> Future[Any]:
        """Request to undeclare parameters, which must have a dynamic type."""
        return self.set_parameters([Parameter(name) for name in names], callback)

    def load_parameter_file(
        self, parameter_file: str, use_wildcard: bool = False, callback: Callback | None = None
    ) -> Future[Any]:
        """Request to set the parameters of a file; see `rclpy.parameter.parameter_dict_from_yaml_file`."""
        parameters = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters(list(parameters.values()), callback=callback)

    def load_parameter_file_atomically(
        self, parameter_file: str, use_wildcard: bool = False, callback: Callback | None = None
    ) -> Future[Any]:
        """Request to set all parameters of a file, or none."""
        parameters = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters_atomically(list(parameters.values()), callback=callback)

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
        """Register a function that is called with each rcl_interfaces/ParameterEvent message of any node."""
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


def _to_messages(parameters: Sequence[Any]) -> list[Any]:
    return [item.to_parameter_msg() if isinstance(item, Parameter) else item for item in parameters]
