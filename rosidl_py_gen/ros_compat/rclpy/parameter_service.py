"""Services that read and set the parameters of a node."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeVar

from rcl_interfaces.msg import ListParametersResult, SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)

from rclpy.exceptions import ParameterNotDeclaredException, ParameterUninitializedException
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_parameters
from rclpy.validate_topic_name import TOPIC_SEPARATOR_STRING

if TYPE_CHECKING:
    from rclpy.node import BaseNode

_T = TypeVar("_T")


class ParameterService:
    """Parameter services of a node, with which other nodes list, read and set parameters.

    If one of the requested names is unknown, the response contains no values at all.
    """

    def __init__(self, node: BaseNode) -> None:
        self._node_weak_ref = weakref.ref(node)
        for srv_type, name, callback in (
            (DescribeParameters, "describe_parameters", self._describe_parameters_callback),
            (GetParameters, "get_parameters", self._get_parameters_callback),
            (GetParameterTypes, "get_parameter_types", self._get_parameter_types_callback),
            (ListParameters, "list_parameters", self._list_parameters_callback),
            (SetParameters, "set_parameters", self._set_parameters_callback),
            (SetParametersAtomically, "set_parameters_atomically", self._set_parameters_atomically_callback),
        ):
            full = TOPIC_SEPARATOR_STRING.join((node.get_name(), name))
            node.create_service(srv_type, full, callback, qos_profile=qos_profile_parameters)

    def _describe_parameters_callback(self, request: Any, response: Any) -> Any:
        response.descriptors = _get_all_or_empty(self._get_node().describe_parameter, request.names)
        return response

    def _get_parameters_callback(self, request: Any, response: Any) -> Any:
        parameters = _get_all_or_empty(self._get_node().get_parameter, request.names)
        response.values = [parameter.get_parameter_value() for parameter in parameters]
        return response

    def _get_parameter_types_callback(self, request: Any, response: Any) -> Any:
        types = _get_all_or_empty(self._get_node().get_parameter_type, request.names)
        # As in rclpy, get_parameter_type returns a member for an undeclared parameter, else a number.
        response.types = [type_.value if isinstance(type_, Parameter.Type) else type_ for type_ in types]
        return response

    def _list_parameters_callback(self, request: Any, response: Any) -> Any:
        response.result = self._get_node().list_parameters(request.prefixes, request.depth)
        return response

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        response.results = [self._rosidl_set([message]) for message in request.parameters]
        return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        response.result = self._rosidl_set(request.parameters)
        return response

    def _rosidl_set(self, messages: list[Any]) -> Any:
        try:
            parameters = [Parameter.from_parameter_msg(message) for message in messages]
        except ValueError as error:  # an unknown type, which ends the spinning in rclpy
            return SetParametersResult(successful=False, reason=str(error))
        try:
            return self._get_node().set_parameters_atomically(parameters)
        except ParameterNotDeclaredException as error:
            return SetParametersResult(successful=False, reason=str(error))

    def _get_node(self) -> BaseNode:
        node = self._node_weak_ref()
        if node is None:
            raise ReferenceError("Expected valid node weak reference")
        return node


def _get_all_or_empty(get: Callable[[str], _T], names: Iterable[str]) -> list[_T]:
    try:
        return [get(name) for name in names]
    except (ParameterNotDeclaredException, ParameterUninitializedException):
        return []
