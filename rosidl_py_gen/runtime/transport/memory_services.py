"""Clients and servers of the memory transport: a request says which client it is of, and its response goes there.

Who is there, and who is lost, is found out as on DDS, from what discovery reports.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from rosidl_py_gen.runtime.transport.service_api import ServerAvailability
from rosidl_py_gen.runtime.transport.service_endpoints import EndpointPairClient, EndpointPairServer, fair_queue_share

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.memory import MemoryReader, MemoryWriter
    from rosidl_py_gen.runtime.transport.service_api import Reply, Request, RequestId, ServiceSpec
    from rosidl_py_gen.runtime.transport.service_endpoints import ServicePeers


class MemoryClient(EndpointPairClient):
    """See `service_port.ServiceClientTransport`."""

    def __init__(
        self, service: ServiceSpec, peers: ServicePeers, reader: MemoryReader, writer: MemoryWriter, gid: bytes
    ) -> None:
        super().__init__(peers, *service.channels, reader, writer, gid)
        self._counts = service.is_compatible
        self._outbox = writer
        self.inbox = reader
        self._sent = 0

    def send(self, data: bytes, timeout_s: float | None = None) -> int | None:
        self._outbox.deliver((self, self._sent + 1, data))
        self._sent += 1
        self._asked[self._sent] = self.server_endpoints()
        return self._sent

    def take(self) -> Reply | None:
        items: Any = self._reader.queue.items
        if not items:
            return self._next_lost()
        (number, data), _, handle, _, _ = items.popleft()
        return number, data, self._reader.writer_guid(handle)

    def _find(self, _: object) -> ServerAvailability:
        reading = self._peers.known(self._writer.matched_readers())
        answering = self._peers.known(self._reader.matched_writers())
        ids = [{one.service_id for one in ends if self._counts(one)} for ends in (reading, answering)]
        clients = self._peers.on(self._requests, writers=True)
        return ServerAvailability(
            not ids[0].isdisjoint(ids[1]), fair_queue_share((one.qos for one in reading), clients)
        )


_RequestOrigin: TypeAlias = "tuple[MemoryClient, int]"


class MemoryServer(EndpointPairServer):
    """See `service_port.ServiceServerTransport`."""

    def take(self) -> Request | None:
        items: Any = self._reader.queue.items
        if not items:
            return None
        (client, number, data), source_ns, handle, received_ns, _ = items.popleft()
        return (client, number), data, self._reader.writer_guid(handle), source_ns, received_ns

    def send(self, to: RequestId, data: bytes) -> bool:
        asker: _RequestOrigin = to
        client, number = asker
        if self._is_connected(client):
            client.inbox.enqueue((number, data), self._writer)
        return True

    def can_reach_client(self, to: RequestId) -> bool:
        asker: _RequestOrigin = to
        return asker[0].inbox.closed or self._is_connected(asker[0])

    def _is_connected(self, client: MemoryClient) -> bool:
        return client.inbox.guid in self._writer.matched_readers()

    def request_origin(self, to: RequestId) -> tuple[bytes, int]:
        asker: _RequestOrigin = to
        return asker[0].gid, asker[1]
