"""The questions a node can ask about the graph.

Decides names and arguments as ROS users know them; the answers are computed by `graph/graph.py`. What is not
discovered yet is not in the answers: use the waiting ones, or `graph_changes`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from rosidl_py_gen.base.names import similar_name
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.runtime.loop.blocking import blocking
from rosidl_py_gen.runtime.names.validation import normalize_namespace, resolve_node_name
from rosidl_py_gen.runtime.transport.discovery_events import TopicKey

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.graph.graph import Graph, Mismatch, NamesAndTypes, NodeInfo, TopicEndpointInfo
    from rosidl_py_gen.runtime.names.remapping import NodeNames
    from rosidl_py_gen.runtime.node.context import Context


class GraphMethods:
    """Graph methods of `Node`. Each one raises `ClosedError` when the node is closed."""

    _scope: EntityScope
    context: Context
    _names: NodeNames

    if TYPE_CHECKING:

        def _require_open(self) -> None: ...

    def _refreshed_graph(self) -> Graph:
        """The graph as it is now."""
        self._require_open()
        self._scope.discovery.refresh()
        return self._scope.graph

    # ------------------------------------------------------------------------------------------------------- topics

    def get_topic_names_and_types(self, *, no_demangle: bool = False) -> NamesAndTypes:
        """All topics, each with its types; `no_demangle` gives every name as the middleware has it."""
        return self._refreshed_graph().topics(demangle=not no_demangle)

    def get_publishers_info_by_topic(self, topic: str, *, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Every publisher of a topic: node, type, hash, GID, QoS. `no_mangle`: `topic` is the middleware's name."""
        return self._infos(topic, no_mangle, writers=True)

    def get_subscriptions_info_by_topic(self, topic: str, *, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Every subscription of a topic; see `get_publishers_info_by_topic`."""
        return self._infos(topic, no_mangle, writers=False)

    def _infos(self, topic: str, no_mangle: bool, *, writers: bool) -> list[TopicEndpointInfo]:
        graph = self._refreshed_graph()
        if no_mangle:
            return graph.endpoint_infos(graph.endpoints_by_wire_name(topic, writers=writers))
        return graph.endpoint_infos(graph.endpoints_on(self._topic(topic), writers=writers))

    def count_publishers(self, topic: str) -> int:
        """How many publishers a topic has, bare DDS ones included."""
        return self._count(self._topic(topic), writers=True)

    def count_subscribers(self, topic: str) -> int:
        """How many subscriptions a topic has, bare DDS ones included."""
        return self._count(self._topic(topic), writers=False)

    def _topic(self, topic: str) -> TopicKey:
        return self._channel("topic", topic, self._names.resolve_topic)

    def _service(self, kind: Literal["request", "reply"], service: str) -> TopicKey:
        return self._channel(kind, service, self._names.resolve_service)

    def _channel(
        self, kind: Literal["topic", "request", "reply"], name: str, resolve: Callable[[str], str]
    ) -> TopicKey:
        try:
            return TopicKey(kind, resolve(name))
        except InvalidNameError:  # programs that know nothing of ROS use names that ROS refuses
            channel, graph = TopicKey(kind, name), self._refreshed_graph()
            if not any(graph.endpoints_on(channel, writers=writers) for writers in (True, False)):
                raise
            return channel

    # ----------------------------------------------------------------------------------------------------- services

    def get_service_names_and_types(self) -> NamesAndTypes:
        """All services, each with its types."""
        return self._refreshed_graph().services()

    def count_services(self, service: str) -> int:
        """How many servers a service has: they write replies, where rmw counts them, too."""
        return self._count(self._service("reply", service), writers=True)

    def count_clients(self, service: str) -> int:
        """How many clients a service has, those of this node included: they read replies."""
        return self._count(self._service("reply", service), writers=False)

    def get_servers_info_by_service(self, service: str) -> list[TopicEndpointInfo]:
        """Every server of a service, by what it writes its responses with."""
        graph = self._refreshed_graph()
        return graph.endpoint_infos(graph.endpoints_on(self._service("reply", service), writers=True))

    def get_clients_info_by_service(self, service: str) -> list[TopicEndpointInfo]:
        """Every client of a service, those of this node included, by what it writes its requests with."""
        graph = self._refreshed_graph()
        return graph.endpoint_infos(graph.endpoints_on(self._service("request", service), writers=True))

    # --------------------------------------------------------------------------------------------------- mismatches

    def incompatible_endpoints_of_topic(self, topic: str) -> list[Mismatch]:
        """Publishers and subscriptions of a topic that do not understand each other, whoever has them."""
        return self._mismatches(self._topic(topic))

    def incompatible_endpoints_of_service(self, service: str) -> list[Mismatch]:
        """Clients and servers of a service that do not understand each other, whoever has them."""
        return self._mismatches(self._service("request", service))

    def _mismatches(self, channel: TopicKey) -> list[Mismatch]:
        self._refreshed_graph()
        return list(self._scope.discovery.mismatches(channel))

    def _count(self, channel: TopicKey, *, writers: bool) -> int:
        return len(self._refreshed_graph().endpoints_on(channel, writers=writers))

    # -------------------------------------------------------------------------------------------------------- nodes

    def get_nodes(self) -> list[NodeInfo]:
        """All nodes: name, namespace, enclave."""
        return self._refreshed_graph().nodes()

    def node_names_complete(self) -> bool:
        """Whether every participant of ROS has told its nodes, and every endpoint found belongs to one of them.

        Names follow endpoints by some 50 ms, those of nodes on Fast DDS by more.
        """
        return self._refreshed_graph().node_names_complete()

    def endpoints_complete(self) -> bool:
        """Whether every endpoint that nodes have told of was found.

        It stays untrue where a node on rmw_cyclonedds of Jazzy has closed a subscription, of which it tells on.
        """
        return self._refreshed_graph().endpoints_complete()

    def get_node_names(self) -> list[str]:
        """Fully qualified names of all nodes, sorted; two nodes of one name are listed twice."""
        return sorted(node.fully_qualified_name for node in self.get_nodes())

    def get_publisher_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Topics a node publishes; empty when there is no such node."""
        return self._of_node(name, namespace, writers=True)

    def get_subscriber_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Topics a node subscribes to; empty when there is no such node."""
        return self._of_node(name, namespace, writers=False)

    def get_service_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Services a node offers; empty when there is no such node."""
        return self._of_node(name, namespace, writers=False, services="request")

    def get_client_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Services a node has clients of; empty when there is no such node."""
        return self._of_node(name, namespace, writers=False, services="reply")

    def _of_node(self, name: str, namespace: str, *, writers: bool, services: str = "") -> NamesAndTypes:
        graph = self._refreshed_graph()
        if not graph.has_node(name, namespace):  # one that is there may have a namespace that ROS refuses
            namespace = normalize_namespace(namespace)
        return graph.of_node(name, namespace, writers=writers, services=services)

    # ------------------------------------------------------------------------------------------------------ waiting

    async def wait_for_node(self, name: str, timeout_s: float | None = None) -> Literal[True]:
        """Wait until a node is known: ``"name"`` in this node's namespace, or ``"/ns/name"``.

        Raises:
            WaitTimeoutError: it did not appear in time. InvalidNameError, ClosedError: as their names say.
        """
        wanted = resolve_node_name(name, self._names.namespace)

        def known() -> bool:
            return any(node.fully_qualified_name == wanted for node in self._scope.graph.nodes())

        def missing() -> str:
            names = [node.fully_qualified_name for node in self._scope.graph.nodes()]
            return f"no node {wanted} appeared{similar_name(wanted, names)}"

        alone = self._scope.discovery.unmatched.alone
        return await self._scope.wait_or_raise(known, timeout_s, lambda: self._scope.closed, missing, why=alone)

    wait_for_node_sync = blocking(wait_for_node)

    async def graph_changes(self) -> AsyncIterator[int]:
        """Yield a growing number after every change of the graph, several quick ones at once; ends with the node."""
        scope, graph = self._scope, self._scope.graph
        seen = graph.version

        def has_changed() -> bool:
            return scope.closed or graph.version != seen

        while not scope.closed:
            scope.bridge.running_loop()
            await scope.discovery.changes.wait(has_changed)
            if not scope.closed:
                seen = graph.version
                yield seen
