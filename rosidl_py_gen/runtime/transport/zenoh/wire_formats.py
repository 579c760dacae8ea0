"""Formats of rmw_zenoh_cpp: keys, attachments, QoS profiles and liveliness tokens; and the graph that tokens describe.

Key of a topic or service: it contains the type hash and is matched as a whole. Two endpoints with different definitions
exchange nothing, and Zenoh reports nothing.

Attachment of a sample, request or reply: sequence number, time and GID of the sender, in 33 bytes; the attachment of
a reply has the number and the GID of its request. Peers on rmw_zenoh_cpp may crash if they receive any other bytes, so
only `pack_attachment` creates attachments.

QoS: each profile has one text. Numbers that equal the default of rmw_zenoh_cpp are omitted, so that all implementations
write the same token. Endpoints decide what a profile means to Zenoh.

Token, by which a node or endpoint announces that it exists: its text is the only description of an endpoint, and its
hash is the endpoint's GID. So own texts are canonical, and texts of peers are hashed as received.

Graph of a domain, made from tokens and reported as discovery events: a session is a participant, and a client or server
is two endpoints. A node exists while its own token or one of its endpoints' tokens exists. Tokens arrive repeatedly and
in any order; a token is identified by its whole text. Endpoints of the own session are added immediately by their
creator. Endpoints with the same key match, also with different QoS.

Source: docs/internals/zenoh.md 2, 3, 4.2 to 4.4, 8 and 9 (liveliness_utils.cpp, qos.cpp and attachment_helpers.cpp).
"""

from __future__ import annotations

import itertools
import re
import struct
import threading
from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from typing import TypeAlias

import xxhash

from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.transport.api import (
    DiscoveredEndpoint,
    DiscoveryEvent,
    EntityLost,
    NodeEntities,
    NodesAnnounced,
    ParticipantDiscovered,
    TopicKey,
)
from rosidl_py_gen.runtime.transport.dds.names import BUFFER_SUFFIX, ros_type
from rosidl_py_gen.runtime.transport.endpoint_index import EndpointIndex
from rosidl_py_gen.runtime.transport.qos import (
    INFINITE_NS,
    MAX_DEPTH,
    Durability,
    History,
    IncompatibilityKind,
    InvalidQoSError,
    Liveliness,
    QoSProfile,
    Reliability,
)

# ----------------------------------------------------------------------------------------------------------------- keys

HASH_NOT_SUPPORTED = "TypeHashNotSupported"
"""Text that replaces the type hash in keys and tokens if the hash is unknown, and always in the format of Humble."""
_TYPE_HASH = re.compile(r"RIHS01_[0-9a-f]{64}\Z")


def data_key(domain_id: int, name: str, type_name: str, type_hash: str) -> str:
    """Return the Zenoh key of the samples of a topic, or of the requests of a service.

    Args:
        name: fully qualified name of the topic or service.
        type_name: DDS type name, such as ``std_msgs::msg::dds_::String_``; for a service without ``Request_``.
        type_hash: RIHS01 text of the message, or of the service; may be empty.
    """
    inner = name.removeprefix("/").removesuffix("/")
    return f"{domain_id}/{inner}/{type_name}/{type_hash or HASH_NOT_SUPPORTED}"


def valid_hash_or_empty(chunk: str) -> str:
    """Return `chunk`, the field for the type hash in a key or token, if it is a valid hash; else "", as for Humble."""
    return chunk if _TYPE_HASH.match(chunk) else ""


def cpu_buffer_key(key: str) -> str:
    """Return the second key of a topic, on which publishers of Lyrical send to subscriptions that announce CPU_BACKEND.

    They do so for messages with an unbounded array of bytes that are not transient local (docs/internals/zenoh.md 9.2).
    """
    return f"{key}{BUFFER_SUFFIX}"


# ---------------------------------------------------------------------------------------------------------- attachments

ATTACHMENT_BYTES = 33
_GID_BYTES = 16
_ATTACHMENT = struct.Struct("<qqB16s")
_LEGACY_ATTACHMENT_BYTES = 77


class AttachmentError(RosidlError, ValueError):
    """Raised if an attachment of a sample, request or reply does not have the format of rmw_zenoh_cpp."""


def pack_attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """Encode an attachment: number of the sample from 1, time since the epoch, and the sender's GID (`gid_of`)."""
    return _ATTACHMENT.pack(sequence, stamp_ns, _GID_BYTES, gid)


