"""What transports have in common whose clients and servers consist of a reader and a writer each.

Decides who is asked: what was discovered of the endpoints of services, and which of them are connected. And which
requests are lost: those that were sent while servers were there none of whom is left.
"""

from __future__ import annotations

from collections import defaultdict, deque
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, EntityLost
from rosidl_py_gen.runtime.transport.match_cache import MatchCache
from rosidl_py_gen.runtime.transport.qos import History
from rosidl_py_gen.runtime.transport.service_api import NoReply

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.runtime.transport.api import Reader, Writer
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveryEvent, TopicKey
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.service_api import Reply, ServerAvailability


def fair_queue_share(servers: Iterable[QoSProfile], clients: Iterable[DiscoveredEndpoint]) -> int:
    """How many requests of ours the server that keeps fewest keeps; 0 when all keep all.

    All clients share what a server keeps, whatever process they are in; each participant takes its part, and at least
    one.

    Args:
        servers: profiles of what the servers read.
        clients: what clients write, ours included.
    """
    kept = min((qos.depth for qos in servers if qos.history is History.KEEP_LAST), default=0)
    return kept and max(1, kept // max(1, len({one.participant_guid for one in clients})))


class ServicePeers:
    """What was discovered of the endpoints of services."""

    def __init__(self) -> None:
        self.version = 0
        """Grows with each change."""
        self._known: dict[bytes, DiscoveredEndpoint] = {}
        self._by_channel: defaultdict[TopicKey, dict[bytes, DiscoveredEndpoint]] = defaultdict(dict)

    def apply(self, events: Iterable[DiscoveryEvent]) -> None:
        """Take in what discovery reports."""
        for event in events:
            if isinstance(event, DiscoveredEndpoint) and event.service_type is not None:
                self._known[event.guid] = self._by_channel[event.channel][event.guid] = event
                self.version += 1
            elif isinstance(event, EntityLost) and event.guid in self._known:
                gone = self._known.pop(event.guid)
                here = self._by_channel[gone.channel]
                del here[event.guid]
                if not here:  # else each name that ever was would stay
                    del self._by_channel[gone.channel]
                self.version += 1

    def get(self, guid: bytes) -> DiscoveredEndpoint | None:
        """An endpoint, if it is known."""
        return self._known.get(guid)

    def on(self, channel: TopicKey, *, writers: bool) -> list[DiscoveredEndpoint]:
        """The writers or readers of a channel."""
        found = list(self._by_channel.get(channel, {}).values())  # at once: another thread may add some
        return [one for one in found if one.is_writer is writers]

    def known(self, guids: Iterable[bytes]) -> list[DiscoveredEndpoint]:
        """What is known of endpoints, without those that are not known."""
        return [self._known[guid] for guid in guids if guid in self._known]


class _EndpointPair:
    """The reader and the writer of a client or a server."""

    def __init__(self, reader: Reader, writer: Writer, gid: bytes) -> None:
        self.gid = gid
        self.endpoints = reader.guid, writer.guid
        self._reader = reader
        self._writer = writer
        self.connected = reader.matched_writers
        self.all_acknowledged = writer.all_acknowledged
        self.set_sink = reader.set_sink


class EndpointPairClient(_EndpointPair):
    """The part of a `service_port.ServiceClientTransport` that knows its servers.

    Args:
        requests: where requests go.
        replies: where replies come from.
    """

    def __init__(
        self, peers: ServicePeers, requests: TopicKey, replies: TopicKey, reader: Reader, writer: Writer, gid: bytes
    ) -> None:
        super().__init__(reader, writer, gid)
        self._peers = peers
        self._requests = requests
        self._replies = replies
        self._asked: dict[int, frozenset[bytes]] = {}
        """The servers that were there when a request was sent that somebody waits for."""
        self._lost: deque[int] = deque()
        self._servers: MatchCache[ServerAvailability] = MatchCache(peers, self._find)
        self._present: frozenset[bytes] = frozenset()
        self._present_at = -1

    def servers(self) -> ServerAvailability:
        """See `service_port.ServiceClientTransport`."""
        return self._servers.get()

    def _find(self, _: object) -> ServerAvailability:
        """Return the servers that are connected now."""
        raise NotImplementedError

    def server_endpoints(self) -> frozenset[bytes]:
        """See `service_port.ServiceClientTransport`."""
        peers = self._peers
        if peers.version != self._present_at:
            self._present_at = peers.version
            ends = *peers.on(self._requests, writers=False), *peers.on(self._replies, writers=True)
            self._present = frozenset(one.guid for one in ends)
        return self._present

    def cancel(self, number: int) -> None:
        """See `service_port.ServiceClientTransport`."""
        self._asked.pop(number, None)

    def report_lost_requests(self) -> None:
        """See `service_port.ServiceClientTransport`."""
        present = self.server_endpoints()
        self._reader.fetch()
        lost = [number for number, servers in self._asked.items() if servers and servers.isdisjoint(present)]
        for number in lost:
            del self._asked[number]
        self._lost.extend(lost)

    def _next_lost(self) -> Reply | None:
        return (self._lost.popleft(), NoReply(), None) if self._lost else None

    def close(self) -> None:
        """See `service_port.ServiceClientTransport`."""
        self._writer.close()
        self._reader.close()


class EndpointPairServer(_EndpointPair):
    """The part of a `service_port.ServiceServerTransport` that is no correlation."""

    def release(self) -> None:
        """See `service_port.ServiceServerTransport`."""

    def close(self) -> None:
        """See `service_port.ServiceServerTransport`."""
        self._reader.close()
        self._writer.close()
