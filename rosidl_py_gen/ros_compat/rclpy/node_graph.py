"""Mixin of `rclpy.node.Node` that reads the graph."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy._rclpy_pybind11 import NodeNameNonExistentError
from rclpy.expand_topic_name import expand_topic_name
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.validate_full_topic_name import validate_full_topic_name
from rosidl_py_gen.runtime._rclpy_support import wire_topics_of_node

if TYPE_CHECKING:
    from rclpy.handles import Handle
    from rosidl_py_gen import runtime

_NamesAndTypes = list[tuple[str, list[str]]]


class NodeGraph:
    """Methods of `Node` for the graph; after `Node.destroy_node` they raise InvalidHandle."""

    if TYPE_CHECKING:

        @property
        def handle(self) -> Handle[runtime.Node]: ...
        def get_name(self) -> str: ...
        def get_namespace(self) -> str: ...

    def get_node_names(self) -> list[str]:
        """Return the names of all nodes, without namespaces."""
        return [name for name, _ in self.get_node_names_and_namespaces()]

    def get_fully_qualified_node_names(self) -> list[str]:
        """Return the names of all nodes, with namespaces."""
        return [f"{'' if ns == '/' else ns}/{name}" for name, ns in self.get_node_names_and_namespaces()]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(name, namespace) for name, namespace, _ in self.get_node_names_and_namespaces_with_enclaves()]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        with self.handle.in_use() as node:
            return [(info.name, info.namespace, info.enclave) for info in node.get_nodes()]

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait until a node is in the graph, or `timeout` seconds have passed; no executor is needed."""
        name = "/" + fully_qualified_node_name.lstrip("/")
        with self.handle as handle:
            return handle.context.wait(lambda: name in self.get_fully_qualified_node_names(), timeout)

    def _rosidl_names_of_node(
        self, kind: str, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> _NamesAndTypes:
        with self.handle.in_use() as node:
            namespace = node_namespace if node_namespace.startswith("/") else f"/{node_namespace}"
            if not any((info.name, info.namespace) == (node_name, namespace) for info in node.get_nodes()):
                raise NodeNameNonExistentError(
                    f"cannot get {kind} names and types for nonexistent node: {node_name}, in namespace {namespace}"
                )
            if no_demangle and self.handle.context.runtime.middleware == "DDS":
                return wire_topics_of_node(node, node_name, namespace, writers=kind == "publisher")
            names: _NamesAndTypes = getattr(node, f"get_{kind}_names_and_types_by_node")(node_name, namespace)
            return names

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> _NamesAndTypes:
        """Return the topics a node publishes; with `no_demangle` all DDS topics it writes.

        Raises:
            NodeNameNonExistentError: the node is not in the graph.
        """
        return self._rosidl_names_of_node("publisher", node_name, node_namespace, no_demangle)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> _NamesAndTypes:
        """Return the topics a node subscribes to; with `no_demangle` all DDS topics it reads.

        Raises:
            NodeNameNonExistentError: the node is not in the graph.
        """
        return self._rosidl_names_of_node("subscriber", node_name, node_namespace, no_demangle)

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> _NamesAndTypes:
        """Return the services of a node; raise NodeNameNonExistentError if it is not in the graph."""
        return self._rosidl_names_of_node("service", node_name, node_namespace)

    def get_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> _NamesAndTypes:
        """Return the services a node has clients of; raise NodeNameNonExistentError if it is not in the graph."""
        return self._rosidl_names_of_node("client", node_name, node_namespace)

    def get_topic_names_and_types(self, no_demangle: bool = False) -> _NamesAndTypes:
        """Return all topics; with `no_demangle` all DDS topics, which include those of services."""
        with self.handle.in_use() as node:
            return node.get_topic_names_and_types(no_demangle=no_demangle)

    def get_service_names_and_types(self) -> _NamesAndTypes:
        with self.handle.in_use() as node:
            return node.get_service_names_and_types()

    def _rosidl_full_name(self, name: str, *, is_service: bool = False) -> str:
        full = expand_topic_name(name, self.get_name(), self.get_namespace())
        validate_full_topic_name(full, is_service=is_service)
        return full

    def _rosidl_count(self, kind: str, name: str) -> int:
        full = self._rosidl_full_name(name, is_service=kind in ("clients", "services"))
        with self.handle.in_use() as node, self.handle.context.creation_lock:
            count: int = getattr(node, f"count_{kind}")(full)
            return count

    def count_publishers(self, topic_name: str) -> int:
        return self._rosidl_count("publishers", topic_name)

    def count_subscribers(self, topic_name: str) -> int:
        return self._rosidl_count("subscribers", topic_name)

    def count_clients(self, service_name: str) -> int:
        return self._rosidl_count("clients", service_name)

    def count_services(self, service_name: str) -> int:
        return self._rosidl_count("services", service_name)

    def _rosidl_endpoint_infos(self, kind: str, name: str, no_mangle: bool) -> list[TopicEndpointInfo]:
        topic = name if no_mangle else self._rosidl_full_name(name)
        with self.handle.in_use() as node:
            infos: list[Any] = getattr(node, f"get_{kind}_info_by_topic")(topic, no_mangle=no_mangle)
            return [TopicEndpointInfo._rosidl_from_runtime(info) for info in infos]

    def get_publishers_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Return the publishers of a topic; with `no_mangle`, `topic_name` is a DDS topic."""
        return self._rosidl_endpoint_infos("publishers", topic_name, no_mangle)

    def get_subscriptions_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Return the subscriptions of a topic; with `no_mangle`, `topic_name` is a DDS topic."""
        return self._rosidl_endpoint_infos("subscriptions", topic_name, no_mangle)
