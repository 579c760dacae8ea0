"""Types that peers announce, and the service ``~/get_type_description``, with which a node describes its types.

A `TypeQuery` asks for the type of a topic, service or action. A service is announced as its request and response, an
action as the messages of its two services and its feedback. The hash of a service itself is announced on Zenoh only,
instead of the hashes of its messages. The hash of an action is never announced.

The server reports each failure with one of the texts of docs/internals/protocol.md 9.8. The server searches for the
sources of types (definition files) in the bundled interfaces and below AMENT_PREFIX_PATH; a source is empty if there is
no file, or if the file has another definition. A client without hash uses the hash that the node itself announces,
never the hash of a local definition.
"""

from __future__ import annotations

import asyncio
import os
import re
from collections import defaultdict
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import TypeDescriptions
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.resources import DataFolders, GeneratedCode
from rosidl_py_gen.cdr.type_queries import referenced_classes, type_description, type_hash, type_name
from rosidl_py_gen.errors import RosidlError, TypeNotFoundError, printable
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.msgs.type_description_interfaces import msg, srv
from rosidl_py_gen.runtime.entities.message_types import class_of, lazy_service_type, raw_type
from rosidl_py_gen.runtime.entities.services import CallTimeoutError, Client, ServiceServer
from rosidl_py_gen.runtime.names import fully_qualified_node_name
from rosidl_py_gen.runtime.parameters.values import ParameterDescriptor, ParameterType, parameter_value
from rosidl_py_gen.runtime.time_values import Deadline
from rosidl_py_gen.runtime.transport.api import SecurityError, TopicKey
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.graph import Graph
    from rosidl_py_gen.runtime.names import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterStore
    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint

TYPE_HASH = re.compile(r"RIHS01_[0-9a-f]{64}\Z")
_SERVICE_SUFFIX = "/get_type_description"
_MAX_LISTED = 5


@dataclass(frozen=True, slots=True)
class TypeQuery:
    """Topic, service or action whose type is searched for.

    Message types are given by their suffix, such as ``_Request``: the end of their name, after the name of the type.

    Attributes:
        kind: ``topic``, ``service`` or ``action``.
        name: fully qualified name.
        required: topics that must exist, each with the suffix of its message type.
        optional: topics that may exist, each with the suffix of its message type.
        messages: suffix of each section of the type, with the suffixes of the announced messages that contain the
            section, best first.
    """

    kind: str
    name: str
    required: dict[TopicKey, str]
    optional: dict[TopicKey, str]
    messages: dict[str, tuple[str, ...]]


def topic_query(name: str) -> TypeQuery:
    """Return the query for the type of a topic, given by its fully qualified name."""
    return TypeQuery("topic", name, {TopicKey("topic", name): ""}, {}, {"": ("",)})


def service_query(name: str, prefix: str = "") -> TypeQuery:
    """Return the query for the type of a service, given by its fully qualified name.

    Args:
        name: name of the service.
        prefix: precedes all suffixes of message types, such as ``_SendGoal`` for a service of an action.
    """
    required = {TopicKey("request", name): f"{prefix}_Request", TopicKey("reply", name): f"{prefix}_Response"}
    # A ROS 2 node describes neither request nor response, but the events that it publishes for introspection.
    messages = {suffix: (prefix, f"{prefix}_Event", suffix) for suffix in required.values()}
    events = TopicKey("topic", f"{name}/_service_event")
    return TypeQuery("service", name, required, {events: f"{prefix}_Event"}, {**messages})


def action_query(name: str, send_goal: str, get_result: str, feedback: str) -> TypeQuery:
    """Return the query for the type of an action, given by the full names of action, services and feedback topic."""
    goal, result = service_query(send_goal, "_SendGoal"), service_query(get_result, "_GetResult")
    messages: dict[str, tuple[str, ...]] = {
        "_Goal": ("_SendGoal", "_SendGoal_Event", "_SendGoal_Request"),
        "_Result": ("_GetResult", "_GetResult_Event", "_GetResult_Response"),
        "_Feedback": ("_FeedbackMessage",),
    }
    required = goal.required | result.required | {TopicKey("topic", feedback): "_FeedbackMessage"}
    return TypeQuery("action", name, required, goal.optional | result.optional, messages)


