"""Clients and servers of the memory transport: a request contains its client, to which the response is delivered.

Servers, and requests that are lost, are found as on DDS, from discovery events.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from rosidl_py_gen.runtime.transport.service_api import ServerAvailability
from rosidl_py_gen.runtime.transport.service_endpoints import EndpointPairClient, EndpointPairServer, fair_queue_share

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.memory import MemoryReader, MemoryWriter
    from rosidl_py_gen.runtime.transport.service_api import Reply, Request, ServiceSpec
    from rosidl_py_gen.runtime.transport.service_endpoints import ServicePeers


class MemoryClient(EndpointPairClient):
    """Client of a `MemoryTransport`."""

    def __init__(
        self, service: ServiceSpec, peers: ServicePeers, reader: MemoryReader, writer: MemoryWriter, gid: bytes
    ) -> None:
        super().__init__(service, peers, reader, writer, gid)
        self._request_writer = writer
        self.inbox = reader
        self._sent = 0

    def send(self, data: bytes, timeout_s: float | None = None) -> int | None:
        self._request_writer.deliver((self, self._sent + 1, data))
        self._sent += 1
        self._in_flight[self._sent] = self.server_endpoints()
        return self._sent

    def take(self) -> Reply | None:
        items: Any = self._reader.queue.items
        if not items:
            return self._next_lost()
        (number, data), _, handle, _, _ = items.popleft()
        return number, data, self._reader.writer_guid(handle)

    def _find(self, _: object) -> ServerAvailability:
        readers = self._peers.known(self._writer.matched_readers())
        writers = self._peers.known(self._reader.matched_writers())
        reader_ids, writer_ids = (
            {endpoint.service_id for endpoint in endpoints if self._service.is_compatible(endpoint)}
            for endpoints in (readers, writers)
        )
        clients = self._peers.on(self._requests, writers=True)
        depth = fair_queue_share((reader.qos for reader in readers), clients)
        return ServerAvailability(not reader_ids.isdisjoint(writer_ids), depth)


_RequestOrigin: TypeAlias = "tuple[MemoryClient, int]"


class MemoryServer(EndpointPairServer):
    """Server of a `MemoryTransport`."""

    def take(self) -> Request | None:
        items: Any = self._reader.queue.items
        if not items:
            return None
        (client, number, data), source_ns, handle, received_ns, _ = items.popleft()
        return (client, number), data, self._reader.writer_guid(handle), source_ns, received_ns

    def send(self, to: _RequestOrigin, data: bytes) -> bool:
        client, number = to
        if self._is_connected(client):
            client.inbox.enqueue((number, data), self._writer)
        return True

    def can_reach_client(self, to: _RequestOrigin) -> bool:
        return to[0].inbox.closed or self._is_connected(to[0])

    def _is_connected(self, client: MemoryClient) -> bool:
        return client.inbox.guid in self._writer.matched_readers()

    def request_origin(self, to: _RequestOrigin) -> tuple[bytes, int]:
        return to[0].gid, to[1]
