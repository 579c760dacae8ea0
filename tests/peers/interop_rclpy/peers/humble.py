"""Substitutes for what rclpy of Humble does not have; imported before the commands.

Humble has no service introspection at all: `ServiceIntrospectionState` is only a name.
"""

import importlib
import sys
import types

from rcl_interfaces import srv
from rclpy.node import Node

CALLS = {
    "get_parameters": ("GetParameters", "names"),
    "get_parameter_types": ("GetParameterTypes", "names"),
    "describe_parameters": ("DescribeParameters", "names"),
    "list_parameters": ("ListParameters", "prefixes"),
    "set_parameters": ("SetParameters", "parameters"),
    "set_parameters_atomically": ("SetParametersAtomically", "parameters"),
}


class AsyncParameterClient:
    """Clients of the parameter services of a node, one for each."""

    def __init__(self, node, name):
        for method, (kind, field) in CALLS.items():
            made = node.create_client(getattr(srv, kind), f"{name}/{method}")
            setattr(self, f"{method}_client", made)
            setattr(self, method, lambda argument, made=made, field=field: self._call(made, field, argument))

    def _call(self, client, field, argument):
        request = client.srv_type.Request()
        if argument is not None:
            items = [one.to_parameter_msg() for one in argument] if field == "parameters" else argument
            setattr(request, field, items)
        return client.call_async(request)

    def services_are_ready(self):
        return all(getattr(self, f"{method}_client").service_is_ready() for method in CALLS)


def names(self):
    return [f"{space.rstrip('/')}/{name}" for name, space in self.get_node_names_and_namespaces()]


def count(list_names):
    def counted(self, wanted):
        nodes = self.get_node_names_and_namespaces()
        return sum(name == wanted for node in nodes for name, _ in getattr(self, list_names)(*node))

    return counted


def module(name, **content):
    made = sys.modules[name] = types.ModuleType(name)
    vars(made).update(content)


if not hasattr(Node, "get_fully_qualified_node_names"):
    module("rclpy.parameter_client", AsyncParameterClient=AsyncParameterClient)
    module("rclpy.service_introspection", ServiceIntrospectionState=None)
    Node.get_fully_qualified_node_names = names
    Node.count_services = count("get_service_names_and_types_by_node")
    Node.count_clients = count("get_client_names_and_types_by_node")
    module_of_infos = importlib.import_module("rclpy.topic_endpoint_info")  # Lyrical has no such module
    module_of_infos.TopicEndpointInfo.topic_type_hash = ""
