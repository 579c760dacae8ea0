"""Graph of a domain, made from liveliness tokens and reported as discovery events.

A session is a participant, and a client or server is two endpoints. A node exists while its own token or one of its
endpoints' tokens exists. Tokens arrive repeatedly and in any order; a token is identified by its whole text. Endpoints
of the own session are added immediately by their creator.

Endpoints with the same key match, whatever their QoS.

Source: docs/internals/zenoh.md 3 and 8.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass, field
from typing import TypeAlias

from rosidl_py_gen.runtime.transport.api import (
    DiscoveredEndpoint,
    DiscoveryEvent,
    EntityLost,
    NodeEntities,
    NodesAnnounced,
    ParticipantDiscovered,
    TopicKey,
)
from rosidl_py_gen.runtime.transport.dds.names import ros_type
from rosidl_py_gen.runtime.transport.endpoint_index import EndpointIndex
from rosidl_py_gen.runtime.transport.matching import IncompatibilityKind
from rosidl_py_gen.runtime.transport.zenoh.wire_formats import (
    EndpointToken,
    EntityKind,
    NodeToken,
    gid_of,
    read_token,
    valid_hash_or_empty,
)

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
