"""Graph of nodes, topics, services and endpoints: queries of the discovered endpoints, which a transport indexes.

The graph combines discovered endpoints with the nodes that participants announce (docs/internals/protocol.md 6.3, 6.4).
It contains no data, does no I/O and does not wait.

Endpoints announce the RIHS01 hash of their type. `TypeCheck` is the setting for messages whose sender has another
definition of the type. A hash that is not announced, or not known here, is not a difference.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Literal, get_args

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.errors import RosidlError, printable
from rosidl_py_gen.runtime.names import fully_qualified_node_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, NodeEntities
    from rosidl_py_gen.runtime.transport.endpoint_index import EndpointIndex, KnownParticipant
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

UNKNOWN_NODE = ("_NODE_NAMESPACE_UNKNOWN_", "_NODE_NAME_UNKNOWN_")
BARE_DDS_NODE = ("_CREATED_BY_BARE_DDS_APP_", "_CREATED_BY_BARE_DDS_APP_")
_MAX_NAME_CHARS = 600
"""Maximum length of a node name in texts for people; ROS allows 255 for a name and 245 for its namespace."""
NamesAndTypes = list[tuple[str, list[str]]]
"""List of names of topics, services or actions, each with the list of its types."""


class EndpointType(IntEnum):
    """Kinds of endpoints, with the numbers of rmw."""

    INVALID = 0
    PUBLISHER = 1
    SUBSCRIPTION = 2


@dataclass(frozen=True, slots=True)
class NodeInfo:
    """Node of the graph as its participant announces it, with the participant's enclave."""

    name: str
    namespace: str
    enclave: str

    @property
    def fully_qualified_name(self) -> str:
        """Namespace and name of the node, joined: ``/ns/name``."""
        return fully_qualified_node_name(self.name, self.namespace)


@dataclass(frozen=True, slots=True)
class TopicEndpointInfo:
    """Publisher or subscription, as in `ros2 topic info --verbose`, or the writer of a client or server.

    Attributes:
        topic_type: ``pkg/msg/Name``, or the DDS type name if it is not a ROS type.
        topic_type_hash: RIHS01 text, empty if the endpoint announces none (ROS 2 Humble, DDS without ROS).
        endpoint_gid: 16 bytes.
        qos_profile: as discovered; unset durations are infinite.
        participant_guid: GUID of the endpoint's participant; see `Context.participants`.
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
        """True if the endpoint's node is known; node names arrive after endpoints, and some programs have none."""
        return (self.node_namespace, self.node_name) not in (UNKNOWN_NODE, BARE_DDS_NODE)

    @property
    def node_text(self) -> str:
        """``/ns/name`` of the endpoint's node; a text in parentheses if the node is unknown or does not exist."""
        if self.has_node_name:
            return fully_qualified_node_name(self.node_name, self.node_namespace)
        return "(DDS program without node)" if self.node_name == BARE_DDS_NODE[1] else "(unknown node)"


@dataclass(frozen=True, slots=True)
class Mismatch:
    """Incompatible publisher and subscription of a topic, or client and server of a service.

    Attributes:
        writer: sender of the messages or requests.
        reader: receiver of the messages or requests.
        kind: what differs: the type, the definition of the type (on Zenoh also the format of type hashes), or the QoS.
        reason: text for people about both endpoints.
    """

    writer: TopicEndpointInfo
    reader: TopicEndpointInfo
    kind: Literal["type", "definition", "qos"]
    reason: str


@dataclass(frozen=True, slots=True)
class ParticipantInfo:
    """Member of the domain, usually a process.

    Attributes:
        guid: 16 bytes.
        is_ros: True if the participant announces itself as a ROS participant.
        announces_type_hashes: True if one of its endpoints has a type hash (Iron and later); None without endpoints.
        is_own: True for the context's own participant.
        vendor: RTPS id of the DDS vendor, 2 bytes; empty for a secured participant, unless it is on Fast DDS.
    """

    guid: bytes
    is_ros: bool
    announces_type_hashes: bool | None
    nodes: tuple[NodeInfo, ...]
    is_own: bool = False
    vendor: bytes = b""


