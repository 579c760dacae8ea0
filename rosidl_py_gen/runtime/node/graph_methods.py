"""Graph and type methods of a node: nodes, topics and endpoints, the classes of their types, and type descriptions.

Graph methods have the names and parameters of rclpy. Results contain only what this process has discovered;
`wait_for_node` and `graph_changes` wait for more.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypeVar

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.waiters import blocking
from rosidl_py_gen.cdr import Action, Message, Service
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.runtime.names import normalize_namespace, resolve_node_name
from rosidl_py_gen.runtime.node.context import NodeBase
from rosidl_py_gen.runtime.transport.api import TopicKey
from rosidl_py_gen.runtime.type_descriptions import (
    action_query,
    announced_hash,
    decode_description,
    request_type_description,
    service_query,
    topic_query,
)
from rosidl_py_gen.runtime.type_resolver import TypeResolver

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from rosidl_py_gen.msgs.type_description_interfaces.srv import GetTypeDescription_Response
    from rosidl_py_gen.runtime.graph import Graph, Mismatch, NamesAndTypes, NodeInfo, TopicEndpointInfo
    from rosidl_py_gen.runtime.type_descriptions import TypeQuery
    from rosidl_py_gen.type_loading import SearchFolders


class GraphMethods(NodeBase):
    """Graph methods of `Node`. Each one raises `ClosedError` when the node is closed."""

    def _refreshed_graph(self) -> Graph:
        self._require_open()
        self._scope.discovery.refresh()
        return self._scope.graph

    def get_topic_names_and_types(self, *, no_demangle: bool = False) -> NamesAndTypes:
        """Return all topics with their types; with `no_demangle`, all middleware names, such as ``rt/chatter``."""
        return self._refreshed_graph().topics(demangle=not no_demangle)

    def get_publishers_info_by_topic(self, topic: str, *, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Return node, type, type hash, GID and QoS of each publisher of a topic.

        Args:
            topic: topic name; with `no_mangle`, the name in the middleware, such as ``rt/chatter``.
            no_mangle: do not expand and remap the name.
        """
        return self._topic_infos(topic, no_mangle, writers=True)

    def get_subscriptions_info_by_topic(self, topic: str, *, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Return information on each subscription of a topic, like `get_publishers_info_by_topic`."""
        return self._topic_infos(topic, no_mangle, writers=False)

    def _topic_infos(self, topic: str, no_mangle: bool, *, writers: bool) -> list[TopicEndpointInfo]:
        if not no_mangle:
            return self._infos(self._topic(topic), writers=writers)
        graph = self._refreshed_graph()
        return [graph.endpoint_info(endpoint) for endpoint in graph.endpoints_by_wire_name(topic, writers=writers)]

    def _infos(self, topic_key: TopicKey, *, writers: bool) -> list[TopicEndpointInfo]:
        graph = self._refreshed_graph()
        return [graph.endpoint_info(endpoint) for endpoint in graph.endpoints_on(topic_key, writers=writers)]

    def count_publishers(self, topic: str) -> int:
        """Return the number of publishers of a topic, including writers of DDS programs without ROS."""
        return self._count(self._topic(topic), writers=True)

    def count_subscribers(self, topic: str) -> int:
        """Return the number of subscriptions of a topic, including readers of DDS programs without ROS."""
        return self._count(self._topic(topic), writers=False)

    def _topic(self, topic: str) -> TopicKey:
        return self._topic_key_of("topic", topic, self._names.resolve_topic)

    def _service(self, kind: Literal["request", "reply"], service: str) -> TopicKey:
        return self._topic_key_of(kind, service, self._names.resolve_service)

    def _topic_key_of(
        self, kind: Literal["topic", "request", "reply"], name: str, resolve: Callable[[str], str]
    ) -> TopicKey:
        try:
            return TopicKey(kind, resolve(name))
        except InvalidNameError:  # programs without ROS may use names that ROS refuses
            topic_key, graph = TopicKey(kind, name), self._refreshed_graph()
            if not any(graph.endpoints_on(topic_key, writers=writers) for writers in (True, False)):
                raise
            return topic_key

    def get_service_names_and_types(self) -> NamesAndTypes:
        """Return all services with their types."""
        return self._refreshed_graph().services()

    def count_services(self, service: str) -> int:
        """Return the number of servers of a service; counts the writers of replies, as rmw does."""
        return self._count(self._service("reply", service), writers=True)

    def count_clients(self, service: str) -> int:
        """Return the number of clients of a service, including clients of this node; counts the readers of replies."""
        return self._count(self._service("reply", service), writers=False)

    def get_servers_info_by_service(self, service: str) -> list[TopicEndpointInfo]:
        """Return information on the reply writer of each server of a service."""
        return self._infos(self._service("reply", service), writers=True)

    def get_clients_info_by_service(self, service: str) -> list[TopicEndpointInfo]:
        """Return information on the request writer of each client of a service, including clients of this node."""
        return self._infos(self._service("request", service), writers=True)

    def incompatible_endpoints_of_topic(self, topic: str) -> list[Mismatch]:
        """Return the incompatible pairs of publishers and subscriptions of a topic, of any node."""
        return self._mismatches(self._topic(topic))

    def incompatible_endpoints_of_service(self, service: str) -> list[Mismatch]:
        """Return the incompatible pairs of clients and servers of a service, of any node."""
        return self._mismatches(self._service("request", service))

    def _mismatches(self, topic_key: TopicKey) -> list[Mismatch]:
        self._refreshed_graph()
        return list(self._scope.discovery.mismatches(topic_key))

    def _count(self, topic_key: TopicKey, *, writers: bool) -> int:
        return len(self._refreshed_graph().endpoints_on(topic_key, writers=writers))

    def get_nodes(self) -> list[NodeInfo]:
        """Return name, namespace and enclave of all nodes."""
        return self._refreshed_graph().nodes()

    def node_names_complete(self) -> bool:
        """Return True if all ROS participants have announced their nodes, and each discovered endpoint has its node.

        Node names arrive about 50 ms after endpoints, and later still if a node runs on Fast DDS.
        """
        return self._refreshed_graph().node_names_complete()

    def endpoints_complete(self) -> bool:
        """Return True if all endpoints that nodes announce are discovered.

        Remains False after a node on rmw_cyclonedds of Jazzy has closed a subscription, because the node continues to
        announce the subscription.
        """
        return self._refreshed_graph().endpoints_complete()

    def get_node_names(self) -> list[str]:
        """Return the sorted fully qualified names of all nodes; two nodes of one name are listed twice."""
        return sorted(node.fully_qualified_name for node in self.get_nodes())

    def get_publisher_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Return the topics that a node publishes; empty if there is no such node."""
        return self._of_node(name, namespace, writers=True)

    def get_subscriber_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Return the topics that a node subscribes to; empty if there is no such node."""
        return self._of_node(name, namespace, writers=False)

    def get_service_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Return the services that a node serves; empty if there is no such node."""
        return self._of_node(name, namespace, writers=False, services="request")

    def get_client_names_and_types_by_node(self, name: str, namespace: str = "/") -> NamesAndTypes:
        """Return the services that a node has clients of; empty if there is no such node."""
        return self._of_node(name, namespace, writers=False, services="reply")

    def _of_node(
        self, name: str, namespace: str, *, writers: bool, services: str = "", demangle: bool = True
    ) -> NamesAndTypes:
        graph = self._refreshed_graph()
        if not graph.has_node(name, namespace):  # an existing node may have a namespace that ROS refuses
            namespace = normalize_namespace(namespace)
        return graph.of_node(name, namespace, writers=writers, services=services, demangle=demangle)

    async def wait_for_node(self, name: str, timeout_s: float | None = None) -> Literal[True]:
        """Wait until a node is discovered: ``"name"`` in this node's namespace, or ``"/ns/name"``.

        Raises:
            WaitTimeoutError: the node did not appear within `timeout_s`.
            InvalidNameError: the name is not a node name.
            ClosedError: this node is closed, also while waiting.
        """
        full_name = resolve_node_name(name, self._names.namespace)

        def is_known() -> bool:
            return any(node.fully_qualified_name == full_name for node in self._scope.graph.nodes())

        def missing() -> str:
            names = [node.fully_qualified_name for node in self._scope.graph.nodes()]
            return f"no node {full_name} appeared{did_you_mean(full_name, names, in_namespaces=True)}"

        alone = self._scope.discovery.unmatched.alone
        return await self._scope.wait_or_raise(is_known, timeout_s, missing, why=alone)

    wait_for_node_sync = blocking(wait_for_node)

    async def graph_changes(self) -> AsyncIterator[int]:
        """Yield an increasing number after each change of the graph, or after several quick ones; ends with the node.

        There is no blocking form, because the graph changes on the event loop; `wait_for_node_sync` and
        `wait_for_subscribers_sync` wait for one change.
        """
        scope, graph = self._scope, self._scope.graph
        version = graph.version

        def has_changed() -> bool:
            return scope.closed or graph.version != version

        while not scope.closed:
            scope.loop_binding.running_loop()
            await scope.discovery.changes.wait(has_changed)
            if not scope.closed:
                version = graph.version
                yield version


BaseT = TypeVar("BaseT")


class TypeMethods(NodeBase):
    """Type methods of `Node`. Each one raises `ClosedError` when the node is closed."""

    async def resolve_type(
        self,
        topic: str,
        type_name: str | None = None,
        *,
        type_hash: str | None = None,
        path: SearchFolders = (),
        timeout_s: float | None = None,
    ) -> type[Message]:
        """Return the message class of a topic, from a local definition or the description by another node.

        Waits until a node announces the type. A class of the announced hash that is importable or on the search path is
        used; otherwise one of the nodes is asked for the definition, and its description is cached on disk.
        Descriptions with another hash than the announced one are refused. Nodes of ROS 2 Humble announce no hash: then
        the local definition of that name is used, with a warning.

        Args:
            topic: topic name, which is expanded and remapped.
            type_name: required if the topic has several types.
            type_hash: required if there are several definitions of that type.
            path: folders with interfaces, searched first, as by `get_message`.
            timeout_s: time limit of the whole search; None waits forever.

        Raises:
            TypeDescriptionError: there are several types or hashes, or no node described the announced type.
            TypeNotFoundError: no hash is announced, and there is no local definition.
            CallTimeoutError: no node announced a type within `timeout_s`.
            InvalidNameError: topic or type name is invalid.
            DefinitionError: `path` cannot be read.
        """
        return await self._resolve(
            topic_query(self._names.resolve_topic(topic)), Message, type_name, type_hash, path, timeout_s
        )

    resolve_type_sync = blocking(resolve_type)

    async def resolve_service_type(
        self,
        service: str,
        type_name: str | None = None,
        *,
        type_hash: str | None = None,
        path: SearchFolders = (),
        timeout_s: float | None = None,
    ) -> type[Service[Any, Any]]:
        """Return the class of a service, like `resolve_type`.

        Nodes announce the hashes of request and response, with which a local definition is compared. Nodes of this
        package describe both. Nodes of ROS 2 describe only the whole service, whose hash is not announced: pass it as
        `type_hash`, or switch introspection on in the node.

        Raises:
            TypeDescriptionError: there are several types or hashes, or no node described the announced type.
            TypeNotFoundError: no hash is announced, and there is no local definition.
            CallTimeoutError: no node announced a type within `timeout_s`.
            InvalidNameError: name or type name is invalid.
            DefinitionError: `path` cannot be read.
        """
        return await self._resolve(
            service_query(self._names.resolve_service(service)), Service, type_name, type_hash, path, timeout_s
        )

    resolve_service_type_sync = blocking(resolve_service_type)

    async def resolve_action_type(
        self,
        action: str,
        type_name: str | None = None,
        *,
        type_hash: str | None = None,
        path: SearchFolders = (),
        timeout_s: float | None = None,
    ) -> type[Action[Any, Any, Any]]:
        """Return the class of an action, like `resolve_service_type`, with the same restrictions.

        Raises:
            TypeDescriptionError: there are several types or hashes, or no node described the announced type.
            TypeNotFoundError: no hash is announced, and there is no local definition.
            CallTimeoutError: no node announced a type within `timeout_s`.
            InvalidNameError: name or type name is invalid.
            DefinitionError: `path` cannot be read.
        """
        from rosidl_py_gen.runtime.actions.types import ActionNames

        names = ActionNames.resolve(self._names, action)
        query = action_query(names.action, names.send_goal, names.get_result, names.feedback)
        return await self._resolve(query, Action, type_name, type_hash, path, timeout_s)

    resolve_action_type_sync = blocking(resolve_action_type)

    async def _resolve(
        self,
        query: TypeQuery,
        base: type[BaseT],
        type_name: str | None,
        type_hash: str | None,
        path: SearchFolders,
        timeout_s: float | None,
    ) -> type[BaseT]:
        self._require_open()
        resolver = TypeResolver(self._scope, self._names, query, base, type_name, type_hash, path, timeout_s)
        cls: type[BaseT] = await resolver.run()
        return cls

    async def get_type_description(
        self,
        remote_node: str,
        type_name: str,
        type_hash: str | None = None,
        *,
        include_type_sources: bool = True,
        timeout_s: float | None = None,
    ) -> GetTypeDescription_Response:
        """Request the definition of a type from another node.

        Args:
            remote_node: name of the node, in this node's namespace or fully qualified.
            type_name: message type of an endpoint: ``pkg/msg/Name``, ``pkg/srv/Name_Request``,
                ``pkg/action/Name_FeedbackMessage``. Not used if `type_hash` is given.
            type_hash: None uses the hash that the node announces for endpoints of that type. The hashes of whole
                services and actions are not announced.
            include_type_sources: request the definition files, too.
            timeout_s: None waits forever.

        Raises:
            TypeDescriptionError: the node reports an error, or announces no hash for the type, or several.
            CallTimeoutError: the node or its service did not appear, or did not reply, within `timeout_s`.
            InvalidNameError: node or type name is invalid.
        """
        node = resolve_node_name(remote_node, self._names.namespace)
        service = self._names.resolve_service(f"{node}/get_type_description")
        if type_hash is None:
            type_hash, timeout_s = await announced_hash(self._scope, node, type_name, timeout_s)
        answer = await request_type_description(
            self._scope, service, type_name, type_hash, include_type_sources, timeout_s
        )
        return decode_description(service, answer)

    get_type_description_sync = blocking(get_type_description)
