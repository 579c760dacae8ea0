"""Who is there, by the liveliness tokens of a domain, as discovery events.

Decides how tokens become what the graph above the transport knows: a session is a participant, a client or a server is
two endpoints, and a node is there as long as its own token or one of its endpoints'. Tokens come more than once and in
any order; the whole text of one is its identity. Endpoints of our own session are told by who makes them, at once.

Who is connected with whom follows from names: everybody with the same key, whatever the quality of service.

Source: docs/internals/zenoh.md 3 and 8.
"""

from __future__ import annotations

import threading
from collections import defaultdict, deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.discovery_events import (
    DiscoveredEndpoint,
    EntityLost,
    NodeEntities,
    NodesAnnounced,
    ParticipantDiscovered,
    TopicKey,
)
from rosidl_py_gen.runtime.transport.incompatibility import IncompatibilityKind
from rosidl_py_gen.runtime.transport.type_names import ros_type
from rosidl_py_gen.runtime.transport.zenoh.keys import valid_hash_or_empty
from rosidl_py_gen.runtime.transport.zenoh.liveliness_tokens import (
    EndpointToken,
    EntityKind,
    NodeToken,
    gid_of,
    read_token,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveryEvent

_TOPIC_OF_ALL_NODES = TopicKey("topic", "/parameter_events")
_FLIPPED = (1 << 128) - 1


def paired_gid(gid: bytes) -> bytes:
    """The GUID of the other half of a client or server: its GID is that of the half that reads."""
    return (int.from_bytes(gid, "big") ^ _FLIPPED).to_bytes(16, "big")


def participant_guid(zid: str) -> bytes:
    """The GUID of a session, given by its id as Zenoh prints it."""
    return int(zid, 16).to_bytes(16, "big")


@dataclass(slots=True)
class _Node:
    token: NodeToken
    names: set[str] = field(default_factory=set)
    """The tokens that announce it; peers may tell several texts of one node."""
    readers: set[bytes] = field(default_factory=set)
    writers: set[bytes] = field(default_factory=set)


@dataclass(slots=True)
class _Session:
    guid: bytes
    nodes: dict[int, _Node] = field(default_factory=dict)


Key = tuple[TopicKey, str, str, bool]
"""Channel, type and hash of those who are connected with each other; whether the writers or the readers are meant."""


def endpoints_of(token: EndpointToken, gid: bytes) -> tuple[DiscoveredEndpoint, ...]:
    """What the graph knows of an endpoint: one of a topic, two of a client or server, the reading one first."""
    participant, told, type = (
        participant_guid(token.node.zid),
        valid_hash_or_empty(token.type_hash),
        ros_type(token.type),
    )
    wire = token.name, token.type
    if token.kind in (EntityKind.PUBLISHER, EntityKind.SUBSCRIPTION):
        is_writer, channel = token.kind is EntityKind.PUBLISHER, TopicKey("topic", token.name)
        return (DiscoveredEndpoint(gid, participant, is_writer, channel, type, token.qos, told, "", "", *wire),)
    request = TopicKey("request", token.name), f"{type}_Request"
    reply = TopicKey("reply", token.name), f"{type}_Response"
    read, written = (request, reply) if token.kind is EntityKind.SERVER else (reply, request)
    service = ("", gid.hex(), told)
    return (
        DiscoveredEndpoint(gid, participant, False, *read, token.qos, *service, *wire),
        DiscoveredEndpoint(paired_gid(gid), participant, True, *written, token.qos, *service, *wire),
    )


class TokenGraph:
    """The endpoints of a domain; for any thread."""

    def __init__(self, own_zid: str, enclave: str) -> None:
        self._own_zid = own_zid
        self._news: deque[tuple[bool, str]] = deque()
        self._lock = threading.RLock()
        self._sessions: dict[str, _Session] = {}
        self._tokens: dict[str, tuple[DiscoveredEndpoint, ...]] = {}
        self._connected: defaultdict[Key, dict[bytes, DiscoveredEndpoint]] = defaultdict(dict)
        """Those who are there, by their GUIDs."""
        self._events: list[DiscoveryEvent] = [ParticipantDiscovered(participant_guid(own_zid), enclave)]
        self._gone_clients: list[bytes] = []
        self.changes = 0
        """Counts those of who is there, as far as they were read."""

    def on_token(self, is_there: bool, token: str) -> None:
        """Note that a token appeared or disappeared, to be read later."""
        self._news.append((is_there, token))

    # ------------------------------------------------------------------------------------------------------- changes

    def add_own(self, endpoints: Iterable[DiscoveredEndpoint]) -> None:
        """An endpoint of ours is there."""
        with self._lock:
            for endpoint in endpoints:
                self._connect(endpoint)
                self._events.append(endpoint)

    def remove_own(self, endpoints: Iterable[DiscoveredEndpoint]) -> None:
        """Undo `add_own`."""
        with self._lock:
            for endpoint in endpoints:
                self._disconnect(endpoint)
                self._events.append(EntityLost(endpoint.guid))

    def _connect(self, endpoint: DiscoveredEndpoint) -> None:
        self._connected[_key(endpoint, endpoint.is_writer)][endpoint.guid] = endpoint
        self.changes += 1

    def _disconnect(self, endpoint: DiscoveredEndpoint) -> None:
        key = _key(endpoint, endpoint.is_writer)
        same = self._connected[key]
        same.pop(endpoint.guid, None)
        self.changes += 1
        if not same:
            del self._connected[key]

    def read(self) -> None:
        """Take in all tokens that were heard of."""
        with self._lock:
            changed: dict[str, None] = {}
            while self._news:
                is_there, text = self._news.popleft()
                token = read_token(text)
                if token is None:
                    continue
                zid = (token if isinstance(token, NodeToken) else token.node).zid
                if zid != self._own_zid and (self._add if is_there else self._remove)(text, token, zid):
                    changed[zid] = None
            for zid in changed:
                self._report_nodes(zid)

    def _add(self, text: str, token: NodeToken | EndpointToken, zid: str) -> bool:
        if text in self._tokens:
            return False
        owner = token if isinstance(token, NodeToken) else token.node
        session = self._sessions.get(zid)
        if session is None:
            session = self._sessions[zid] = _Session(participant_guid(zid))
            self._events.append(ParticipantDiscovered(session.guid, owner.enclave))
        node = session.nodes.setdefault(owner.node_id, _Node(owner))
        if isinstance(token, NodeToken):
            node.names.add(text)
            self._tokens[text] = ()
            return True
        endpoints = self._tokens[text] = endpoints_of(token, gid_of(text))
        for endpoint in endpoints:
            (node.writers if endpoint.is_writer else node.readers).add(endpoint.guid)
            self._connect(endpoint)
            self._events.append(endpoint)
        return True

    def _remove(self, text: str, token: NodeToken | EndpointToken, zid: str) -> bool:
        endpoints = self._tokens.pop(text, None)
        if endpoints is None:
            return False
        owner = token if isinstance(token, NodeToken) else token.node
        session = self._sessions.get(zid)
        node = None if session is None else session.nodes.get(owner.node_id)
        if node is None:
            return False
        if isinstance(token, NodeToken):
            node.names.discard(text)
        elif token.kind is EntityKind.CLIENT:
            self._gone_clients.append(endpoints[0].guid)
        for endpoint in endpoints:
            node.readers.discard(endpoint.guid)
            node.writers.discard(endpoint.guid)
            self._disconnect(endpoint)
            self._events.append(EntityLost(endpoint.guid))
        return True

    def _report_nodes(self, zid: str) -> None:
        """Tell which nodes a session has, or that it is gone."""
        session = self._sessions[zid]
        nodes = session.nodes = {
            number: node for number, node in session.nodes.items() if node.names or node.readers or node.writers
        }
        if not nodes:
            del self._sessions[zid]
            self._events.append(EntityLost(session.guid))
            return
        told = tuple(
            NodeEntities(node.token.namespace, node.token.name, frozenset(node.readers), frozenset(node.writers))
            for node in nodes.values()
        )
        self._events.append(NodesAnnounced(session.guid, told))

    # ----------------------------------------------------------------------------------------------------- questions

    def events(self) -> list[DiscoveryEvent]:
        """What was not reported yet."""
        self.read()
        with self._lock:
            events, self._events = self._events, []
        return events

    def take_gone_clients(self) -> list[bytes]:
        """GIDs of the clients that disappeared since the last time."""
        with self._lock:
            gone, self._gone_clients = self._gone_clients, []
        return gone

    def version(self) -> int:
        """Counts changes of who is there, all that was heard of included."""
        if self._news:
            self.read()
        return self.changes

    def connected(self, endpoint: DiscoveredEndpoint) -> dict[bytes, DiscoveredEndpoint]:
        """The endpoints at the other side of one, by their GUIDs."""
        return self._of(_key(endpoint, not endpoint.is_writer))

    def endpoints_on_same_side(self, endpoint: DiscoveredEndpoint) -> dict[bytes, DiscoveredEndpoint]:
        """The endpoints at the same side as one, itself included, by their GUIDs."""
        return self._of(_key(endpoint, endpoint.is_writer))

    def _of(self, key: Key) -> dict[bytes, DiscoveredEndpoint]:
        if self._news:
            self.read()
        with self._lock:
            return dict(self._connected.get(key, ()))


def _key(endpoint: DiscoveredEndpoint, is_writer: bool) -> Key:
    return endpoint.channel, endpoint.type, _announced_hash(endpoint), is_writer


def _announced_hash(endpoint: DiscoveredEndpoint) -> str:
    # A service that tells no hash has that of its request at most in our own graph, and others do not know it.
    return endpoint.service_hash if endpoint.service_id else endpoint.type_hash


def incompatibility(writer: DiscoveredEndpoint, reader: DiscoveredEndpoint) -> IncompatibilityKind | None:
    """Return why two endpoints of one topic and type are not connected: their hashes differ. None when they are.

    Of a service only the half that asks has a reason, and none where every node has both ends: there would be hundreds.
    """
    hashes = {_announced_hash(writer), _announced_hash(reader)}
    if len(hashes) == 1 or writer.channel == _TOPIC_OF_ALL_NODES or writer.channel.kind == "reply":
        return None
    return IncompatibilityKind.HASH_FORMAT if "" in hashes else IncompatibilityKind.DEFINITION
