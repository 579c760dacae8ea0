"""Clients and servers of services on DDS and in memory, each with a reader and a writer.

The DDS library is not called here. A client finds its servers among the discovered endpoints, and reports requests as
lost if they were sent to servers of which none is left.

Requests and replies are identified in one of two formats: the header of rmw_cyclonedds, and the `SampleIdentity` of
Fast DDS. The functions work on bytes and GUIDs, and represent both formats as a client and a number; the type of the
client (`int` or `bytes`) shows the format.

Source: docs/internals/protocol.md 5.1 to 5.4, docs/internals/dds.md 3 and 4.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Protocol, TypeAlias

from rosidl_py_gen.cdr.layout import Alignment, Header
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.logs import internal_logger
from rosidl_py_gen.runtime.transport.api import (
    GUID_PREFIX_BYTES,
    DiscoveredEndpoint,
    EndpointSpec,
    IncompatiblePeer,
    NoReply,
    Participant,
    Payload,
    Reader,
    Reply,
    Request,
    ServerAvailability,
    ServiceSpec,
    TopicKey,
    Writer,
)
from rosidl_py_gen.runtime.transport.dds.names import entity_id
from rosidl_py_gen.runtime.transport.endpoint_index import MatchCache, fair_queue_share
from rosidl_py_gen.runtime.transport.flow_control import ReplyWindow
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

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
            *cache, self._find_servers, lambda servers: servers.is_available and servers.is_matching_complete
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
        return replace(servers, is_matching_complete=False), readers, needs_identity

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


# ------------------------------------------------------------------------------------------------------- identification

SampleIdentity: TypeAlias = "tuple[bytes, int]"
"""GUID of a client and number of a request; with Fast DDS, both are sent together with the request and with its reply.
"""
ClientId: TypeAlias = "int | bytes"
"""Client of a request: its number on rmw_cyclonedds, the GUID of its reply reader or request writer on Fast DDS."""
UsesSampleIdentity: TypeAlias = "Callable[[bytes], bool]"
"""Function that returns True if the endpoint with a GUID uses sample identities, as on Fast DDS, and not headers."""

SERVICE_HEADER_BYTES = 16
IDENTITY_BYTES = 24
_READER_BIT = 0x04
"""Bit that is set in the last byte of the GUID of a reader."""
_IDENTITY_OPTIONS = b"\xfd\x5d"
"""Option bytes of the encapsulation header (otherwise zero) that mark an embedded sample identity."""
_LITTLE = struct.Struct("<Qq")
_BIG = struct.Struct(">Qq")
_identity = struct.Struct("<16sq")
_MASK = 2**64 - 1
# An attribute of a class takes 12 ns more.
_HEADER_BYTES = Header.SIZE
_NETWORK_ALIGN = Alignment.NETWORK
_FILL = Alignment.PADDING[_NETWORK_ALIGN]
_LARGE_BYTES = 1024
"""Size in bytes from which a message is passed as a memoryview, because this is cheaper than another copy."""


def embed_identity(data: Payload, identity: SampleIdentity) -> bytes:
    """Return a sample with a sample identity inserted between encapsulation header and message, and marked in the
    header.
    """
    # Fast DDS sends the identity as RTPS inline QoS, which is not part of a sample; `sample_identity.py` calls this.
    # The 24 bytes replace the header of rmw_cyclonedds. They are a multiple of 8, so the alignment does not change.
    return b"".join((data[:2], _IDENTITY_OPTIONS, _identity.pack(*identity), data[_HEADER_BYTES:]))


def extract_identity(data: Payload) -> SampleIdentity | None:
    """Return the sample identity that `embed_identity` inserted into a sample; None if there is none."""
    if data[2:4] != _IDENTITY_OPTIONS or len(data) < _HEADER_BYTES + IDENTITY_BYTES:
        return None
    guid, sequence = _identity.unpack_from(data, _HEADER_BYTES)
    return guid, sequence


def add_request_header(message: Payload, client: int, sequence: int) -> bytes:
    """Return an encoded message (little-endian) with the request header of rmw_cyclonedds, padded for DDS without a
    further copy.
    """
    # The header of rmw_cyclonedds is between the 4 encapsulation bytes and the message: 8 bytes number of the client, 8
    # bytes number of the request (docs/internals/protocol.md 5.1).
    rest = message[_HEADER_BYTES:] if len(message) < _LARGE_BYTES else memoryview(message)[_HEADER_BYTES:]
    return b"".join(
        (message[:_HEADER_BYTES], _LITTLE.pack(client & _MASK, sequence), rest, _FILL[len(message) % _NETWORK_ALIGN])
    )


def parse_request_header(data: Payload) -> tuple[ClientId, int, int]:
    """Return client, number of the request, and offset of the message from a request or reply of either format.

    Raises:
        DecodeError: the data is too short for a header.
    """
    if data[2:4] == _IDENTITY_OPTIONS:  # before the call, which most messages need not
        identity = extract_identity(data)
        if identity is not None:
            return *identity, _HEADER_BYTES + IDENTITY_BYTES
    begin = _HEADER_BYTES + SERVICE_HEADER_BYTES
    if len(data) < begin:
        raise DecodeError("service header", len(data), f"expected at least {begin} bytes, found {len(data)}")
    client, sequence = (_LITTLE if data[1] & 1 else _BIG).unpack_from(data, _HEADER_BYTES)
    return client, sequence, begin


def strip_request_header(data: Payload, begin: int) -> bytes:
    """Return a copy of a request or reply without the header or sample identity before the message, which begins at
    `begin`.
    """
    rest = data[begin:] if len(data) < _LARGE_BYTES else memoryview(data)[begin:]
    return b"".join((data[:2], b"\0\0", rest))


def client_gid(client: ClientId, handle: int) -> bytes:
    """Return the GID under which a server knows a client.

    The GID is the GUID of the client's endpoint, or else the client's number and the local `handle` of its writer.
    """
    if isinstance(client, bytes):
        return client
    return (client & _MASK).to_bytes(8, "little") + (handle & _MASK).to_bytes(8, "little")


def find_servers(
    readers: Collection[DiscoveredEndpoint],
    writers: Collection[DiscoveredEndpoint],
    announced: Collection[DiscoveredEndpoint],
    clients: Iterable[DiscoveredEndpoint],
    refusal: str | None,
    is_compatible: Callable[[DiscoveredEndpoint], bool],
    uses_sample_identity: UsesSampleIdentity,
) -> tuple[ServerAvailability, bool]:
    """Find the servers that a client can call.

    A server is available if its request reader and its reply writer are both matched.

    Args:
        readers: request readers that are matched with the client.
        writers: reply writers that are matched with the client.
        announced: all discovered request readers.
        clients: all discovered request writers, the client's included.
        refusal: reason why Fast DDS servers cannot be used; None if they can be used.
        is_compatible: returns False for an endpoint with another definition of the service, which must not be used.
        uses_sample_identity: returns True for the GUID of an endpoint on Fast DDS.

    Returns:
        The availability, and True if requests need a sample identity, because a matched server is on Fast DDS.

    Source: docs/internals/protocol.md 5.2.
    """
    # Fast DDS does not announce the depth of its queue: the default of ROS is assumed.
    depth = fair_queue_share(
        (SERVICES_DEFAULT if uses_sample_identity(reader.guid) else reader.qos for reader in readers), clients
    )
    readers, writers = list(filter(is_compatible, readers)), list(filter(is_compatible, writers))
    # Fast DDS announces no service ids: there a server is a request reader and a reply writer of one participant.
    fast_dds = {reader.participant_guid for reader in readers if uses_sample_identity(reader.guid)}
    fast_dds &= {writer.participant_guid for writer in writers if uses_sample_identity(writer.guid)}
    # rmw_cyclonedds announces a service id for both endpoints of a server, but some servers announce none.
    reader_ids = {reader.service_id for reader in readers if not uses_sample_identity(reader.guid)}
    writer_ids = {writer.service_id for writer in writers if not uses_sample_identity(writer.guid)}
    announced_ids = reader_ids - {""}
    is_served = bool(reader_ids and writer_ids) and (not announced_ids or not announced_ids.isdisjoint(writer_ids))
    if refusal is None:
        return ServerAvailability(is_served or bool(fast_dds), depth), bool(fast_dds)
    is_unusable = not is_served and bool(announced) and all(uses_sample_identity(end.guid) for end in announced)
    incompatible = IncompatiblePeer(next(iter(announced)).guid, refusal) if is_unusable else None
    return ServerAvailability(is_served, depth, incompatible), False


class ClientCorrelation:
    """Encoder of one client's requests, which also recognizes the client's replies.

    Args:
        handle: number that no other client has (docs/internals/protocol.md 5.1).
        reader: GUID of the client's reply reader.
        writer: GUID of the client's request writer.
        server_uses_identity: returns True for the GUID of a server that uses sample identities.
    """

    def __init__(self, handle: int, reader: bytes, writer: bytes, server_uses_identity: UsesSampleIdentity) -> None:
        self._server_uses_identity = server_uses_identity
        self._handle = handle
        self._reader = reader
        self._own_ids: tuple[ClientId, ...] = (handle, reader, writer)
        """Identifiers with which a reply may refer to this client."""
        self.uses_sample_identity = False
        """True while a matched server is on Fast DDS, so that requests need a sample identity."""
        self._request_readers: set[bytes] = set()
        self._servers: frozenset[bytes] = frozenset()
        self._answered: set[bytes] = set()

    def update_servers(self, readers: set[bytes], *, uses_sample_identity: bool) -> None:
        """Set `readers`, the GUIDs of the request readers of all servers, even if they are not matched yet."""
        self.uses_sample_identity = uses_sample_identity
        if not readers <= self._request_readers:
            # A new server, which may be a restarted one, does not know the client's reply reader.
            self._answered.clear()
        self._request_readers = readers
        # The participant identifies a server: its reader and its writer have it in common.
        self._servers = frozenset(guid[:GUID_PREFIX_BYTES] for guid in readers)
        self._answered &= self._servers

    def all_answered(self) -> bool:
        """Return True if every server has replied once.

        If a participant has several servers of the service, their replies cannot be distinguished: the result is False.
        """
        readers, servers = self._request_readers, self._servers
        return bool(readers) and self._answered == servers and len(servers) == len(readers)

    def request(
        self, message: bytes, number: int, *, always_identified: bool = False
    ) -> tuple[bytes, SampleIdentity | None]:
        """Return the payload of a request, and the sample identity to send as inline QoS.

        The identity is None if no Fast DDS server is matched, or if servers need none and `always_identified` is False.
        """
        if not self.uses_sample_identity:
            return add_request_header(message, self._handle, number), None
        # Without an identity a Fast DDS server identifies the request by the writer and the sequence number, so
        # `number` counts the samples of the writer from 1 (docs/internals/dds.md 3). An identity costs time, and only a
        # server that does not know the client's reply reader needs it: it is omitted after all servers have replied.
        is_needed = always_identified or not self.all_answered()
        return message, (self._reader, number) if is_needed else None

    def reply(self, data: Payload, server: bytes | None) -> tuple[int, bytes] | None:
        """Return the number of the request and the message of a reply; None if the reply is for another client.

        Args:
            server: GUID of the server's reply writer, if known.

        Raises:
            DecodeError: the data is too short for a header.
        """
        client, number, begin = parse_request_header(data)
        if client not in self._own_ids:  # all clients of a service receive all replies
            return None
        if server is not None and self._server_uses_identity(server):
            if not isinstance(client, bytes):
                return None
            self._answered.add(server[:GUID_PREFIX_BYTES])
        return number, strip_request_header(data, begin)


def is_reply_reader_matched(
    client: ClientId,
    writer: DiscoveredEndpoint | None,
    matched: Callable[[], Iterable[bytes]],
    find: Callable[[bytes], DiscoveredEndpoint | None],
) -> bool:
    """Return True if the reply reader of a client is matched with a server, or if the reply reader is unknown.

    Args:
        client: id of the client in its request.
        writer: request writer of the client; None if unknown or gone.
        matched: returns the GUIDs of the reply readers that are matched with the server's reply writer.
        find: returns a discovered endpoint by GUID.

    Source: docs/internals/protocol.md 5.2, 5.3.
    """
    if isinstance(client, bytes):
        # The GUID of the request writer or of the client does not tell the reader.
        return not client[15] & _READER_BIT or client in matched()
    if writer is None or not writer.service_id:
        return True
    readers = map(find, matched())
    return any(reader is not None and reader.service_id == writer.service_id for reader in readers)
