"""Queries for the type of a topic, service or action (`TypeQuery`), and the announcements of nodes about it.

A service is announced as its request and response, an action as the messages of its two services and its feedback. The
hash of a service itself is announced on Zenoh only, instead of the hashes of its messages. The hash of an action is
never announced.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.names.validation import fully_qualified_node_name
from rosidl_py_gen.runtime.transport.api import TopicKey

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from rosidl_py_gen.runtime.graph.graph import Graph
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
