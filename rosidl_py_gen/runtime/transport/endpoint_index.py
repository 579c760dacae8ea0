"""Index of discovered endpoints, a cache of results that depend on them, and the share of a server's queue that a
client may use.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterable
from typing import Generic, TypeVar

from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, DiscoveryEvent, EntityLost, TopicKey
from rosidl_py_gen.runtime.transport.qos import History, QoSProfile

ResultT = TypeVar("ResultT")


class EndpointIndex:
    """Index of discovered endpoints by GUID and by topic.

    Thread: any. Reading methods take no lock and copy what they read in one operation; a lock serializes changes.
    """

    def __init__(self) -> None:
        self.version = 0
        """Number that is incremented after each change of the index, so that other threads can cache results together
        with it."""
        self.endpoints: dict[bytes, DiscoveredEndpoint] = {}
        self._by_topic_key: dict[TopicKey, dict[bytes, DiscoveredEndpoint]] = {}
        """Discovered endpoints by topic and GUID. Plain dicts, because only they are copied in one operation without
        the GIL."""
        self._change_lock = threading.RLock()

    def add(self, endpoint: DiscoveredEndpoint) -> None:
        """Add an endpoint, or replace its data."""
        with self._change_lock:
            self.endpoints[endpoint.guid] = endpoint
            self._by_topic_key.setdefault(endpoint.topic_key, {})[endpoint.guid] = endpoint
            self.version += 1

    def remove(self, guid: bytes) -> None:
        """Remove an endpoint, if it is known."""
        with self._change_lock:
            endpoint = self.endpoints.pop(guid, None)
            if endpoint is not None:
                others = self._by_topic_key.get(endpoint.topic_key, {})
                others.pop(guid, None)
                if not others:  # else the name of each topic that ever existed would be retained
                    self._by_topic_key.pop(endpoint.topic_key, None)
                self.version += 1

    def endpoints_on(self, topic_key: TopicKey, *, writers: bool) -> list[DiscoveredEndpoint]:
        """Return the discovered endpoints of a topic: the writers, or with ``writers=False`` the readers."""
        endpoints = list(self._by_topic_key.get(topic_key, {}).values())  # copied at once: another thread may add some
        return [endpoint for endpoint in endpoints if endpoint.is_writer is writers]


class ServicePeers(EndpointIndex):
    """Index of the discovered endpoints of clients and servers."""

    def apply(self, events: Iterable[DiscoveryEvent]) -> None:
        """Add or remove the endpoints of services that discovery events report."""
        for event in events:
            if isinstance(event, EntityLost):
                self.remove(event.guid)
            elif isinstance(event, DiscoveredEndpoint) and event.service_type is not None:
                self.add(event)

    def known(self, guids: Iterable[bytes]) -> list[DiscoveredEndpoint]:
        """Return the endpoints with these GUIDs; GUIDs of undiscovered endpoints are skipped."""
        found = map(self.endpoints.get, guids)  # one operation for each: another thread may remove an endpoint
        return [endpoint for endpoint in found if endpoint is not None]


class MatchCache(Generic[ResultT]):
    """Cache of results of `check` by key, valid while the version of `endpoints` does not change.

    Only true results are cached: DDS does not report when discovered endpoints become matched, so a false result may be
    outdated a moment later.
    """

    def __init__(self, endpoints: EndpointIndex, check: Callable[[Hashable], ResultT]) -> None:
        self._endpoints = endpoints
        self._check = check
        self._cached: tuple[int, dict[Hashable, ResultT]] = -1, {}
        """Version of the endpoints, and the true results by key for that version.

        A thread that is late stores its result into the dict of its own version.
        """

    def get(self, key: Hashable = None) -> ResultT:
        """Return the cached result for `key`, or else the result of a new check."""
        version, (cached_version, positive) = self._endpoints.version, self._cached
        if version != cached_version:
            positive = {}
            self._cached = version, positive
        result = positive.get(key)
        if result is None:
            result = self._check(key)
            if result:
                positive[key] = result
        return result


def fair_queue_share(servers: Iterable[QoSProfile], clients: Iterable[DiscoveredEndpoint]) -> int:
    """Return the number of requests that this participant may have in the queues of servers; 0 if unlimited.

    `servers` are the profiles of request readers, `clients` the request writers of all clients, including this
    participant's own. All clients share the queue of a server. So the smallest keep-last depth is divided by the number
    of the clients' participants; each participant gets at least 1.
    """
    depth = min((qos.depth for qos in servers if qos.history is History.KEEP_LAST), default=0)
    return depth and max(1, depth // max(1, len({client.participant_guid for client in clients})))
