"""Clients and servers of services on DDS and in memory, each with a reader and a writer.

The DDS library is not called here. `correlation.py` identifies requests and replies. A client finds its servers among
the discovered endpoints, and reports requests as lost if they were sent to servers of which none is left.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Protocol, TypeAlias

from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.logs.loggers import internal_logger
from rosidl_py_gen.runtime.transport.api import (
    DiscoveredEndpoint,
    EndpointSpec,
    Participant,
    Payload,
    Reader,
    TopicKey,
    Writer,
)
from rosidl_py_gen.runtime.transport.dds.correlation import (
    ClientCorrelation,
    ClientId,
    SampleIdentity,
    add_request_header,
    client_gid,
    extract_identity,
    find_servers,
    is_reply_reader_matched,
    parse_request_header,
    strip_request_header,
)
from rosidl_py_gen.runtime.transport.dds.names import entity_id
from rosidl_py_gen.runtime.transport.endpoint_index import MatchCache
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.runtime.transport.reply_window import ReplyWindow
from rosidl_py_gen.runtime.transport.service_api import (
    IncompatiblePeer,
    NoReply,
    Reply,
    Request,
    ServerAvailability,
    ServiceSpec,
)

_RequestOrigin: TypeAlias = "tuple[ClientId, int, bytes | None, int]"
"""Contents of a `RequestId`: client, number of the request, GUID of the client's request writer, and local handle of
this writer.