@dataclass(slots=True)
class TypeAnnouncement:
    """Announcements of one type by nodes: hashes of its messages, and the nodes that announce them.

    Attributes:
        type_name: name of the topic's, service's or action's type.
        hashes: for each message type, a dict from hash ("" if none is announced) to the names of the announcing nodes
            ("" if unknown).
    """

    type_name: str
    hashes: dict[str, dict[str, set[str]]] = field(default_factory=dict)

    def nodes_by_hash(self, suffix: str) -> dict[str, set[str]]:
        """Return the nodes that announce the message with a suffix such as ``_Request``, as a dict from hash to names
        of nodes.
        """
        by_hash = self.hashes.get(self.type_name + suffix, {})
        return {text: nodes for text, nodes in by_hash.items() if text}

    def has_hashes(self) -> bool:
        """Return True if a hash of any message of the type is announced."""
        return any(text for by_hash in self.hashes.values() for text in by_hash)

    def is_ambiguous(self) -> bool:
        """Return True if several hashes are announced for one message of the type."""
        return any(len([text for text in by_hash if text]) > 1 for by_hash in self.hashes.values())

    def nodes(self) -> set[str]:
        """Return the names of all nodes that announce the type, as far as names are known."""
        return {node for by_hash in self.hashes.values() for nodes in by_hash.values() for node in nodes} - {""}

    def has_unnamed(self) -> bool:
        """Return True if a node whose name is not known (yet) announces the type."""
        return any("" in nodes for by_hash in self.hashes.values() for nodes in by_hash.values())

    def lines(self) -> list[str]:
        """Return the announcements as lines of text: message type, hash and nodes."""
        lines = []
        for name, by_hash in sorted(self.hashes.items()):
            for text, nodes in sorted(by_hash.items()):
                names = join_truncated(sorted(printable(node[:300]) or "no name" for node in nodes))
                lines.append(f"{printable(name[:100])} {text or 'without a hash'} ({names})")
        return lines


def provider_participants(graph: Graph, query: TypeQuery) -> Collection[bytes]:
    """Return the GUIDs of the participants that publish the topic, or serve the service or action, of a query."""
    return {
        endpoint.participant_guid
        for topic_key in query.required
        if topic_key.kind != "request"  # clients write requests
        for endpoint in graph.endpoints_on(topic_key, writers=True)
    }


def participants_of(graph: Graph, query: TypeQuery) -> Collection[bytes]:
    """Return the GUIDs of all participants with an endpoint of a query's topic, service or action."""
    return {
        endpoint.participant_guid
        for topic_key in query.required
        for writers in (True, False)
        for endpoint in graph.endpoints_on(topic_key, writers=writers)
    }


def announced(graph: Graph, query: TypeQuery, participants: Collection[bytes] = ()) -> dict[str, TypeAnnouncement]:
    """Return the announcements for the topic, service or action of a query, by type name.

    A type that is not a ROS type has its DDS type name.

    Args:
        graph: discovered endpoints.
        query: topic, service or action.
        participants: GUIDs of the participants whose announcements count; empty: all participants.
    """
    announcements: dict[str, TypeAnnouncement] = {}
    for topic_key, suffix in (*query.required.items(), *query.optional.items()):
        for endpoint in (*graph.endpoints_on(topic_key, writers=True), *graph.endpoints_on(topic_key, writers=False)):
            if participants and endpoint.participant_guid not in participants:
                continue
            name = endpoint.type.removesuffix(suffix)
            hashes = announcements.setdefault(name, TypeAnnouncement(name)).hashes
            node, service = node_name_of(graph, endpoint), endpoint.service_type
            hashes.setdefault(endpoint.type, defaultdict(set))[_valid(endpoint.type_hash)].add(node)
            if service is not None and _valid(endpoint.service_hash):
                hashes.setdefault(service, defaultdict(set))[endpoint.service_hash].add(node)
    return announcements


def is_complete(announcement: TypeAnnouncement, query: TypeQuery) -> bool:
    """Return True if all messages that a query requires are announced."""
    return all(announcement.type_name + suffix in announcement.hashes for suffix in query.required.values())


def join_truncated(texts: Iterable[str]) -> str:
    """Join texts with commas, but at most five: peers determine how many there are."""
    items = list(texts)
    return ", ".join(items[:_MAX_LISTED]) + (f" and {len(items) - _MAX_LISTED} more" if items[_MAX_LISTED:] else "")


def _valid(type_hash: str) -> str:
    return type_hash if TYPE_HASH.match(type_hash) else ""


