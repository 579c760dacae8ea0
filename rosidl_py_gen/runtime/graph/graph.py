"""The ROS graph: nodes, topics, services and endpoints, as a plain object fed with discovery events.

Decides how endpoints and what participants tell of their nodes combine into what ROS shows
(docs/internals/protocol.md 6.3, 6.4). No I/O, no waiting: `discovery.py` feeds it, `node/graph_methods.py` asks it.
`version` grows with every change.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Literal

from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.names.validation import fully_qualified_node_name
from rosidl_py_gen.runtime.transport.discovery_events import (
    DiscoveredEndpoint,
    EntityLost,
    NodesAnnounced,
    ParticipantDiscovered,
    TopicKey,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveryEvent, NodeEntities
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

UNKNOWN_NODE = ("_NODE_NAMESPACE_UNKNOWN_", "_NODE_NAME_UNKNOWN_")
_MAX_TEXT = 600
"""Number of characters of a name that texts show; ROS allows 255 for a node and 245 for its namespace."""
BARE_DDS_NODE = ("_CREATED_BY_BARE_DDS_APP_", "_CREATED_BY_BARE_DDS_APP_")
NamesAndTypes = list[tuple[str, list[str]]]


class EndpointType(IntEnum):
    """Numbers of rmw."""

    INVALID = 0
    PUBLISHER = 1
    SUBSCRIPTION = 2


@dataclass(frozen=True, slots=True)
class NodeInfo:
    """One node as its participant announces it."""

    name: str
    namespace: str
    enclave: str

    @property
    def fully_qualified_name(self) -> str:
        """``/ns/name``."""
        return fully_qualified_node_name(self.name, self.namespace)


@dataclass(frozen=True, slots=True)
class TopicEndpointInfo:
    """One publisher or subscription, as `ros2 topic info --verbose` shows it; or what a client or server writes.

    Attributes:
        topic_type: ``pkg/msg/Name``, or the DDS type name when it has no ROS shape.
        topic_type_hash: RIHS01 text, empty when the endpoint does not tell (Humble, bare DDS).
        endpoint_gid: 16 bytes.
        qos_profile: as discovered; unset durations are infinite.
        participant_guid: of the member of the domain it belongs to; see `Context.participants`.
    """

    node_name: str
    node_namespace: str
    topic_type: str
    topic_type_hash: str
    endpoint_type: EndpointType
    endpoint_gid: bytes
    qos_profile: QoSProfile
    participant_guid: bytes = b""

    @property
    def has_node_name(self) -> bool:
        """Whether its node is known; the names of nodes follow their endpoints, and some programs have none."""
        return (self.node_namespace, self.node_name) not in (UNKNOWN_NODE, BARE_DDS_NODE)

    @property
    def node_text(self) -> str:
        """``/ns/name`` of its node, or in words why there is none."""
        if self.has_node_name:
            return fully_qualified_node_name(self.node_name, self.node_namespace)
        return "(DDS program without node)" if self.node_name == BARE_DDS_NODE[1] else "(unknown node)"


@dataclass(frozen=True, slots=True)
class Mismatch:
    """A publisher and a subscription of one topic, or a client and a server, that do not understand each other.

    Attributes:
        writer: what sends the messages, or the requests.
        reader: what should receive them.
        kind: whether their types differ, the definitions of one type, or their quality of service.
        reason: in words.
    """

    writer: TopicEndpointInfo
    reader: TopicEndpointInfo
    kind: Literal["type", "definition", "qos"]
    reason: str


@dataclass(frozen=True, slots=True)
class ParticipantInfo:
    """One member of the domain; usually a process.

    Attributes:
        guid: 16 bytes; the first two are the number of the vendor.
        is_ros: it says that it is a ROS participant.
        announces_type_hashes: an endpoint of it has a type hash, as in Iron and later; None when it has no endpoints
        (yet). is_own: it is that of the context that was asked.
    """

    guid: bytes
    is_ros: bool
    announces_type_hashes: bool | None
    nodes: tuple[NodeInfo, ...]
    is_own: bool = False


@dataclass(slots=True)
class _Participant:
    enclave: str | None = None
    nodes: list[NodeEntities] = field(default_factory=list)


class Graph:
    """The state; every method that asks is a pure function of it, and may be called while another thread changes it."""

    def __init__(self, own_participant: bytes = b"") -> None:
        self._own_participant = own_participant
        self.version = 0
        self.endpoints: dict[bytes, DiscoveredEndpoint] = {}
        self._participants: dict[bytes, _Participant] = {}
        self._by_channel: defaultdict[TopicKey, dict[bytes, DiscoveredEndpoint]] = defaultdict(dict)

    # ----------------------------------------------------------------------------------------------------- changes

    def apply(self, event: DiscoveryEvent) -> DiscoveredEndpoint | None:
        """Take one event in; returns the endpoint when a new one appeared."""
        match event:
            case ParticipantDiscovered():
                known = self._participants.setdefault(event.guid, _Participant())
                known.enclave = event.enclave
            case NodesAnnounced():
                self.set_nodes(event.guid, event.nodes)
                return None
            case DiscoveredEndpoint():
                return self._add(event)
            case EntityLost():
                self._remove(event.guid)
        self.version += 1
        return None

    def _add(self, event: DiscoveredEndpoint) -> DiscoveredEndpoint | None:
        known = event.guid in self.endpoints
        self.endpoints[event.guid] = event
        self._by_channel[event.channel][event.guid] = event
        self.version += 1
        return None if known else event

    def _remove(self, guid: bytes) -> None:
        endpoint = self.endpoints.pop(guid, None)
        if endpoint is not None:
            same = self._by_channel[endpoint.channel]
            same.pop(guid, None)
            if not same:
                del self._by_channel[endpoint.channel]
        self._participants.pop(guid, None)

    def set_nodes(self, participant_guid: bytes, nodes: Iterable[NodeEntities]) -> None:
        """Take in which nodes a participant has: the whole list."""
        self._participants.setdefault(participant_guid, _Participant()).nodes = list(nodes)
        self.version += 1

    # --------------------------------------------------------------------------------------------------- endpoints

    def endpoints_on(self, channel: TopicKey, *, writers: bool) -> list[DiscoveredEndpoint]:
        """The discovered writers or readers of a channel."""
        found = self._by_channel.get(channel, {})
        return [endpoint for endpoint in list(found.values()) if endpoint.is_writer is writers]

    def node_of(self, endpoint: DiscoveredEndpoint) -> tuple[str, str]:
        """Namespace and name of the node an endpoint belongs to, or rmw's two placeholders."""
        participant = self._participants.get(endpoint.participant_guid)
        if participant is None or participant.enclave is None:
            return BARE_DDS_NODE
        for node in participant.nodes:
            if endpoint.guid in (node.writer_gids if endpoint.is_writer else node.reader_gids):
                return node.namespace, node.name
        return UNKNOWN_NODE

    def participant_of(self, guid: bytes) -> bytes | None:
        """The participant of an endpoint; None while the endpoint is not known."""
        endpoint = self.endpoints.get(guid)
        return None if endpoint is None else endpoint.participant_guid

    def has_named_node(self, endpoint: DiscoveredEndpoint) -> bool:
        """Return True if the node of an endpoint is known."""
        return self.node_of(endpoint) not in (UNKNOWN_NODE, BARE_DDS_NODE)

    def describe_node(self, endpoint: DiscoveredEndpoint) -> str:
        """The owning node in words, for messages to people."""
        namespace, name = self.node_of(endpoint)
        if not self.has_named_node(endpoint):
            return "a DDS program without node name" if name == BARE_DDS_NODE[1] else "an unknown node"
        return f"node {printable(fully_qualified_node_name(name, namespace), _MAX_TEXT)}"

    def names_on(self, kind: str, *, writers: bool) -> list[str]:
        """Return the names of the channels of one kind that somebody writes or reads, sorted."""
        return sorted(
            one.name for one in list(self._by_channel) if one.kind == kind and self.endpoints_on(one, writers=writers)
        )

    def has_others(self) -> bool:
        """Return True if another participant than our own is known."""
        return any(guid != self._own_participant for guid in list(self._participants))

    def endpoints_by_wire_name(self, name: str, *, writers: bool) -> list[DiscoveredEndpoint]:
        """The writers or readers of the topic that the middleware calls so."""
        return [one for one in list(self.endpoints.values()) if one.wire_name == name and one.is_writer is writers]

    def endpoint_infos(self, endpoints: Iterable[DiscoveredEndpoint]) -> list[TopicEndpointInfo]:
        """For `get_publishers_info_by_topic` and its twin."""
        return [self.endpoint_info(one) for one in endpoints]

    def endpoint_info(self, one: DiscoveredEndpoint) -> TopicEndpointInfo:
        """What users are told of an endpoint."""
        namespace, name = self.node_of(one)
        kind = EndpointType.PUBLISHER if one.is_writer else EndpointType.SUBSCRIPTION
        told = one.type_hash or one.service_hash
        return TopicEndpointInfo(name, namespace, one.type, told, kind, one.guid, one.qos, one.participant_guid)

    # -------------------------------------------------------------------------------------------------------- lists

    def node_names_complete(self, of: bytes | None = None) -> bool:
        """Whether every ROS participant, or that `of` a GUID, has told its nodes, and all endpoints are of these."""
        found = list(self._participants.items())
        return all(one.nodes for guid, one in found if one.enclave is not None and of in (None, guid)) and not any(
            self.node_of(endpoint) == UNKNOWN_NODE
            for endpoint in list(self.endpoints.values())
            if endpoint.channel.kind != "unmangled"  # of the participant itself, or of no ROS
            and of in (None, endpoint.participant_guid)
        )

    def endpoints_complete(self, of: bytes | None = None) -> bool:
        """Whether every endpoint was found that nodes, or those of the participant `of` a GUID, have told of."""
        return (of is None or of in self._participants) and all(
            self.endpoints.keys() >= node.reader_gids | node.writer_gids
            for guid, participant in list(self._participants.items())
            if participant.enclave is not None and of in (None, guid)
            for node in participant.nodes
        )

    def nodes(self) -> list[NodeInfo]:
        """Every node of every ROS participant; two nodes of one name are two entries."""
        return [
            NodeInfo(node.name, node.namespace, participant.enclave)
            for participant in list(self._participants.values())
            if participant.enclave is not None
            for node in participant.nodes
        ]

    def has_node(self, name: str, namespace: str) -> bool:
        """Return True if a participant has announced a node of this name."""
        return any(
            (node.name, node.namespace) == (name, namespace)
            for participant in list(self._participants.values())
            for node in participant.nodes
        )

    def participants(self) -> list[ParticipantInfo]:
        """Every participant known, our own included."""
        hashed: dict[bytes, bool] = {}
        for one in list(self.endpoints.values()):
            guid = one.participant_guid
            hashed[guid] = hashed.get(guid, False) or bool(one.type_hash or one.service_hash)
        return [
            ParticipantInfo(
                guid,
                participant.enclave is not None,
                hashed.get(guid),
                tuple(NodeInfo(node.name, node.namespace, participant.enclave or "") for node in participant.nodes),
                guid == self._own_participant,
            )
            for guid, participant in list(self._participants.items())
        ]

    def topics(self, *, demangle: bool = True) -> NamesAndTypes:
        """Topic names and types; without `demangle` all names as the middleware has them."""
        return _names_and_types(self._topic_pairs(list(self.endpoints.values()), demangle))

    def services(self) -> NamesAndTypes:
        """Service names and types."""
        return _names_and_types(self._service_pairs(list(self.endpoints.values())))

    def of_node(self, name: str, namespace: str, *, writers: bool, services: str = "") -> NamesAndTypes:
        """Topics that a node writes or reads; with `services` the services whose requests, or replies, it does."""
        mine = self._endpoints_of(name, namespace, writers)
        if services:
            return _names_and_types(self._service_pairs(one for one in mine if one.channel.kind == services))
        return _names_and_types(self._topic_pairs(mine, True))

    def announced_hashes(self, name: str, namespace: str, type_name: str) -> dict[str, set[str]]:
        """Topics and services by the hash that a node's endpoints announce for a type; "" where they announce none."""
        found: defaultdict[str, set[str]] = defaultdict(set)
        for writers in (True, False):
            for endpoint in self._endpoints_of(name, namespace, writers):
                if endpoint.type == type_name:
                    found[endpoint.type_hash].add(endpoint.channel.name)
                elif endpoint.service_hash and endpoint.service_type == type_name:
                    found[endpoint.service_hash].add(endpoint.channel.name)
        return dict(found)

    def _endpoints_of(self, name: str, namespace: str, writers: bool) -> Iterator[DiscoveredEndpoint]:
        for participant in list(self._participants.values()):
            for node in participant.nodes:
                if (node.name, node.namespace) == (name, namespace):
                    for guid in node.writer_gids if writers else node.reader_gids:
                        # Announced but not discovered: stale (docs/internals/protocol.md 6.3, rmw_cyclonedds Jazzy).
                        if (endpoint := self.endpoints.get(guid)) is not None:
                            yield endpoint

    @staticmethod
    def _topic_pairs(endpoints: Iterable[DiscoveredEndpoint], demangle: bool) -> Iterator[tuple[str, str]]:
        for endpoint in endpoints:
            if not demangle:
                yield endpoint.wire_name, endpoint.wire_type
            elif endpoint.channel.kind == "topic":
                yield endpoint.channel.name, endpoint.type

    @staticmethod
    def _service_pairs(endpoints: Iterable[DiscoveredEndpoint]) -> Iterator[tuple[str, str]]:
        for endpoint in endpoints:
            service_type = endpoint.service_type
            if endpoint.channel.kind in ("request", "reply") and service_type is not None:
                yield endpoint.channel.name, service_type


def _names_and_types(pairs: Iterable[tuple[str, str]]) -> NamesAndTypes:
    found: defaultdict[str, set[str]] = defaultdict(set)
    for name, type_name in pairs:
        found[name].add(type_name)
    return [(name, sorted(types)) for name, types in sorted(found.items())]