def unpack_attachment(data: bytes) -> tuple[int, int, bytes]:
    """Return sequence number, time in ns since the epoch and sender's GID of an attachment.

    Raises:
        AttachmentError: length or values are not valid.
    """
    if len(data) != ATTACHMENT_BYTES:
        legacy = (
            "; rmw_zenoh_cpp before Jazzy's 0.2.4 sends this form: update the peer"
            if len(data) == _LEGACY_ATTACHMENT_BYTES
            else ""
        )
        raise AttachmentError(f"expected an attachment of {ATTACHMENT_BYTES} bytes, found {len(data)} bytes{legacy}")
    sequence, stamp_ns, size, gid = _ATTACHMENT.unpack(data)
    if size != _GID_BYTES:
        raise AttachmentError(f"attachment: byte 16: expected {_GID_BYTES}, the length of a GID, found {size}")
    if sequence < 0:
        raise AttachmentError(f"attachment: byte 0: expected a sequence number of 0 or more, found {sequence}")
    if stamp_ns < 0:
        raise AttachmentError(f"attachment: byte 8: expected a time of 0 or more, found {stamp_ns}")
    return sequence, stamp_ns, gid


# ------------------------------------------------------------------------------------------------------------------ QoS

DEFAULT_DEPTH = 42
"""Depth that a depth of 0 means in rmw_zenoh_cpp, also with KEEP_ALL."""

_FOREVER_S, _FOREVER_NS = sec_nanosec(INFINITE_NS)
_DEFAULTS = (
    *(int(Reliability.RELIABLE), int(Durability.VOLATILE), int(History.KEEP_LAST), DEFAULT_DEPTH),
    *(_FOREVER_S, _FOREVER_NS, _FOREVER_S, _FOREVER_NS, int(Liveliness.AUTOMATIC), _FOREVER_S, _FOREVER_NS),
)
_FIELD_SIZES = (1, 1, 2, 2, 2, 3)
"""Number of values, separated by commas, in each field of a QoS text; fields are separated by colons."""
_PERIODS = (4, 5, 6, 7, 9, 10)
"""Indexes of the seconds and nanoseconds of deadline, lifespan and lease in `_DEFAULTS`."""
_NUMBER_OR_EMPTY = re.compile(r"[0-9]{0,20}\Z")  # as many digits as the greatest size_t of C++ has


def qos_text(qos: QoSProfile) -> str:
    """Return the text that stands for a QoS profile in a token, such as ``::,10:,:,:,,`` for the default profile.

    Raises:
        InvalidQoSError: a policy is UNKNOWN.
    """
    policies = (qos.reliability, qos.durability, qos.history, qos.liveliness)
    for policy in policies:
        if policy.name == "UNKNOWN":
            raise InvalidQoSError(f"{type(policy).__name__}.UNKNOWN cannot be announced; only peers have it")
    deadline, lifespan, lease = (
        sec_nanosec(period or INFINITE_NS) for period in (qos.deadline_ns, qos.lifespan_ns, qos.liveliness_lease_ns)
    )
    # SYSTEM_DEFAULT is 0 in every policy, and 0 means the default of rmw_zenoh_cpp.
    numbers = (
        *(int(qos.reliability), int(qos.durability), int(qos.history), qos.depth),
        *(*deadline, *lifespan, int(qos.liveliness), *lease),
    )
    texts = iter(
        "" if number == default or (number == 0 and index not in _PERIODS) else str(number)
        for index, (number, default) in enumerate(zip(numbers, _DEFAULTS, strict=True))
    )
    return ":".join(",".join(itertools.islice(texts, size)) for size in _FIELD_SIZES)


def read_qos(text: str) -> QoSProfile | None:
    """Return the profile that a QoS text in a token contains; None if rmw_zenoh_cpp would reject the text.

    A depth that is too large becomes the maximum, a period that is too long becomes infinite. Further numbers are
    ignored.
    """
    fields = [part.split(",")[:size] for part, size in zip(text.split(":"), _FIELD_SIZES, strict=False)]
    texts = [text for part in fields for text in part]
    if [len(part) for part in fields] != list(_FIELD_SIZES) or not all(map(_NUMBER_OR_EMPTY.match, texts)):
        return None
    numbers = [int(text) if text else default for text, default in zip(texts, _DEFAULTS, strict=True)]
    deadline, lifespan, lease = (
        min(numbers[index] * NS_PER_S + numbers[index + 1], INFINITE_NS) for index in (4, 6, 9)
    )
    try:
        return QoSProfile(
            history=History(numbers[2]),
            depth=min(numbers[3], MAX_DEPTH) or DEFAULT_DEPTH,
            reliability=Reliability(numbers[0]),
            durability=Durability(numbers[1]),
            deadline_ns=deadline,
            lifespan_ns=lifespan,
            liveliness=Liveliness(numbers[8]),
            liveliness_lease_ns=lease,
        )
    except ValueError:  # an undefined policy
        return None