def node_name_of(graph: Graph, endpoint: DiscoveredEndpoint) -> str:
    """Return the fully qualified name of an endpoint's node; "" if it is unknown.

    With Fast DDS the name may arrive seconds after the endpoint. But if only one node of the participant serves type
    descriptions, the endpoint is assumed to belong to that node.
    """
    if graph.has_named_node(endpoint):
        namespace, name = graph.node_of(endpoint)
        return fully_qualified_node_name(name, namespace)
    names = {
        other.topic_key.name.removesuffix(_SERVICE_SUFFIX)
        for other in list(graph.endpoints.values())
        if other.participant_guid == endpoint.participant_guid
        and other.is_writer
        and other.topic_key.kind == "reply"
        and other.topic_key.name.endswith(_SERVICE_SUFFIX)
    }
    return names.pop() if len(names) == 1 else ""


# -------------------------------------------------------------------------------------------------------------- service

TYPE_DESCRIPTION_SERVICE = "type_description_interfaces/srv/GetTypeDescription"
ENDPOINTS_TIMEOUT_S = 1.0
"""Maximum time in seconds to wait for the endpoints of a discovered node; they usually arrive some milliseconds after
its name."""
_RETRY_DELAY_S = 1.0
"""Time in seconds without a reply after which a request for a type description is repeated."""
_SENT_POLL_INTERVAL_S = 0.02
_HINTS = {
    "srv": "; a service is announced as its messages: ask for its _Request or _Response, or give the type_hash",
    "action": "; an action is announced as its messages: ask for its _SendGoal_Request, _GetResult_Response or "
    "_FeedbackMessage, or give the type_hash",
}


class TypeDescriptionError(RosidlError, LookupError):
    """Raised if a remote node does not describe a type, or could not be asked; the text contains the reason."""


async def announced_hash(
    scope: EntityScope, node: str, type_name: str, timeout_s: float | None
) -> tuple[str, float | None]:
    """Return the type hash that a node announces for a type, and the time that is left of `timeout_s`.

    Args:
        scope: owner of the entities of the calling node.
        node: fully qualified name of the other node.
        type_name: message type of endpoints, such as ``std_msgs/msg/String``.
        timeout_s: time to wait for the node; None waits forever.

    Raises:
        TypeDescriptionError: the node announces no hash, or several.
        CallTimeoutError: there is no such node.
        InvalidNameError: `type_name` is not a ROS name.
    """
    RosName.parse(type_name)
    namespace, _, name = node.rpartition("/")
    graph, deadline = scope.graph, Deadline(timeout_s)

    def node_exists() -> bool:
        return any(info.fully_qualified_name == node for info in graph.nodes())

    def names_by_hash() -> dict[str, set[str]]:
        return graph.announced_hashes(name, namespace or "/", type_name)

    if not await scope.wait_until(node_exists, timeout_s):
        raise CallTimeoutError(f"no node {node} appeared in {timeout_s} s")
    await scope.wait_until(names_by_hash, deadline.remaining_s(ENDPOINTS_TIMEOUT_S))
    return _only_hash(node, type_name, names_by_hash()), deadline.remaining_s()


def _only_hash(node: str, type_name: str, names_by_hash: dict[str, set[str]]) -> str:
    valid = {text: names for text, names in names_by_hash.items() if TYPE_HASH.match(text)}
    if len(valid) == 1:
        return next(iter(valid))
    if valid:
        items = [f"{text} ({join_truncated(sorted(names))})" for text, names in sorted(valid.items())]
        raise TypeDescriptionError(
            f"{node} announces {len(valid)} type hashes for {type_name}: {join_truncated(items)}; pass type_hash"
        )
    if names_by_hash:
        names = join_truncated(sorted(set().union(*names_by_hash.values())))
        raise TypeDescriptionError(
            f"{node} announces no type hash for {type_name} ({names}), as nodes of ROS 2 Humble do; pass type_hash"
        )
    raise TypeDescriptionError(f"{node} announces no endpoint of {type_name}{_HINTS.get(type_name.split('/')[1], '')}")


async def request_type_description(
    scope: EntityScope,
    service: str,
    type_name: str,
    type_hash: str,
    include_sources: bool,
    timeout_s: float | None,
) -> bytes:
    """Call ``get_type_description`` of a node, and return the encoded response, which may be large.

    Raises:
        CallTimeoutError: the service does not exist, or did not reply in time.
        IncompatibleServiceError: the node uses Fast DDS, and the installed Cyclone DDS cannot call it.
    """
    service_type = lazy_service_type(TYPE_DESCRIPTION_SERVICE)
    client: Client[srv.GetTypeDescription_Request, bytes] = Client(
        scope, replace(service_type, response=raw_type(service_type.response)), service, SERVICES_DEFAULT
    )
    try:
        request = srv.GetTypeDescription_Request(
            type_name=type_name, type_hash=type_hash, include_type_sources=include_sources
        )
        return await _call_with_retry(scope, client, request, timeout_s)
    finally:
        client.close()