The GUID is None if the writer disappeared before its GUID was known.
"""


class ServiceWriter(Writer, Protocol):
    """Interface of a writer that can send a sample identity as inline QoS."""

    def write(self, data: Payload, identity: SampleIdentity | None = None) -> bool: ...


class ServiceParticipant(Participant, Protocol):
    """Interface of a participant that can create the reader and writer of a `DdsClient` or `DdsServer`."""

    def service_refusal(self, service: ServiceSpec) -> str | None:
        """Return the reason why Fast DDS servers of a service cannot be used; None if they can be used."""

    def uses_sample_identity(self, guid: bytes) -> bool:
        """Return True if the participant or endpoint `guid` is on Fast DDS: it uses sample identities, not headers."""

    def next_gid(self) -> bytes:
        """Return the 16 bytes that identify a new client or server in ROS."""

    def create_writer(self, spec: EndpointSpec) -> ServiceWriter: ...


class _EndpointPair:
    """Reader and writer of a client or a server.

    The endpoint on the reply topic is created first: a server may reply as soon as it knows the client's request writer
    (docs/internals/protocol.md 5.2).
    """

    matches_by_hash = False

    def __init__(
        self, participant: ServiceParticipant, service: ServiceSpec, reader: Reader, writer: ServiceWriter, gid: bytes
    ) -> None:
        self._participant = participant
        self._uses_sample_identity = participant.uses_sample_identity
        self._index = participant.endpoint_index
        self._service = service
        self._topic_keys = self._requests, self._replies = service.topic_keys
        self._gid = gid
        self.is_introspected = False
        self.endpoints = reader.guid, writer.guid
        self._reader = reader
        self._writer = writer
        self._senders: MatchCache[bytes | None] = MatchCache(self._index, self._topic_keys, self._find_sender)
        """GUIDs of the writers of received samples, by local handle of the writer."""
        self.connected = reader.matched_writers
        self.all_acknowledged = writer.all_acknowledged
        self.set_sink = reader.set_sink

    @property
    def gid(self) -> bytes:
        """16 bytes that identify the client or server in ROS."""
        return self._gid

    def _close_caches(self, *caches: MatchCache[Any]) -> None:
        for cache in (self._senders, *caches):
            cache.close()

    def _find_sender(self, handle: Any) -> bytes | None:
        return self._reader.writer_guid(handle)

    def _endpoints_on(self, topic_key: TopicKey, *, writers: bool) -> list[DiscoveredEndpoint]:
        """Return the discovered endpoints of clients and servers on a topic; endpoints of other types are skipped."""
        endpoints = self._index.endpoints_on(topic_key, writers=writers)
        return [endpoint for endpoint in endpoints if endpoint.service_type is not None]


_MAX_TRIES = 10
"""Maximum number of times that a client looks for servers while endpoints change."""


class DdsClient(_EndpointPair):
    """Client of a service on DDS or in memory."""

    def __init__(self, participant: ServiceParticipant, service: ServiceSpec) -> None:
        gid, (request, reply) = participant.next_gid(), service.endpoints
        reader = participant.create_reader(replace(reply, client_id=entity_id(gid)))
        with _closed_on_failure(reader):
            writer = participant.create_writer(replace(request, client_id=entity_id(gid)))
        super().__init__(participant, service, reader, writer, gid)
        self._correlation = ClientCorrelation(writer.handle, reader.guid, writer.guid, participant.uses_sample_identity)
        self._sent = 0
        self._in_flight: dict[int, frozenset[bytes]] = {}
        """Requests without a reply: GUIDs of the servers' endpoints that existed when the request was sent, by number
        of the request."""
        self._lost: deque[int] = deque()
        cache = self._index, self._topic_keys
        self._servers: MatchCache[ServerAvailability] = MatchCache(
            *cache, self._find_servers, lambda servers: servers.is_available and servers.is_complete
        )
        """Cache of the availability of servers, by the reason why Fast DDS servers cannot be used."""
        self._server_endpoints: MatchCache[frozenset[bytes]] = MatchCache(*cache, self._find_server_endpoints)
        """Cache with one entry, for the key None: the GUIDs of all endpoints of servers."""

    @property
    def gid(self) -> bytes:
        """GID under which servers report this client in introspection events.

        Fast DDS servers use the GUID of the reply reader.
        """
        return self.endpoints[0] if self._correlation.uses_sample_identity else self._gid

    def send(self, data: bytes, timeout_s: float | None = None) -> int | None:
        if not self._servers:  # since then the discovered endpoints have changed, or a server was not matched
            self.servers()
        number = self._sent + 1
        message, identity = self._correlation.request(data, number, always_identified=self.is_introspected)
        try:
            is_sent = self._writer.write(message, identity)
        except Exception:
            raise
        except BaseException:  # a signal handler raised after the sample was written
            self._sent = number
            raise
        if not is_sent:
            return None
        self._sent = number
        self._in_flight[number] = self._server_endpoints[None]
        return number

    def cancel(self, number: int) -> None:
        self._in_flight.pop(number, None)

    def take(self) -> Reply | None:
        items = self._reader.queue.items
        while items:
            try:
                data, _, handle, _, _ = items.popleft()
            except IndexError:  # another thread was faster
                break
            server = self._senders[handle]
            try:
                reply = self._correlation.reply(data, server)
            except DecodeError as err:
                internal_logger().warning(f"dropped a reply on {self._service.name}: {err}", throttle_s=1.0)
                continue
            if reply is not None:
                return *reply, server
        return (self._lost.popleft(), NoReply(), None) if self._lost else None

    def report_lost_requests(self) -> None:
        endpoints = self.server_endpoints()
        self._reader.fetch()
        lost = [number for number, servers in self._in_flight.items() if servers and servers.isdisjoint(endpoints)]
        for number in lost:
            del self._in_flight[number]
        self._lost.extend(lost)

    def servers(self) -> ServerAvailability:
        return self._servers[self._participant.service_refusal(self._service)]

    def server_endpoints(self) -> frozenset[bytes]:
        return self._server_endpoints[None]

    def _find_server_endpoints(self, _: object) -> frozenset[bytes]:
        on = self._endpoints_on
        endpoints = *on(self._requests, writers=False), *on(self._replies, writers=True)
        return frozenset(endpoint.guid for endpoint in endpoints)

    def _find_servers(self, refusal: Any) -> ServerAvailability:
        tries = 0
        while True:
            version = self._servers.version
            servers, readers, needs_identity = self._present_servers(refusal)
            tries += 1
            with self._index.change_lock:
                # If endpoints changed meanwhile, another thread may have stored newer servers.
                if version == self._servers.version or tries == _MAX_TRIES:
                    self._correlation.update_servers(readers, uses_sample_identity=needs_identity)
                    return servers

    def _present_servers(self, refusal: Any) -> tuple[ServerAvailability, set[bytes], bool]:
        """Return the availability, the request readers of the servers, and True if requests need sample identities."""
        matched, matched_writers = self._writer.matched_readers(), self._reader.matched_writers()
        announced, clients = (self._endpoints_on(self._requests, writers=writers) for writers in (False, True))
        pairs = self._index.known(matched), self._index.known(matched_writers)
        servers, needs_identity = find_servers(
            *pairs, announced, clients, refusal, self._service.is_compatible, self._uses_sample_identity
        )
        readers = {*matched, *(reader.guid for reader in announced)}
        unusable = servers.incompatible_server
        if unusable is not None and self._participant.services_unavailable_reason is None:
            # Because of the rules of a secured domain.
            servers = replace(servers, incompatible_server=unusable._replace(has_topics=False))
        known_writers = (writer.guid for writer in self._endpoints_on(self._replies, writers=True))
        if readers <= {*matched} and {*known_writers} <= {*matched_writers}:
            return servers, readers, needs_identity
        # Cyclone matches an endpoint some time after its discovery. A server on Fast DDS changes the form of requests.
        return replace(servers, is_complete=False), readers, needs_identity

    def close(self) -> None:
        self._close_caches(self._servers, self._server_endpoints)
        self._writer.close()
        self._reader.close()


class DdsServer(_EndpointPair):
    """Server of a service on DDS or in memory."""

    def __init__(self, participant: ServiceParticipant, service: ServiceSpec) -> None:
        gid, (request, reply) = participant.next_gid(), service.endpoints
        writer = participant.create_writer(replace(reply, service_id=entity_id(gid)))
        with _closed_on_failure(writer):
            reader = participant.create_reader(replace(request, service_id=entity_id(gid)))
        super().__init__(participant, service, reader, writer, gid)
        self._reachable_clients: MatchCache[bool] = MatchCache(self._index, self._topic_keys, self._is_reachable)
        """Cached results of `can_reach_client`, by client and the GUID of the client's request writer."""
        self._window = ReplyWindow(writer.all_acknowledged)
        self._window_version = -1
        """Version of `_reachable_clients` at which the limit of `_window` was set."""

    def take(self) -> Request | None:
        items = self._reader.queue.items
        if not items:
            return None
        try:
            data, source_ns, handle, received_ns, _ = items.popleft()
        except IndexError:  # another thread was faster
            return None
        writer = self._senders[handle]
        if writer is not None and self._uses_sample_identity(writer) and extract_identity(data) is None:
            reason = self._participant.services_unavailable_reason or ""
            return None, IncompatiblePeer(writer, reason), writer, source_ns, received_ns
        try:
            client, number, begin = parse_request_header(data)
        except DecodeError as err:
            return None, err, writer, source_ns, received_ns
        if self._window_version != self._reachable_clients.version:
            self._update_window()
        if self._window.limit > 0:
            self._window.on_request(client)
        return (client, number, writer, handle), strip_request_header(data, begin), writer, source_ns, received_ns

    def send(self, to: _RequestOrigin, data: bytes) -> bool:
        client, number, _, _ = to
        if self._window_version != self._reachable_clients.version:
            self._update_window()
        window = self._window if self._window.limit > 0 else None
        if window is not None and not window.is_open(client):
            return False
        if isinstance(client, bytes):
            is_sent = self._writer.write(data, (client, number))
        else:
            is_sent = self._writer.write(add_request_header(data, client, number))
        if is_sent and window is not None:
            window.on_sent(client)
        return is_sent

    def _update_window(self) -> None:
        """Set the limit of the flow control from the reply readers of the discovered clients."""
        self._window_version = self._reachable_clients.version
        readers = self._endpoints_on(self._replies, writers=False)
        # Fast DDS does not announce the depth of its queue: the default of ROS is assumed.
        self._window.set_readers(
            SERVICES_DEFAULT if self._uses_sample_identity(reader.guid) else reader.qos for reader in readers
        )

    def release(self) -> None:
        self._window.release()

    def can_reach_client(self, to: _RequestOrigin) -> bool:
        client, _, guid, _ = to
        return self._reachable_clients[client, guid]

    def _is_reachable(self, key: Any) -> bool:
        client, guid = key
        find = self._index.endpoints.get
        writer = None if guid is None else find(guid)
        return is_reply_reader_matched(client, writer, self._writer.matched_readers, find)

    def request_origin(self, to: _RequestOrigin) -> tuple[bytes, int]:
        client, number, _, handle = to
        return client_gid(client, handle), number

    def close(self) -> None:
        self._close_caches(self._reachable_clients)
        self._reader.close()
        self._writer.close()


@contextmanager
def _closed_on_failure(endpoint: Reader | Writer) -> Iterator[None]:
    """Close `endpoint` if the other endpoint of its pair cannot be created: permissions may allow only one of them."""
    try:
        yield
    except BaseException:
        endpoint.close()
        raise