# --------------------------------------------------------------------------------------------------------------- tokens

TOKEN_PREFIX = "@ros2_lv"
CPU_BACKEND = "backends:cpu:"
"""Last chunk of the token of a subscription that receives buffers of Lyrical in ordinary memory (`cpu_buffer_key`)."""

_NODE_CHUNKS = 9
_ENDPOINT_CHUNKS = 13
_NUMBER = re.compile(r"[0-9]{1,20}\Z")
_ZID = re.compile(r"(?!0)[0-9a-f]{1,32}\Z")


class EntityKind(Enum):
    """Kind of the entity that a token announces."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIPTION = "MS"
    SERVER = "SS"
    CLIENT = "SC"


_ENDPOINTS = {kind.value: kind for kind in EntityKind if kind is not EntityKind.NODE}


@dataclass(frozen=True, slots=True)
class NodeToken:
    """Liveliness token of a node.

    Attributes:
        zid: id of the session, as Zenoh prints it: hex without leading zeros.
        node_id: number of the session's counter, which counts nodes and endpoints from 0.
        namespace: ``/`` or ``/robot1``.
    """

    domain_id: int
    zid: str
    node_id: int
    name: str
    namespace: str = "/"
    enclave: str = "/"

    @property
    def node(self) -> NodeToken:
        """The token itself, so that node tokens and `EndpointToken` both have this attribute."""
        return self

    def __str__(self) -> str:
        return _chunks(self, self.node_id, EntityKind.NODE)


@dataclass(frozen=True, slots=True)
class EndpointToken:
    """Liveliness token of an endpoint: publisher, subscription, client or server.

    Attributes:
        entity_id: number of the session's counter, which counts nodes and endpoints from 0.
        name: fully qualified name of the topic or service.
        type: DDS name of the message, or of the service without Request and Response.
        type_hash: RIHS01 text, or another text in the token of a peer; an empty hash is written as in Humble.
        backends: last chunk of the token of a subscription of Lyrical and later; else empty.
    """

    node: NodeToken
    entity_id: int
    kind: EntityKind
    name: str
    type: str
    type_hash: str
    qos: QoSProfile
    backends: str = ""

    def __str__(self) -> str:
        """Return the text of the token; raise `InvalidQoSError` if a QoS policy is UNKNOWN."""
        backends = f"/{self.backends}" if self.backends else ""
        type_hash = self.type_hash or HASH_NOT_SUPPORTED
        return (
            f"{_chunks(self.node, self.entity_id, self.kind)}/{_mangled(self.name)}/{self.type}/{type_hash}"
            f"/{qos_text(self.qos)}{backends}"
        )


def tokens_of(domain_id: int) -> str:
    """Return the Zenoh key expression that matches all liveliness tokens of a domain."""
    return f"{TOKEN_PREFIX}/{domain_id}/**"


def gid_of(token: str) -> bytes:
    """Return the GID, 16 bytes, of the node or endpoint of a token: XXH3-128 of the token's text, low half first."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def read_token(text: str) -> NodeToken | EndpointToken | None:
    """Return the parsed text of a liveliness token; None if it is not a token of ROS, or rmw_zenoh_cpp rejects it.

    Further chunks are ignored, as by rmw_zenoh_cpp: later distributions may add some.
    """
    chunks = text.split("/")
    if len(chunks) < _NODE_CHUNKS or chunks[0] != TOKEN_PREFIX or not all(chunks):
        return None
    domain_id, zid, node_id, entity_id, kind = chunks[1:6]
    if not (_ZID.match(zid) and all(map(_NUMBER.match, (domain_id, node_id, entity_id)))):
        return None
    enclave, namespace, name = (chunk.replace("%", "/") for chunk in chunks[6:_NODE_CHUNKS])
    node = NodeToken(int(domain_id), zid, int(node_id), name, namespace, enclave)
    if kind == EntityKind.NODE.value:
        return node
    if kind not in _ENDPOINTS or len(chunks) < _ENDPOINT_CHUNKS:
        return None
    topic, type_name, type_hash, qos_chunk, *more = chunks[_NODE_CHUNKS:]
    qos = read_qos(qos_chunk)
    if qos is None:
        return None
    backends = more[0] if more else ""
    name = topic.replace("%", "/")
    return EndpointToken(node, int(entity_id), _ENDPOINTS[kind], name, type_name, type_hash, qos, backends)