async def _call_with_retry(
    scope: EntityScope, client: Client[srv.GetTypeDescription_Request, bytes], request: Any, timeout_s: float | None
) -> bytes:
    """Call a service, repeat the call if no response arrives, and return the first response.

    Fast DDS drops the response to a client that it does not know yet (docs/internals/parity.md).
    """
    calls = [asyncio.ensure_future(client.call(request, timeout_s))]

    def is_sent() -> bool:
        return client.in_flight_count > 0 or calls[0].done()

    try:
        await scope.wait_until(is_sent, timeout_s, poll_s=_SENT_POLL_INTERVAL_S)
        if not (await asyncio.wait(calls, timeout=_RETRY_DELAY_S))[0]:
            calls.append(asyncio.ensure_future(client.call(request, timeout_s)))
        done, _ = await asyncio.wait(calls, return_when=asyncio.FIRST_COMPLETED)
        return min(done, key=lambda call: call.exception() is not None).result()
    finally:
        for call in calls:
            call.cancel()
        await asyncio.gather(*calls, return_exceptions=True)


def decode_description(node: str, data: bytes) -> srv.GetTypeDescription_Response:
    """Decode a response of `request_type_description`.

    Raises:
        TypeDescriptionError: the node reports that it cannot describe the type; the text contains the node's reason.
    """
    response = srv.GetTypeDescription_Response.decode(data)
    if not response.successful:
        raise TypeDescriptionError(f"{node}: {printable(response.failure_reason[:500])}")
    return response


TYPE_DESCRIPTION_PARAMETER = "start_type_description_service"
_BUNDLED = "rosidl_py_gen.msgs"
_MAX_NAME_CHARS = 200
"""Maximum length of a type name that a log entry quotes from a request; names of DDS have at most 255 characters."""
_MEMORY = "rosidl_py_gen_memory."
"""Prefix of the names of the modules that contain classes which were compiled at run time."""
_GETTERS = {"msg": "get_message", "srv": "get_service", "action": "get_action"}


def start_type_descriptions(scope: EntityScope, names: NodeNames, store: ParameterStore) -> None:
    """Declare the parameter `start_type_description_service`, and serve type descriptions of a node if it is true."""
    if not store.has(TYPE_DESCRIPTION_PARAMETER):
        description = "If enabled, start the ~/get_type_description service."
        descriptor = ParameterDescriptor(TYPE_DESCRIPTION_PARAMETER, ParameterType.BOOL, description, read_only=True)
        store.declare(TYPE_DESCRIPTION_PARAMETER, parameter_value(True), descriptor)
    if store.get(TYPE_DESCRIPTION_PARAMETER).value is True:
        name, handler = names.resolve_service("~/get_type_description"), partial(_describe, scope)
        try:
            ServiceServer(scope, lazy_service_type(TYPE_DESCRIPTION_SERVICE), name, handler, SERVICES_DEFAULT)
        except SecurityError as error:  # permissions for nodes of Humble, which do not have this service
            scope.logger.warning(f"types of this node are not described to peers: {error}")


def _describe(scope: EntityScope, request: srv.GetTypeDescription_Request) -> srv.GetTypeDescription_Response:
    if not TYPE_HASH.match(request.type_hash):
        return _failure("Failed to parse type hash")
    reason = "Failed to populate TypeDescription to response."
    try:
        cls = _find_class(scope, request.type_hash)
        if cls is None or not _is_described(cls):
            return _failure("Type not currently in use by this node")
        from rosidl_py_gen import encode, from_dict

        description = from_dict(msg.TypeDescription, type_description(cls))
        response = srv.GetTypeDescription_Response(successful=True, type_description=description)
        encode(response)  # reports what does not fit into a message, such as names of over 255 characters
        if request.include_type_sources:
            reason = "Failed to populate TypeSource_Sequence to response."
            response.type_sources = _sources(cls)
            encode(response)
    except Exception:
        scope.report_failure(f"describing the type {printable(request.type_name, _MAX_NAME_CHARS)} {request.type_hash}")
        return _failure(reason)
    return response


