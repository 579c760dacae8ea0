"""The questions a node can ask about the graph.

Decides names and arguments as ROS users know them; the answers are computed by `graph/state.py`. What is not
discovered yet is not in the answers: use the waiting ones, or `graph_changes`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.names.dds import topic_name
from rosidl_py_gen.runtime.names.rules import normalize_namespace, resolve_node_name

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.graph.discovery import Discovery
    from rosidl_py_gen.runtime.graph.state import Graph, NamesAndTypes, NodeInfo, TopicEndpointInfo
    from rosidl_py_gen.runtime.names.remap import NodeNames


class NodeGraph:
    """Graph methods of `Node`. Each one raises `ClosedError` when the node is closed."""

    scope: Scope
    _closed: bool
    _graph: Graph
    _discovery: Discovery
    _names: NodeNames

    if TYPE_CHECKING:

        def _require_open(self) -> None: ...

    def _look(self) -> Graph:
        """The graph as it is now."""
        self._require_open()
        self._discovery.refresh()
        return self._graph

    # ------------------------------------------------------------------------------------------------------- topics

    def get_topic_names_and_types(self, *, no_demangle: bool = False) -> NamesAndTypes:
        """All topics, each with its types; `no_demangle` gives every DDS topic as it is called there."""
        return self._look().topics(demangle=not no_demangle)

    def get_publishers_info_by_topic(self, topic: str, *, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Every publisher of a topic: node, type, hash, GID, QoS. `no_mangle`: `topic` is a DDS name."""
        return self._look().endpoint_infos(self._dds_topic(topic, no_mangle), writers=True)

    def get_subscriptions_info_by_topic(self, topic: str, *, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Every subscription of a topic; see `get_publishers_info_by_topic`."""
        return self._look().endpoint_infos(self._dds_topic(topic, no_mangle), writers=False)

    def count_publishers(self, topic: str) -> int:
        """How many publishers a topic has, bare DDS ones included."""
        return len(self.get_publishers_info_by_topic(topic))

    def count_subscribers(self, topic: str) -> int:
        """How many subscriptions a topic has, bare DDS ones included."""
        return len(self.get_subscriptions_info_by_topic(topic))

    def _dds_topic(self, topic: str, no_mangle: bool) -> str:
        return topic if no_mangle else topic_name(self._names.resolve_topic(topic))

    # ----------------------------------------------------------------------------------------------------- services

    def get_service_names_and_types(self) -> NamesAndTypes:
        """All services, each with its types."""
        return self._look().services()

    # -------------------------------------------------------------------------------------------------------- nodes

    def get_nodes(self) -> list[NodeInfo]:
        """All nodes: name, namespace, enclave."""
        return self._look().nodes()

    def get_node_names(self) -> list[str]:
        """Fully qualified names of all nodes, sorted; two nodes of one name are listed twice."""
        return sorted(node.fully_qualified_name for node in self.get_nodes())

    def get_publisher_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Topics a node publishes; empty when there is no such node."""
        return self._look().of_node(name, normalize_namespace(namespace), writers=True)

    def get_subscriber_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Topics a node subscribes to; empty when there is no such node."""
        return self._look().of_node(name, normalize_namespace(namespace), writers=False)

    def get_service_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Services a node offers; empty when there is no such node."""
        return self._look().of_node(name, normalize_namespace(namespace), writers=False, services="rq")

    def get_client_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Services a node has clients of; empty when there is no such node."""
        return self._look().of_node(name, normalize_namespace(namespace), writers=False, services="rr")

    # ------------------------------------------------------------------------------------------------------ waiting

    async def wait_for_node(self, name: str, timeout_s: float | None = None) -> bool:
        """Wait until a node is known: ``"name"`` in this node's namespace, or ``"/ns/name"``; False when time
        passed. Raises `InvalidNameError`, `ClosedError`.
        """
        wanted = resolve_node_name(name, self._names.namespace)

        def known() -> bool:
            return any(node.fully_qualified_name == wanted for node in self._graph.nodes())

        return await self.scope.wait_until(known, timeout_s, lambda: self._closed)

    async def graph_changes(self) -> AsyncIterator[int]:
        """Yield a growing number after every change of the graph, several quick ones at once; ends with the node."""
        seen = self._graph.version

        def has_changed() -> bool:
            return self._closed or self._graph.version != seen

        while not self._closed:
            self.scope.bridge.running_loop()
            await self._discovery.changes.wait(has_changed)
            if not self._closed:
                seen = self._graph.version
                yield seen
