"""What nodes announce about the type of one topic, service or action.

Decides which channels tell of it, and how the messages they carry lead to the type: a service is announced as its
request and response, an action as the messages of its two services and its feedback. The hash of a service itself is
announced on Zenoh, in place of those of its messages, and on DDS by nobody; that of an action nowhere.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.graph.graph import BARE_DDS_NODE, UNKNOWN_NODE
from rosidl_py_gen.runtime.names.validation import fully_qualified_node_name
from rosidl_py_gen.runtime.transport.discovery_events import TopicKey

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from rosidl_py_gen.runtime.graph.graph import Graph
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint

TYPE_HASH = re.compile(r"RIHS01_[0-9a-f]{64}\Z")
_DESCRIBER = "/get_type_description"
"""What is behind the name of a node in that of its service."""
_MAX_SHOWN = 5


@dataclass(frozen=True, slots=True)
class TypeQuery:
    """A topic, service or action whose type is asked for.

    Attributes:
        kind: topic, service or action.
        name: fully qualified.
        needed: channels that all have to be there -> what their type has behind the name of the type.
        extra: channels that may be there.
        messages: for each part that makes up the type, the announced messages that contain it, best first; all of them
            by what they have behind the name of the type.
    """

    kind: str
    name: str
    needed: dict[TopicKey, str]
    extra: dict[TopicKey, str]
    messages: dict[str, tuple[str, ...]]


def topic_subject(name: str) -> TypeQuery:
    """What tells the type of a topic, which is given by its fully qualified name."""
    return TypeQuery("topic", name, {TopicKey("topic", name): ""}, {}, {"": ("",)})


def service_subject(name: str, kind: str = "service", behind: str = "") -> TypeQuery:
    """What tells the type of a service, which is given by its fully qualified name."""
    needed = {TopicKey("request", name): f"{behind}_Request", TopicKey("reply", name): f"{behind}_Response"}
    # A ROS 2 node describes neither request nor response, but what it publishes for introspection.
    messages: dict[str, tuple[str, ...]] = {part: (behind, f"{behind}_Event", part) for part in needed.values()}
    events = TopicKey("topic", f"{name}/_service_event")
    return TypeQuery(kind, name, needed, {events: f"{behind}_Event"}, messages)


def action_subject(name: str, send_goal: str, get_result: str, feedback: str) -> TypeQuery:
    """What tells the type of an action, given by its name and those of its services and topic, all fully qualified."""
    halves = (service_subject(send_goal, behind="_SendGoal"), service_subject(get_result, behind="_GetResult"))
    needed = {channel: part for half in halves for channel, part in half.needed.items()}
    messages: dict[str, tuple[str, ...]] = {
        "_Goal": ("_SendGoal", "_SendGoal_Event", "_SendGoal_Request"),
        "_Result": ("_GetResult", "_GetResult_Event", "_GetResult_Response"),
        "_Feedback": ("_FeedbackMessage",),
    }
    extra = {channel: part for half in halves for channel, part in half.extra.items()}
    return TypeQuery("action", name, {**needed, TopicKey("topic", feedback): "_FeedbackMessage"}, extra, messages)


@dataclass(slots=True)
class TypeAnnouncement:
    """What is announced for one type name.

    Attributes:
        hashes: message -> hash, "" where none is announced -> the nodes that announce it, "" those without a name.
    """

    type_name: str
    hashes: dict[str, dict[str, set[str]]] = field(default_factory=dict)

    def of(self, part: str) -> dict[str, set[str]]:
        """The nodes by hash, for a message of the type."""
        told = self.hashes.get(self.type_name + part, {})
        return {text: nodes for text, nodes in told.items() if text}

    def has_hashes(self) -> bool:
        """Whether any endpoint told a hash."""
        return any(text for told in self.hashes.values() for text in told)

    def is_ambiguous(self) -> bool:
        """Whether there are several hashes for one message."""
        return any(len([text for text in told if text]) > 1 for told in self.hashes.values())

    def nodes(self) -> set[str]:
        """All that announce something, as far as their names are known."""
        return {node for told in self.hashes.values() for nodes in told.values() for node in nodes} - {""}

    def has_unnamed(self) -> bool:
        """Whether something is announced by a node whose name is not known (yet)."""
        return any("" in nodes for told in self.hashes.values() for nodes in told.values())

    def lines(self) -> list[str]:
        """What there is, for people."""
        lines = []
        for name, told in sorted(self.hashes.items()):
            for text, nodes in sorted(told.items()):
                who = join_truncated(sorted(printable(node[:300]) or "no name" for node in nodes))
                lines.append(f"{printable(name[:100])} {text or 'without a hash'} ({who})")
        return lines


def provider_participants(graph: Graph, subject: TypeQuery) -> Collection[bytes]:
    """The participants that others get messages, answers or results from; empty when there is none."""
    return {
        endpoint.participant_guid
        for channel in subject.needed
        if channel.kind != "request"  # what clients write
        for endpoint in graph.endpoints_on(channel, writers=True)
    }


def announced(graph: Graph, subject: TypeQuery, only: Collection[bytes] = ()) -> dict[str, TypeAnnouncement]:
    """By type name, all that is announced; a type of another kind has the name that DDS gives it.

    Args:
        only: participants that count; all when it is empty.
    """
    found: dict[str, TypeAnnouncement] = {}
    for channel, part in (*subject.needed.items(), *subject.extra.items()):
        for writers in (True, False):
            for endpoint in graph.endpoints_on(channel, writers=writers):
                if only and endpoint.participant_guid not in only:
                    continue
                told = endpoint.type
                name = told[: len(told) - len(part)] if told.endswith(part) else told
                hashes, node = found.setdefault(name, TypeAnnouncement(name)).hashes, _node_of(graph, endpoint)
                hashes.setdefault(told, defaultdict(set))[_valid(endpoint.type_hash)].add(node)
                service = endpoint.service_type
                if service is not None and _valid(endpoint.service_hash):
                    hashes.setdefault(service, defaultdict(set))[endpoint.service_hash].add(node)
    return found


def is_complete(one: TypeAnnouncement, subject: TypeQuery) -> bool:
    """Whether everything is announced that is needed."""
    return all(one.type_name + part in one.hashes for part in subject.needed.values())


def join_truncated(texts: Iterable[str]) -> str:
    """Not all of them when they are many: a peer decides how many there are."""
    listed = list(texts)
    return ", ".join(listed[:_MAX_SHOWN]) + (f" and {len(listed) - _MAX_SHOWN} more" if listed[_MAX_SHOWN:] else "")


def _valid(type_hash: str) -> str:
    return type_hash if TYPE_HASH.match(type_hash) else ""


def _node_of(graph: Graph, endpoint: DiscoveredEndpoint) -> str:
    """The node's name, "" when it cannot be told.

    With Fast DDS it may come seconds after the endpoint; but where only one node of the participant serves descriptions
    it can only be that one.
    """
    namespace, name = graph.node_of(endpoint)
    if (namespace, name) not in (UNKNOWN_NODE, BARE_DDS_NODE):
        return fully_qualified_node_name(name, namespace)
    participant = endpoint.participant_guid
    names = {
        other.channel.name.removesuffix(_DESCRIBER)
        for other in graph.endpoints.values()
        if other.participant_guid == participant
        and other.is_writer
        and other.channel.kind == "reply"
        and other.channel.name.endswith(_DESCRIBER)
    }
    return names.pop() if len(names) == 1 else ""
