"""Index of the endpoints and participants that discovery has reported, a cache of results that depend on it, and the
share of a server's queue that a client may use.

The participant of a transport writes its index before it passes discovery events on. The graph and the services read
the index.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

from rosidl_py_gen.runtime.transport.api import (
    DiscoveredEndpoint,
    DiscoveryEvent,
    EntityLost,
    NodeEntities,
    NodesAnnounced,
    ParticipantDiscovered,
    TopicKey,
)
from rosidl_py_gen.runtime.transport.qos import History, QoSProfile

ResultT = TypeVar("ResultT")

_MAX_RESULTS = 1000
"""Maximum number of results in a cache. It is limited because keys contain numbers of clients, which peers choose."""


@dataclass(slots=True)
class KnownParticipant:
    """Participant with the data that discovery has reported about it so far.

    Attributes:
        enclave: None if the participant is not of ROS, or only its nodes are known.
        nodes: nodes that the participant has announced last.
        is_humble: as in `NodesAnnounced`.
        vendor: as in `ParticipantDiscovered`.
    """

    enclave: str | None = None
    nodes: tuple[NodeEntities, ...] = ()
    is_humble: bool | None = None
    vendor: bytes | None = None


class EndpointIndex:
    """Index of discovered endpoints by GUID and by topic, and of their participants.

    Thread: any. Reading methods take no lock and copy what they read in one operation; a lock serializes changes.
    """

    def __init__(self) -> None:
        self.version = 0
        """Number that is incremented after each change of endpoints or nodes, so that other threads can cache results
        together with it."""
        self.endpoints: dict[bytes, DiscoveredEndpoint] = {}
        self.participants: dict[bytes, KnownParticipant] = {}
        self._by_topic_key: dict[TopicKey, dict[bytes, DiscoveredEndpoint]] = {}
        """Discovered endpoints by topic and GUID. Plain dicts, because only they are copied in one operation without
        the GIL."""
        self._changed_topics: set[TopicKey] = set()
        self._caches: dict[TopicKey, list[MatchCache[Any]]] = {}
        self.change_lock = threading.RLock()
        """Lock of changes, and of the results of the caches."""

    def apply(self, events: Iterable[DiscoveryEvent]) -> None:
        """Apply discovery events to the index."""
        for event in events:
            match event:
                case DiscoveredEndpoint():
                    self.add(event)
                case EntityLost():
                    self.remove(event.guid)
                case ParticipantDiscovered():
                    with self.change_lock:
                        participant = self.participants.setdefault(event.guid, KnownParticipant())
                        participant.enclave, participant.vendor = event.enclave, event.vendor
                        self.version += 1
                case NodesAnnounced():
                    with self.change_lock:
                        self.set_nodes(event.guid, event.nodes)
                        self.participants[event.guid].is_humble = event.is_humble

    def add(self, endpoint: DiscoveredEndpoint) -> None:
        """Add an endpoint, or replace its data."""
        with self.change_lock:
            self.endpoints[endpoint.guid] = endpoint
            self._by_topic_key.setdefault(endpoint.topic_key, {})[endpoint.guid] = endpoint
            self._count_change(endpoint.topic_key)

    def remove(self, guid: bytes) -> None:
        """Remove an endpoint or a participant from the index, if it is known."""
        with self.change_lock:
            endpoint = self.endpoints.pop(guid, None)
            if endpoint is not None:
                others = self._by_topic_key.get(endpoint.topic_key, {})
                others.pop(guid, None)
                if not others:  # else the name of each topic that ever existed would be retained
                    self._by_topic_key.pop(endpoint.topic_key, None)
                self._count_change(endpoint.topic_key)
            elif self.participants.pop(guid, None) is not None:
                self.version += 1

    def set_nodes(self, participant_guid: bytes, nodes: Iterable[NodeEntities]) -> None:
        """Replace all nodes of a participant in the index."""
        with self.change_lock:
            self.participants.setdefault(participant_guid, KnownParticipant()).nodes = tuple(nodes)
            self.version += 1

    def _count_change(self, topic_key: TopicKey) -> None:
        """Record a change of a topic, and invalidate the caches that depend on the topic.

        Lock: change_lock must be held.
        """
        self._changed_topics.add(topic_key)
        self.version += 1
        for cache in self._caches.get(topic_key, ()):
            cache.invalidate()

    def take_changed_topics(self) -> set[TopicKey]:
        """Return the topics whose endpoints have changed since the last call."""
        with self.change_lock:
            changed, self._changed_topics = self._changed_topics, set()
            return changed

    def add_cache(self, cache: MatchCache[Any], topic_keys: Iterable[TopicKey]) -> None:
        """Register a cache, which is invalidated at each change of the given topics."""
        with self.change_lock:
            for topic_key in topic_keys:
                self._caches.setdefault(topic_key, []).append(cache)

    def remove_cache(self, cache: MatchCache[Any], topic_keys: Iterable[TopicKey]) -> None:
        """Stop invalidating a registered cache; without effect if the cache was removed before."""
        with self.change_lock:
            for topic_key in topic_keys:
                remaining = [one for one in self._caches.get(topic_key, ()) if one is not cache]
                if remaining:
                    self._caches[topic_key] = remaining
                else:
                    self._caches.pop(topic_key, None)

    def detach_after_fork(self) -> None:
        """Make endpoints closable in a forked child: a thread of the parent may have held the lock."""
        self.change_lock = threading.RLock()

    def endpoints_on(self, topic_key: TopicKey, *, writers: bool) -> list[DiscoveredEndpoint]:
        """Return the discovered endpoints of a topic: the writers, or with ``writers=False`` the readers."""
        endpoints = list(self._by_topic_key.get(topic_key, {}).values())  # copied at once: another thread may add some
        return [endpoint for endpoint in endpoints if endpoint.is_writer is writers]

    def topic_keys(self) -> list[TopicKey]:
        """Return the topics that have a discovered endpoint."""
        return list(self._by_topic_key)

    def known(self, guids: Iterable[bytes]) -> list[DiscoveredEndpoint]:
        """Return the endpoints with these GUIDs; GUIDs of undiscovered endpoints are skipped."""
        found = map(self.endpoints.get, guids)  # one operation for each: another thread may remove an endpoint
        return [endpoint for endpoint in found if endpoint is not None]


class MatchCache(dict[Hashable, ResultT]):
    """Cache of results of `check` by key, until an endpoint of one of its topics appears, changes or disappears.

    ``cache[key]`` returns the stored result, which takes no call of Python, or else the result of a new check. Only
    final results are stored: DDS does not report when discovered endpoints become matched, so another result may be
    outdated a moment later.

    The index refers to the cache until `close`.

    Args:
        index: index of the participant.
        topic_keys: topics on which the results depend.
        check: returns the result for a key.
        is_final: returns True for a result that no later match changes; by default for true results.
    """

    def __init__(
        self,
        index: EndpointIndex,
        topic_keys: Iterable[TopicKey],
        check: Callable[[Hashable], ResultT],
        is_final: Callable[[ResultT], object] = bool,
    ) -> None:
        super().__init__()
        self._index = index
        self._topic_keys = tuple(topic_keys)
        self._check = check
        self._is_final = is_final
        self.version = 0
        """Number of changes of the cache's topics so far, with which results that are stored elsewhere can be checked.
        """
        index.add_cache(self, self._topic_keys)

    def __missing__(self, key: Hashable) -> ResultT:
        version = self.version
        result = self._check(key)
        if self._is_final(result):
            with self._index.change_lock:
                if version == self.version:  # else the result of this thread may be older than the change
                    if len(self) >= _MAX_RESULTS:
                        self.clear()
                    self[key] = result
        return result

    def invalidate(self) -> None:
        """Discard all cached results. Lock: the lock of the index must be held."""
        self.version += 1
        self.clear()

    def close(self) -> None:
        """Detach the cache from its index. May be called twice."""
        self._index.remove_cache(self, self._topic_keys)


def fair_queue_share(servers: Iterable[QoSProfile], clients: Iterable[DiscoveredEndpoint]) -> int:
    """Return the number of requests that this participant may have in the queues of servers; 0 if unlimited.

    `servers` are the profiles of request readers, `clients` the request writers of all clients, including this
    participant's own. All clients share the queue of a server. So the smallest keep-last depth is divided by the number
    of the clients' participants; each participant gets at least 1.
    """
    depth = min((qos.depth for qos in servers if qos.history is History.KEEP_LAST), default=0)
    return depth and max(1, depth // max(1, len({client.participant_guid for client in clients})))
