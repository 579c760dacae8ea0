"""Clients and servers on DDS: each has a reader and a writer, and `correlation.py` says whose a message is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.logs.loggers import internal_logger
from rosidl_py_gen.runtime.transport.dds.correlation import (
    ClientCorrelation,
    client_gid,
    find_servers,
    has_identities,
    header_of,
    identity_of,
    listens,
    message_of,
    with_header,
)
from rosidl_py_gen.runtime.transport.match_cache import MatchCache
from rosidl_py_gen.runtime.transport.port import Writer
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.runtime.transport.reply_window import ReplyWindow
from rosidl_py_gen.runtime.transport.service_ends import ClientEnd, ServerEnd, ServicePeers
from rosidl_py_gen.runtime.transport.service_port import Refused, Servers

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds.services import FastDds
    from rosidl_py_gen.runtime.transport.dds.correlation import ClientId, Identity
    from rosidl_py_gen.runtime.transport.port import Reader
    from rosidl_py_gen.runtime.transport.samples import Payload
    from rosidl_py_gen.runtime.transport.service_port import Reply, Request, RequestId, Service

_Asker: TypeAlias = "tuple[ClientId, int, bytes | None, int]"
"""What a `RequestId` is: the client, the number of its request, the GUID of its request writer (None when it vanished
before it was known) and the local handle of that writer."""


class ServiceWriter(Writer, Protocol):
    """A writer that can say whose a sample is beside it."""

    def write_for(self, data: Payload, identity: Identity) -> bool:
        """As `write`."""


class DdsClient(ClientEnd):
    """See `service_port.ClientPort`.

    Args:
        fast_dds: states whether servers on Fast DDS can be talked to.
    """

    def __init__(
        self,
        service: Service,
        peers: ServicePeers,
        reader: Reader,
        writer: ServiceWriter,
        gid: bytes,
        fast_dds: FastDds,
    ) -> None:
        super().__init__(peers, *service.channels, reader, writer, gid)
        self._service = service
        self._request_writer = writer
        self._fast_dds = fast_dds
        self._refusal: str | None = None
        """The refusal of Fast DDS that `servers` was found with."""
        self._found_at = -1
        """The version of the peers that requests are sent by; -1 to find the servers again with each request."""
        self._correlation = ClientCorrelation(writer.handle, reader.guid, writer.guid)
        self._sent = 0

    def send(self, data: bytes, timeout_s: float | None = None) -> int | None:
        if self._found_at != self._peers.version:
            self.servers()
        number, writer = self._sent + 1, self._request_writer
        message, identity = self._correlation.request(data, number)
        try:
            is_sent = writer.write(message) if identity is None else writer.write_for(message, identity)
        except Exception:
            raise
        except BaseException:  # it was written; what interrupted us came behind
            self._sent = number
            raise
        if not is_sent:
            return None
        self._sent = number
        self._asked[number] = self.present()
        return number

    def take(self) -> Reply | None:
        items = self._reader.queue.items
        while items:
            data, _, handle, _, _ = items.popleft()
            server = self._reader.writer_guid(handle)
            try:
                found = self._correlation.reply(data, server)
            except DecodeError as err:
                internal_logger().warning(f"dropped a reply on {self._service.name}: {err}", throttle_s=1.0)
                continue
            if found is not None:
                return *found, server
        return self._next_lost()

    def servers(self) -> Servers:
        refusal = self._fast_dds.refusal
        if refusal != self._refusal:
            self._refusal = refusal
            self._servers.clear()
        return self._servers.get()

    def _find(self, _: object) -> Servers:
        peers, refusal = self._peers, self._refusal
        version = peers.version
        matched, answering = self._writer.matched_readers(), self._reader.matched_writers()
        announced, clients = (peers.on(self._requests, writers=writers) for writers in (False, True))
        known = peers.known(matched), peers.known(answering)
        found = find_servers(*known, announced, clients, refusal, self._service.counts)
        readers = {*matched, *(one.guid for one in announced)}
        self._correlation.settle(readers, is_identified=found.is_identified)
        self._found_at = version if found.is_available else -1
        refused = None if found.refused is None else Refused(found.refused.guid, refusal or "")
        return Servers(found.is_available, found.keeps, refused)


class DdsServer(ServerEnd):
    """See `service_port.ServerPort`."""

    def __init__(
        self,
        service: Service,
        peers: ServicePeers,
        reader: Reader,
        writer: ServiceWriter,
        gid: bytes,
        fast_dds: FastDds,
    ) -> None:
        super().__init__(reader, writer, gid)
        self._peers = peers
        self._reply_writer = writer
        self._fast_dds = fast_dds
        self._listening: MatchCache[bool] = MatchCache(peers, self._listens)
        """By client, and the GUID of its request writer."""
        self._window = ReplyWindow(writer.all_acknowledged)
        self._replies = service.channels[1]
        self._limited_at = -1

    def take(self) -> Request | None:
        items = self._reader.queue.items
        if not items:
            return None
        data, source_ns, handle, received_ns, _ = items.popleft()
        writer = self._reader.writer_guid(handle)
        if writer is not None and has_identities(writer) and identity_of(data) is None:
            return None, Refused(writer, self._fast_dds.refusal or ""), writer, source_ns, received_ns
        try:
            client, number, begin = header_of(data)
        except DecodeError as err:
            return None, err, writer, source_ns, received_ns
        if self._is_limited():
            self._window.on_request(client)
        return (client, number, writer, handle), message_of(data, begin), writer, source_ns, received_ns

    def send(self, to: RequestId, data: bytes) -> bool:
        asker: _Asker = to
        client, number, _, _ = asker
        if not self._is_limited():
            return self._write(data, client, number)
        is_sent = self._window.is_open(client) and self._write(data, client, number)
        if is_sent:
            self._window.on_sent(client)
        return is_sent

    def _is_limited(self) -> bool:
        peers = self._peers
        if peers.version != self._limited_at:
            self._limited_at = peers.version
            readers = peers.on(self._replies, writers=False)
            # Clients on Fast DDS do not announce their history: they are taken for what ROS has by default.
            self._window.set_readers(SERVICES_DEFAULT if has_identities(one.guid) else one.qos for one in readers)
        return self._window.limit > 0

    def _write(self, data: bytes, client: ClientId, number: int) -> bool:
        if isinstance(client, bytes):
            return self._reply_writer.write_for(data, (client, number))
        return self._reply_writer.write(with_header(data, client, number))

    def release(self) -> None:
        self._window.release()

    def hears(self, to: RequestId) -> bool:
        asker: _Asker = to
        client, _, guid, _ = asker
        return self._listening.get((client, guid))

    def _listens(self, key: Any) -> bool:
        client, guid = key
        writer = None if guid is None else self._peers.get(guid)
        return listens(client, writer, self._writer.matched_readers, self._peers.get)

    def asked_by(self, to: RequestId) -> tuple[bytes, int]:
        asker: _Asker = to
        client, number, _, handle = asker
        return client_gid(client, handle), number