def _find_class(scope: EntityScope, wanted_hash: str) -> type[Any] | None:
    """Return the class of the type with a hash if a node uses the type; None if the node does not use it.

    Raises:
        TypeNotFoundError: the node announces the type, but has no class for it.
    """
    for name, endpoint_hash in _endpoint_types(scope):
        if endpoint_hash == wanted_hash:
            return _load_class(name, wanted_hash)
        service_name = name.removesuffix("_Request")
        if service_name != name:
            service: Any = class_of(service_name, wanted_hash)
            if service is not None and type_hash(service.Request) == endpoint_hash:
                return _load_class(service_name, wanted_hash)
            if (HASHES.get(service_name), HASHES.get(name)) == (wanted_hash, endpoint_hash):
                return _load_class(service_name, wanted_hash)
    actions: Iterator[Any] = (getattr(owned, "action_class", None) for owned in list(scope.owned.values()))
    return next((cls for cls in actions if cls is not None and type_hash(cls) == wanted_hash), None)


def _endpoint_types(scope: EntityScope) -> Iterator[tuple[str, str]]:
    """Yield the announced name and hash of the message type of each endpoint of a node."""
    discovery, graph = scope.discovery, scope.graph
    discovery.refresh()
    for guid in discovery.endpoints_of(scope.number):
        endpoint = graph.endpoints.get(guid)
        if endpoint is not None and "/" in endpoint.type:
            yield endpoint.type, endpoint.type_hash


def _failure(reason: str) -> srv.GetTypeDescription_Response:
    return srv.GetTypeDescription_Response(successful=False, failure_reason=reason)


def _is_described(cls: type[Any]) -> bool:
    """Return False for a class that only forwards serialized messages, whose description has another hash than the
    type.
    """
    return TypeDescriptions.rihs01(type_description(cls)) == type_hash(cls)


def _load_class(name: str, wanted_hash: str) -> type[Any]:
    cls = class_of(name, wanted_hash)
    # None: a lazily imported type without any message until now, for which another node may have a class of bytes.
    if cls is None or (HASHES.get(name) == wanted_hash and not _is_described(cls)):
        package, kind, stem = name.split("/")
        cls = getattr(import_module(f"{_BUNDLED}.{package}.{kind}"), stem)
        if type_hash(cls) != wanted_hash:
            raise TypeNotFoundError(f"{name} with the hash {wanted_hash} is announced, but has no class here")
    return cls


def _sources(cls: type[Any]) -> list[msg.TypeSource]:
    """Return the source (definition file) of a type, then the sources of the types it refers to, sorted by name."""
    top = type_name(cls)
    classes = referenced_classes(cls)
    return [type_source(name, classes[name]) for name in (top, *sorted(set(classes) - {top}))]


def type_source(name: str, cls: type[Any] | None = None) -> msg.TypeSource:
    """Return the source (definition file) of a type; empty if the type is derived from another file, or has no file.

    Args:
        name: name of the type, such as ``pkg/msg/Name``.
        cls: class of the type, which selects one of several definitions with that name.
    """
    package, kind, stem = name.split("/")
    for folder in _interface_folders(package, cls):
        for suffix in (kind, "idl"):
            path = folder / kind / f"{stem}.{suffix}"
            if path.is_file() and _is_from_file(name, cls):
                text = path.read_bytes().decode("utf-8", "replace")
                return msg.TypeSource(type_name=name, encoding=suffix, raw_file_contents=text)
    # X_Request and A_SendGoal are derived from the file of X and A.
    return msg.TypeSource(type_name=name, encoding="implicit" if "_" in stem else kind)


def _interface_folders(package: str, cls: type[Any] | None) -> Iterator[Path]:
    if cls is None or not cls.__module__.startswith((f"{_BUNDLED}.", GeneratedCode.BUNDLED_PREFIX)):
        for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
            if prefix:
                yield Path(prefix) / "share" / package
    yield DataFolders.interfaces() / package


def _is_from_file(name: str, cls: type[Any] | None) -> bool:
    """Return False if the definition from which a class was compiled differs from the definition file of its name."""
    if cls is None or not cls.__module__.startswith(_MEMORY):
        return True
    import rosidl_py_gen

    get: Callable[[str], type[Any]] = getattr(rosidl_py_gen, _GETTERS[name.split("/")[1]])
    return type_hash(get(name)) == type_hash(cls)