class Graph:
    """Queries about discovered participants, nodes and endpoints; another thread may change the index at the same time.

    Args:
        index: index of the context's participant.
        own_participant: GUID of that participant.
    """

    def __init__(self, index: EndpointIndex, own_participant: bytes = b"") -> None:
        self._index = index
        self._own_participant = own_participant
        self._participants = index.participants
        self.endpoints = index.endpoints
        """Discovered endpoints by GUID."""
        self.endpoints_on = index.endpoints_on
        """Function that returns the endpoints of a topic: `EndpointIndex.endpoints_on`."""

    @property
    def version(self) -> int:
        """Number that is incremented after each change of the graph."""
        return self._index.version

    def node_of(self, endpoint: DiscoveredEndpoint) -> tuple[str, str]:
        """Return namespace and name of an endpoint's node; UNKNOWN_NODE or BARE_DDS_NODE if the node is not known."""
        participant = self._participants.get(endpoint.participant_guid)
        if participant is None or participant.enclave is None:
            return BARE_DDS_NODE
        for node in participant.nodes:
            if endpoint.guid in (node.writer_gids if endpoint.is_writer else node.reader_gids):
                return node.namespace, node.name
        return UNKNOWN_NODE

    def participant_of(self, guid: bytes) -> bytes | None:
        """Return the GUID of an endpoint's participant; None while the endpoint is not discovered."""
        endpoint = self.endpoints.get(guid)
        return None if endpoint is None else endpoint.participant_guid

    def has_named_node(self, endpoint: DiscoveredEndpoint) -> bool:
        """Return True if the node of an endpoint is known by name."""
        return self.node_of(endpoint) not in (UNKNOWN_NODE, BARE_DDS_NODE)

    def describe_node(self, endpoint: DiscoveredEndpoint) -> str:
        """Return a text for people that names the node of an endpoint, such as ``node /talker``."""
        namespace, name = self.node_of(endpoint)
        if not self.has_named_node(endpoint):
            return "a DDS program without node name" if name == BARE_DDS_NODE[1] else "an unknown node"
        return f"node {printable(fully_qualified_node_name(name, namespace), _MAX_NAME_CHARS)}"

    def is_ros(self, participant_guid: bytes) -> bool:
        """Return True if a participant announces that it is a ROS participant."""
        participant = self._participants.get(participant_guid)
        return participant is not None and participant.enclave is not None

    def is_humble(self, participant_guid: bytes) -> bool | None:
        """Return True if a participant is of ROS 2 Humble, None if unknown (docs/internals/protocol.md 6.2)."""
        participant = self._participants.get(participant_guid)
        return None if participant is None else participant.is_humble

    def names_on(self, kind: str, *, writers: bool) -> list[str]:
        """Return the sorted names of all topics of one kind that have a writer.

        With ``writers=False``, the topics have a reader.
        """
        keys = [key for key in self._index.topic_keys() if key.kind == kind]
        return sorted(key.name for key in keys if self.endpoints_on(key, writers=writers))

    def has_others(self) -> bool:
        """Return True if a participant is known that is not the context's own."""
        return any(guid != self._own_participant for guid in list(self._participants))

    def endpoints_by_wire_name(self, name: str, *, writers: bool) -> list[DiscoveredEndpoint]:
        """Return the writers of a topic, given by its name in the middleware; with ``writers=False``, the readers."""
        endpoints = list(self.endpoints.values())
        return [endpoint for endpoint in endpoints if endpoint.wire_name == name and endpoint.is_writer is writers]

    def endpoint_info(self, endpoint: DiscoveredEndpoint) -> TopicEndpointInfo:
        """Return the public description of an endpoint."""
        namespace, name = self.node_of(endpoint)
        return TopicEndpointInfo(
            name,
            namespace,
            endpoint.type,
            endpoint.type_hash or endpoint.service_hash,
            EndpointType.PUBLISHER if endpoint.is_writer else EndpointType.SUBSCRIPTION,
            endpoint.guid,
            endpoint.qos,
            endpoint.participant_guid,
        )

    def node_names_complete(self, participant: bytes | None = None) -> bool:
        """Return True if all ROS participants, or a given participant, have announced their nodes.

        The node of each of their endpoints must be known, too.
        """
        participants = self._ros_participants(participant)
        return all(info.nodes for info in participants) and not any(
            self.node_of(endpoint) == UNKNOWN_NODE
            for endpoint in list(self.endpoints.values())
            if endpoint.topic_key.kind != "unmangled"  # belongs to the participant itself, or to a program without ROS
            and participant in (None, endpoint.participant_guid)
        )

    def endpoints_complete(self, participant: bytes | None = None) -> bool:
        """Return True if all endpoints that nodes announce have been discovered.

        With a participant, only its nodes count.
        """
        return (participant is None or participant in self._participants) and all(
            self.endpoints.keys() >= node.reader_gids | node.writer_gids
            for info in self._ros_participants(participant)
            for node in info.nodes
        )

    def _ros_participants(self, participant: bytes | None) -> list[KnownParticipant]:
        return [
            info
            for guid, info in list(self._participants.items())
            if info.enclave is not None and participant in (None, guid)
        ]

    def nodes(self) -> list[NodeInfo]:
        """Return all nodes of ROS participants; two nodes of one name are two entries."""
        return [
            NodeInfo(node.name, node.namespace, participant.enclave or "")
            for participant in self._ros_participants(None)
            for node in participant.nodes
        ]

    def has_node(self, name: str, namespace: str) -> bool:
        """Return True if a participant has announced a node of this name."""
        return any(self._nodes_named(name, namespace))

    def _nodes_named(self, name: str, namespace: str) -> Iterator[NodeEntities]:
        for participant in list(self._participants.values()):
            for node in participant.nodes:
                if (node.name, node.namespace) == (name, namespace):
                    yield node

    def participants(self) -> list[ParticipantInfo]:
        """Return all known participants, including the context's own."""
        has_hash: dict[bytes, bool] = {}
        for endpoint in list(self.endpoints.values()):
            guid = endpoint.participant_guid
            has_hash[guid] = has_hash.get(guid, False) or bool(endpoint.type_hash or endpoint.service_hash)
        return [
            ParticipantInfo(
                guid,
                participant.enclave is not None,
                has_hash.get(guid),
                tuple(NodeInfo(node.name, node.namespace, participant.enclave or "") for node in participant.nodes),
                guid == self._own_participant,
                guid[:2] if participant.vendor is None else participant.vendor,
            )
            for guid, participant in list(self._participants.items())
        ]

    def topics(self, *, demangle: bool = True) -> NamesAndTypes:
        """Return ROS topics with their types; without `demangle`, all topics with their names in the middleware."""
        return _topics(list(self.endpoints.values()), demangle)

    def services(self) -> NamesAndTypes:
        """Return all services and their types."""
        return _services(list(self.endpoints.values()), "request", "reply")

    def of_node(
        self, name: str, namespace: str, *, writers: bool, services: str = "", demangle: bool = True
    ) -> NamesAndTypes:
        """Return the topics or services of which a node has endpoints, with their types.

        Args:
            writers: select the writers of the node; False: its readers.
            services: kind of topic, ``request`` or ``reply``, by which services are selected; empty: topics.
            demangle: False for all topics with their names in the middleware.
        """
        endpoints = self._endpoints_of(name, namespace, writers)
        return _services(endpoints, services) if services else _topics(endpoints, demangle)

    def announced_hashes(self, name: str, namespace: str, type_name: str) -> dict[str, set[str]]:
        """Return the type hashes that the endpoints of a node announce for one type.

        Returns:
            Dict from hash to the names of the topics and services with this hash; the key is empty for endpoints
                without hash.
        """
        names: defaultdict[str, set[str]] = defaultdict(set)
        for writers in (True, False):
            for endpoint in self._endpoints_of(name, namespace, writers):
                if endpoint.type == type_name:
                    names[endpoint.type_hash].add(endpoint.topic_key.name)
                elif endpoint.service_hash and endpoint.service_type == type_name:
                    names[endpoint.service_hash].add(endpoint.topic_key.name)
        return dict(names)

    def _endpoints_of(self, name: str, namespace: str, writers: bool) -> Iterator[DiscoveredEndpoint]:
        for node in self._nodes_named(name, namespace):
            for guid in node.writer_gids if writers else node.reader_gids:
                # Announced but not discovered: stale (docs/internals/protocol.md 6.3, rmw_cyclonedds Jazzy).
                if (endpoint := self.endpoints.get(guid)) is not None:
                    yield endpoint


