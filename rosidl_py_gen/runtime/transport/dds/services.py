"""Clients and servers on DDS, without calls of the DDS library; `correlation.py` identifies requests and replies."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.logs.loggers import internal_logger
from rosidl_py_gen.runtime.transport.api import (
    Payload,
    Reader,
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
    uses_sample_identity,
)
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.runtime.transport.reply_window import ReplyWindow
from rosidl_py_gen.runtime.transport.service_api import (
    IncompatiblePeer,
    Reply,
    Request,
    ServerAvailability,
    ServiceSpec,
)
from rosidl_py_gen.runtime.transport.service_endpoints import (
    EndpointPairClient,
    EndpointPairServer,
    MatchCache,
)

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.cyclone.participant import CycloneParticipant

_RequestOrigin: TypeAlias = "tuple[ClientId, int, bytes | None, int]"
"""Contents of a `RequestId`: client, number of its request, GUID of its request writer (None if it disappeared before
it was known) and local handle of that writer."""


class ServiceWriter(Writer, Protocol):
    """Writer that can send a sample identity as inline QoS."""

    def write(self, data: Payload, identity: SampleIdentity | None = None) -> bool: ...


class DdsClient(EndpointPairClient):
    """Client of a service on DDS."""

    def __init__(
        self, participant: CycloneParticipant, service: ServiceSpec, reader: Reader, writer: ServiceWriter, gid: bytes
    ) -> None:
        super().__init__(service, participant.service_peers, reader, writer, gid)
        self._request_writer = writer
        self._fast_dds = participant.fast_dds
        self._find_refusal = partial(participant.service_refusal, service)
        self._refusal: str | None = None
        """Result of `_find_refusal` that the result of `servers` is based on."""
        self._servers_version = -1
        """Version of the peers whose servers `_correlation` has; -1 to find the servers with each request."""
        self._correlation = ClientCorrelation(writer.handle, reader.guid, writer.guid)
        self._sent = 0

    @property
    def gid(self) -> bytes:
        """Identification that events of the servers contain, too: Fast DDS has the GUID of the reply reader."""
        return self.endpoints[0] if self._correlation.uses_sample_identity else self._gid

    def send(self, data: bytes, timeout_s: float | None = None) -> int | None:
        if self._servers_version != self._peers.version:
            self.servers()
        number, writer = self._sent + 1, self._request_writer
        message, identity = self._correlation.request(data, number, always_identified=self.is_introspected)
        try:
            is_sent = writer.write(message, identity)
        except Exception:
            raise
        except BaseException:  # a signal handler raised after the sample was written
            self._sent = number
            raise
        if not is_sent:
            return None
        self._sent = number
        self._in_flight[number] = self.server_endpoints()
        return number

    def take(self) -> Reply | None:
        items = self._reader.queue.items
        while items:
            data, _, handle, _, _ = items.popleft()
            server = self._reader.writer_guid(handle)
            try:
                reply = self._correlation.reply(data, server)
            except DecodeError as err:
                internal_logger().warning(f"dropped a reply on {self._service.name}: {err}", throttle_s=1.0)
                continue
            if reply is not None:
                return *reply, server
        return self._next_lost()

    def servers(self) -> ServerAvailability:
        refusal = self._find_refusal()
        if refusal != self._refusal:
            self._refusal = refusal
            self._servers.clear()
        return self._servers.get()

    def _find(self, _: object) -> ServerAvailability:
        peers, refusal = self._peers, self._refusal
        version = peers.version
        matched, matched_writers = self._writer.matched_readers(), self._reader.matched_writers()
        announced, clients = (peers.on(self._requests, writers=writers) for writers in (False, True))
        pairs = peers.known(matched), peers.known(matched_writers)
        servers, needs_identity = find_servers(*pairs, announced, clients, refusal, self._service.is_compatible)
        readers = {*matched, *(reader.guid for reader in announced)}
        self._correlation.update_servers(readers, uses_sample_identity=needs_identity)
        self._servers_version = version if servers.is_available else -1
        unusable = servers.incompatible_server
        if unusable is not None and self._fast_dds.refusal is None:  # because of the rules of a secured domain
            servers = replace(servers, incompatible_server=unusable._replace(has_topics=False))
        return servers


class DdsServer(EndpointPairServer):
    """Server of a service on DDS."""

    def __init__(
        self, participant: CycloneParticipant, service: ServiceSpec, reader: Reader, writer: ServiceWriter, gid: bytes
    ) -> None:
        super().__init__(reader, writer, gid)
        self._peers = participant.service_peers
        self._reply_writer = writer
        self._fast_dds = participant.fast_dds
        self._reachable_clients: MatchCache[bool] = MatchCache(self._peers, self._is_reachable)
        """Results by client and the GUID of its request writer."""
        self._window = ReplyWindow(writer.all_acknowledged)
        self._replies = service.topic_keys[1]
        self._window_version = -1

    def take(self) -> Request | None:
        items = self._reader.queue.items
        if not items:
            return None
        data, source_ns, handle, received_ns, _ = items.popleft()
        writer = self._reader.writer_guid(handle)
        if writer is not None and uses_sample_identity(writer) and extract_identity(data) is None:
            return None, IncompatiblePeer(writer, self._fast_dds.refusal or ""), writer, source_ns, received_ns
        try:
            client, number, begin = parse_request_header(data)
        except DecodeError as err:
            return None, err, writer, source_ns, received_ns
        if self._is_limited():
            self._window.on_request(client)
        return (client, number, writer, handle), strip_request_header(data, begin), writer, source_ns, received_ns

    def send(self, to: _RequestOrigin, data: bytes) -> bool:
        client, number, _, _ = to
        if not self._is_limited():
            return self._write(data, client, number)
        is_sent = self._window.is_open(client) and self._write(data, client, number)
        if is_sent:
            self._window.on_sent(client)
        return is_sent

    def _is_limited(self) -> bool:
        peers = self._peers
        if peers.version != self._window_version:
            self._window_version = peers.version
            readers = peers.on(self._replies, writers=False)
            # Fast DDS does not announce the depth of its queue: the default of ROS is assumed.
            self._window.set_readers(
                SERVICES_DEFAULT if uses_sample_identity(reader.guid) else reader.qos for reader in readers
            )
        return self._window.limit > 0

    def _write(self, data: bytes, client: ClientId, number: int) -> bool:
        if isinstance(client, bytes):
            return self._reply_writer.write(data, (client, number))
        return self._reply_writer.write(add_request_header(data, client, number))

    def release(self) -> None:
        self._window.release()

    def can_reach_client(self, to: _RequestOrigin) -> bool:
        client, _, guid, _ = to
        return self._reachable_clients.get((client, guid))

    def _is_reachable(self, key: Any) -> bool:
        client, guid = key
        writer = None if guid is None else self._peers.get(guid)
        return is_reply_reader_matched(client, writer, self._writer.matched_readers, self._peers.get)

    def request_origin(self, to: _RequestOrigin) -> tuple[bytes, int]:
        client, number, _, handle = to
        return client_gid(client, handle), number