def _chunks(node: NodeToken, entity_id: int, kind: EntityKind) -> str:
    return (
        f"{TOKEN_PREFIX}/{node.domain_id}/{node.zid}/{node.node_id}/{entity_id}/{kind.value}"
        f"/{_mangled(node.enclave)}/{_mangled(node.namespace)}/{_mangled(node.name)}"
    )


def _mangled(name: str) -> str:
    return name.replace("/", "%")


# ---------------------------------------------------------------------------------------------------------------- graph

_TOPIC_OF_ALL_NODES = TopicKey("topic", "/parameter_events")
_FLIPPED = (1 << 128) - 1


def paired_gid(gid: bytes) -> bytes:
    """Return the GUID of the writer of a client or server from its GID, which is also the GUID of its reader."""
    return (int.from_bytes(gid, "big") ^ _FLIPPED).to_bytes(16, "big")


def participant_guid(zid: str) -> bytes:
    """Return the GUID that a Zenoh session has as a participant, from the session's id as Zenoh prints it."""
    return int(zid, 16).to_bytes(16, "big")


@dataclass(slots=True)
class _Node:
    token: NodeToken
    tokens: set[str] = field(default_factory=set)
    """Texts of the tokens that announce the node itself; peers may announce a node by several texts."""
    readers: set[bytes] = field(default_factory=set)
    writers: set[bytes] = field(default_factory=set)


Infos: TypeAlias = tuple[DiscoveredEndpoint, ...]
"""Endpoints in the graph that one token announces: one for a publisher or subscription, two for a client or server."""


def endpoints_of(token: EndpointToken, gid: bytes) -> Infos:
    """Return the endpoints that a token announces: the endpoint of a topic, or the reader and the writer of a client or
    server.
    """
    participant, type_hash = participant_guid(token.node.zid), valid_hash_or_empty(token.type_hash)
    type, wire = ros_type(token.type), (token.name, token.type)
    if token.kind in (EntityKind.PUBLISHER, EntityKind.SUBSCRIPTION):
        is_writer, topic_key = token.kind is EntityKind.PUBLISHER, TopicKey("topic", token.name)
        return (DiscoveredEndpoint(gid, participant, is_writer, topic_key, type, token.qos, type_hash, "", "", *wire),)
    request = TopicKey("request", token.name), f"{type}_Request"
    reply = TopicKey("reply", token.name), f"{type}_Response"
    read, written = (request, reply) if token.kind is EntityKind.SERVER else (reply, request)
    service = ("", gid.hex(), type_hash)
    return (
        DiscoveredEndpoint(gid, participant, False, *read, token.qos, *service, *wire),
        DiscoveredEndpoint(paired_gid(gid), participant, True, *written, token.qos, *service, *wire),
    )