def _topics(endpoints: Iterable[DiscoveredEndpoint], demangle: bool) -> NamesAndTypes:
    if not demangle:
        return _grouped((endpoint.wire_name, endpoint.wire_type) for endpoint in endpoints)
    return _grouped(
        (endpoint.topic_key.name, endpoint.type) for endpoint in endpoints if endpoint.topic_key.kind == "topic"
    )


def _services(endpoints: Iterable[DiscoveredEndpoint], *kinds: str) -> NamesAndTypes:
    return _grouped(
        (endpoint.topic_key.name, endpoint.service_type)
        for endpoint in endpoints
        if endpoint.topic_key.kind in kinds and endpoint.service_type is not None
    )


def _grouped(pairs: Iterable[tuple[str, str]]) -> NamesAndTypes:
    types_by_name: defaultdict[str, set[str]] = defaultdict(set)
    for name, type_name in pairs:
        types_by_name[name].add(type_name)
    return [(name, sorted(types)) for name, types in sorted(types_by_name.items())]


# ---------------------------------------------------------------------------------------------------------- type hashes

TypeCheck = Literal["error", "warn", "off"]
"""Treatment of messages whose sender has another definition.

``error`` drops them. ``warn`` delivers samples of unknown definitions, and drops samples of another ROS distribution,
whose bytes would be misread. ``off`` delivers all of them without a warning.
"""
DEFAULT_CHECK: TypeCheck = "error"
_KINDS = {"/srv/": "service", "/action/": "action"}


