"""Common part of transports whose clients and servers consist of a reader and a writer each.

Finds the servers of a client among the discovered endpoints, and the requests that are lost: those that were sent to
servers of which none is left.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Hashable, Iterable
from typing import Generic, Protocol, TypeVar

from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, DiscoveryEvent, EntityLost, Reader, TopicKey, Writer
from rosidl_py_gen.runtime.transport.qos import History, QoSProfile
from rosidl_py_gen.runtime.transport.service_api import NoReply, Reply, ServerAvailability, ServiceSpec

ResultT = TypeVar("ResultT")


class Versioned(Protocol):
    """A set of endpoints whose `version` grows with each change."""

    version: int


class MatchCache(Generic[ResultT]):
    """Results of `check`, cached per key while they are true and the version of `endpoints` stays the same.

    DDS does not report when discovered endpoints become matched: a negative result may be outdated a moment later.
    """

    def __init__(self, endpoints: Versioned, check: Callable[[Hashable], ResultT]) -> None:
        self._endpoints = endpoints
        self._check = check
        self._positive: dict[Hashable, ResultT] = {}
        self._version = -1

    def get(self, key: Hashable = None) -> ResultT:
        """Return the cached result for `key`, or check."""
        version = self._endpoints.version
        if version != self._version:
            self._positive.clear()
            self._version = version
        result = self._positive.get(key)
        if result is None:
            result = self._check(key)
            if result and version == self._version:  # else another thread has seen a newer version
                self._positive[key] = result
        return result

    def clear(self) -> None:
        """Discard all results."""
        self._positive.clear()


def fair_queue_share(servers: Iterable[QoSProfile], clients: Iterable[DiscoveredEndpoint]) -> int:
    """Return the number of requests that this participant may have in the queues of servers; 0 if unlimited.

    `clients` are the request writers of all clients, own ones included. They share the queue of a server, so the
    smallest keep-last depth is divided by the number of their participants; each of these gets at least 1.
    """
    depth = min((qos.depth for qos in servers if qos.history is History.KEEP_LAST), default=0)
    return depth and max(1, depth // max(1, len({client.participant_guid for client in clients})))


class ServicePeers:
    """Discovered endpoints of services."""

    def __init__(self) -> None:
        self.version = 0
        """Grows with each change."""
        self._known: dict[bytes, DiscoveredEndpoint] = {}
        self._by_topic_key: defaultdict[TopicKey, dict[bytes, DiscoveredEndpoint]] = defaultdict(dict)

    def apply(self, events: Iterable[DiscoveryEvent]) -> None:
        """Record discovery events."""
        for event in events:
            if isinstance(event, DiscoveredEndpoint) and event.service_type is not None:
                self._known[event.guid] = self._by_topic_key[event.topic_key][event.guid] = event
                self.version += 1
            elif isinstance(event, EntityLost) and event.guid in self._known:
                lost = self._known.pop(event.guid)
                remaining = self._by_topic_key[lost.topic_key]
                del remaining[event.guid]
                if not remaining:  # else the name of each service that ever existed would be retained
                    del self._by_topic_key[lost.topic_key]
                self.version += 1

    def get(self, guid: bytes) -> DiscoveredEndpoint | None:
        """Return the endpoint with that GUID, or None."""
        return self._known.get(guid)

    def on(self, topic_key: TopicKey, *, writers: bool) -> list[DiscoveredEndpoint]:
        """Return the writers or readers of a topic."""
        endpoints = list(self._by_topic_key.get(topic_key, {}).values())  # copied at once: another thread may add some
        return [endpoint for endpoint in endpoints if endpoint.is_writer is writers]

    def known(self, guids: Iterable[bytes]) -> list[DiscoveredEndpoint]:
        """Return the endpoints with these GUIDs, without those that are not discovered."""
        return [self._known[guid] for guid in guids if guid in self._known]


class _EndpointPair:
    """Reader and writer of a client or a server."""

    matches_by_hash = False

    def __init__(self, reader: Reader, writer: Writer, gid: bytes) -> None:
        self._gid = gid
        self.is_introspected = False
        self.endpoints = reader.guid, writer.guid
        self._reader = reader
        self._writer = writer
        self.connected = reader.matched_writers
        self.all_acknowledged = writer.all_acknowledged
        self.set_sink = reader.set_sink

    @property
    def gid(self) -> bytes:
        """16 bytes that identify the client or server in ROS."""
        return self._gid

    def accept_type_hash(self, type_hash: str) -> None:
        """Do nothing: definitions do not keep endpoints apart."""


class EndpointPairClient(_EndpointPair):
    """Part of a `TransportClient` that knows the servers."""

    def __init__(self, service: ServiceSpec, peers: ServicePeers, reader: Reader, writer: Writer, gid: bytes) -> None:
        super().__init__(reader, writer, gid)
        self._service = service
        self._peers = peers
        self._requests, self._replies = service.topic_keys
        self._in_flight: dict[int, frozenset[bytes]] = {}
        """Endpoints of the servers that existed when a request was sent, by the number of the request."""
        self._lost: deque[int] = deque()
        self._servers: MatchCache[ServerAvailability] = MatchCache(peers, self._find)
        self._server_endpoints: MatchCache[frozenset[bytes]] = MatchCache(peers, self._find_server_endpoints)

    def servers(self) -> ServerAvailability:
        return self._servers.get()

    def _find(self, _: object) -> ServerAvailability:
        raise NotImplementedError

    def server_endpoints(self) -> frozenset[bytes]:
        return self._server_endpoints.get()

    def _find_server_endpoints(self, _: object) -> frozenset[bytes]:
        endpoints = *self._peers.on(self._requests, writers=False), *self._peers.on(self._replies, writers=True)
        return frozenset(endpoint.guid for endpoint in endpoints)

    def cancel(self, number: int) -> None:
        self._in_flight.pop(number, None)

    def report_lost_requests(self) -> None:
        endpoints = self.server_endpoints()
        self._reader.fetch()
        lost = [number for number, servers in self._in_flight.items() if servers and servers.isdisjoint(endpoints)]
        for number in lost:
            del self._in_flight[number]
        self._lost.extend(lost)

    def _next_lost(self) -> Reply | None:
        return (self._lost.popleft(), NoReply(), None) if self._lost else None

    def close(self) -> None:
        self._writer.close()
        self._reader.close()


class EndpointPairServer(_EndpointPair):
    """Part of a `TransportServer` that does not depend on how requests are identified."""

    def release(self) -> None:
        """Do nothing: there is no flow control."""

    def close(self) -> None:
        self._reader.close()
        self._writer.close()