class TokenGraph(EndpointIndex):
    """Graph of the nodes and endpoints of a domain, from liveliness tokens. Thread: any.

    `version` and the methods of the base class ignore tokens that `read` has not applied yet.
    """

    def __init__(self, own_zid: str, enclave: str) -> None:
        super().__init__()
        self._own_zid = own_zid
        self._unread: deque[tuple[bool, str]] = deque()
        self._lock = threading.RLock()
        self._sessions: dict[str, dict[int, _Node]] = {}
        """Nodes of peers by session id and node number."""
        self._tokens: dict[str, Infos] = {}
        self._events: list[DiscoveryEvent] = []
        self._apply(ParticipantDiscovered(participant_guid(own_zid), enclave))

    def _apply(self, *events: DiscoveryEvent) -> None:
        """Apply discovery events to the graph now, and queue them for the discovery sink. Lock: _lock must be held."""
        self.apply(events)
        self._events += events

    def on_token(self, exists: bool, token: str) -> None:
        """Record that a token appeared or disappeared; `read` applies it later."""
        self._unread.append((exists, token))

    def add_endpoints(self, endpoints: Infos) -> None:
        """Add endpoints of this participant's session, or of a peer's token, and queue their discovery events."""
        with self._lock:
            self._apply(*endpoints)

    def remove_endpoints(self, endpoints: Infos) -> None:
        """Remove endpoints of this participant's session, or of a peer's token, and queue their discovery events."""
        with self._lock:
            self._apply(*(EntityLost(endpoint.guid) for endpoint in endpoints))

    def read(self) -> None:
        """Apply all tokens that `on_token` has recorded."""
        if not self._unread:
            return
        with self._lock:
            changed: dict[str, None] = {}
            while self._unread:
                exists, text = self._unread.popleft()
                token = read_token(text)
                if token is None or token.node.zid == self._own_zid:
                    continue
                if (self._add if exists else self._remove)(text, token):
                    changed[token.node.zid] = None
            for zid in changed:
                self._report_nodes(zid)

    def _add(self, text: str, token: NodeToken | EndpointToken) -> bool:
        if text in self._tokens:
            return False
        owner = token.node
        nodes = self._sessions.get(owner.zid)
        if nodes is None:
            nodes = self._sessions[owner.zid] = {}
            self._apply(ParticipantDiscovered(participant_guid(owner.zid), owner.enclave))
        node = nodes.setdefault(owner.node_id, _Node(owner))
        if isinstance(token, NodeToken):
            node.tokens.add(text)
            self._tokens[text] = ()
            return True
        endpoints = self._tokens[text] = endpoints_of(token, gid_of(text))
        for endpoint in endpoints:
            (node.writers if endpoint.is_writer else node.readers).add(endpoint.guid)
        self.add_endpoints(endpoints)
        return True

    def _remove(self, text: str, token: NodeToken | EndpointToken) -> bool:
        endpoints = self._tokens.pop(text, None)
        if endpoints is None:
            return False
        node = self._sessions[token.node.zid][token.node.node_id]
        if isinstance(token, NodeToken):
            node.tokens.discard(text)
        for endpoint in endpoints:
            node.readers.discard(endpoint.guid)
            node.writers.discard(endpoint.guid)
        self.remove_endpoints(endpoints)
        return True

    def _report_nodes(self, zid: str) -> None:
        """Queue an event with the nodes of a session, or with its loss if no node is left."""
        guid, nodes = participant_guid(zid), self._sessions[zid]
        for number in [number for number, node in nodes.items() if not (node.tokens or node.readers or node.writers)]:
            del nodes[number]
        if not nodes:
            del self._sessions[zid]
            self._apply(EntityLost(guid))
            return
        entities = tuple(
            NodeEntities(node.token.namespace, node.token.name, frozenset(node.readers), frozenset(node.writers))
            for node in nodes.values()
        )
        self._apply(NodesAnnounced(guid, entities))

    def events(self) -> list[DiscoveryEvent]:
        """Return and clear the discovery events that were not returned before."""
        self.read()
        with self._lock:
            events, self._events = self._events, []
        return events

    def connected(self, endpoint: DiscoveredEndpoint) -> dict[bytes, DiscoveredEndpoint]:
        """Return the readers that match a writer, or the writers that match a reader, by GUID."""
        return self._find(endpoint, writers=not endpoint.is_writer)

    def endpoints_on_same_side(self, endpoint: DiscoveredEndpoint) -> dict[bytes, DiscoveredEndpoint]:
        """Return all endpoints that have the key and direction of an endpoint, including the endpoint
        itself, by GUID.
        """
        return self._find(endpoint, writers=endpoint.is_writer)

    def _find(self, endpoint: DiscoveredEndpoint, *, writers: bool) -> dict[bytes, DiscoveredEndpoint]:
        self.read()
        key = endpoint.type, _announced_hash(endpoint)
        found = self.endpoints_on(endpoint.topic_key, writers=writers)
        return {other.guid: other for other in found if (other.type, _announced_hash(other)) == key}


def _announced_hash(endpoint: DiscoveredEndpoint) -> str:
    # A service without a hash may have the hash of its request in our own graph, which peers do not know.
    return endpoint.service_hash if endpoint.service_id else endpoint.type_hash


def incompatibility(writer: DiscoveredEndpoint, reader: DiscoveredEndpoint) -> IncompatibilityKind | None:
    """Return how the hashes of two endpoints of one topic and type differ; None if the endpoints match.

    None is also returned for replies, because requests are reported, and for ``/parameter_events``: every node
    publishes and subscribes to this topic, and there would be hundreds of reports.
    """
    hashes = {_announced_hash(writer), _announced_hash(reader)}
    if len(hashes) == 1 or writer.topic_key == _TOPIC_OF_ALL_NODES or writer.topic_key.kind == "reply":
        return None
    return IncompatibilityKind.HASH_FORMAT if "" in hashes else IncompatibilityKind.DEFINITION