def checked_mode(mode: TypeCheck | None, default: TypeCheck = DEFAULT_CHECK) -> TypeCheck:
    """Return a type hash check mode unchanged, or the default for None; raises `ValueError` for other values."""
    if mode is None:
        return default
    if mode not in get_args(TypeCheck):
        raise ValueError(f'type_hash_check must be "error", "warn" or "off", got {mode!r:.100}')
    return mode


def type_hashes_differ(endpoint: DiscoveredEndpoint, type_hash: str, service_hash: str = "") -> bool:
    """Return True if an endpoint announces a type hash that is not among the given hashes."""
    if endpoint.type_hash and type_hash:
        return endpoint.type_hash != type_hash
    return bool(endpoint.service_hash and service_hash) and endpoint.service_hash != service_hash


def distributions_of(peer: DiscoveredEndpoint, own: DiscoveredEndpoint) -> tuple[str, ...]:
    """Return the distributions that have a peer's definition of a type, if it differs from the own definition.

    The result is empty if none has it.
    """
    from rosidl_py_gen.type_loading import DistributionVariants

    name, own_hash, other_hash = own.service_type or "", own.service_hash, peer.service_hash
    if peer.type_hash and own.type_hash:
        name, own_hash, other_hash = own.type, own.type_hash, peer.type_hash
    try:
        variants = DistributionVariants.find(name, own_hash)
        return () if variants is None else variants.with_hash(other_hash)
    except RosidlError:  # a definition cannot be read
        return ()


def distribution_advice(distros: tuple[str, ...], type_name: str) -> str:
    """Return a text that advises how to use the definition of a type that the given distributions have."""
    distro = Distribution.DEFAULT if Distribution.DEFAULT in distros else distros[0]
    kind = next((word for part, word in _KINDS.items() if part in type_name), "message")
    return f'set ROS_DISTRO={distro}, or pass distro="{distro}" to get_{kind}'
