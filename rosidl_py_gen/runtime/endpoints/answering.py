"""The servers of one client: which have answered, and so are connected with the reader of its replies; which are there.

Decides when all have answered: each since the last of them appeared, which may have been made anew. A server is gone
when the graph has neither what it reads nor what it writes any more: at once when it was closed, with the end of its
lease when it was killed. One is available when both of its endpoints are connected (protocol.md 5.2).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeVar

from rosidl_py_gen.runtime.endpoints.header import ForeignServiceError, foreign_reason
from rosidl_py_gen.runtime.endpoints.matching import Matching
from rosidl_py_gen.runtime.endpoints.service import ServiceEnd
from rosidl_py_gen.runtime.endpoints.window import kept_by
from rosidl_py_gen.runtime.loop.blocking import blocking

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import ServiceType
    from rosidl_py_gen.runtime.graph.definitions import TypeCheck
    from rosidl_py_gen.runtime.graph.state import Graph
    from rosidl_py_gen.runtime.transport.discovered import Channel
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")


class Answering:
    """The servers of one client. A server is known by its participant: what it reads and writes has that in common."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._readers: set[bytes] = set()
        self._servers: frozenset[bytes] = frozenset()
        self._heard: set[bytes] = set()

    def reach(self, readers: set[bytes]) -> None:
        """These are all that requests go to, or will a moment later."""
        if not readers <= self._readers:
            self._heard.clear()
        self._readers = readers
        self._servers = frozenset(map(self._participant, readers))
        self._heard &= self._servers

    def heard(self, writer: bytes) -> None:
        """A reply came from that writer."""
        self._heard.add(self._participant(writer))

    def all_have(self) -> bool:
        """Whether all have answered; never, when one participant has several, whose answers cannot be told apart."""
        return bool(self._readers) and self._heard == self._servers and len(self._servers) == len(self._readers)

    def _participant(self, guid: bytes) -> bytes:
        return self._graph.participant_of(guid) or guid


class Presence:
    """The endpoints of all servers of one service."""

    def __init__(self, graph: Graph, requests_on: Channel, replies_on: Channel) -> None:
        self._graph = graph
        self._requests_on = requests_on
        self._replies_on = replies_on
        self._version = -1
        self._guids: frozenset[bytes] = frozenset()

    def now(self) -> frozenset[bytes]:
        """Their GUIDs; the same object until the graph changes, so that any number of requests can keep it."""
        graph = self._graph
        if graph.version != self._version:
            self._version = graph.version
            readers = graph.on(self._requests_on, writers=False)
            writers = graph.on(self._replies_on, writers=True)
            self._guids = frozenset(one.guid for one in (*readers, *writers))
        return self._guids


class ServersOfClient(ServiceEnd[RequestT, ResponseT]):
    """The part of a client that knows its servers."""

    def __init__(
        self,
        scope: Scope,
        service_type: ServiceType[RequestT, ResponseT],
        name: str,
        qos: QoSProfile,
        *,
        type_check: TypeCheck | None = None,
    ) -> None:
        super().__init__(scope, service_type, name, qos, is_client=True, type_check=type_check)
        self._matching: Matching[None] = Matching(scope, lambda _: self._find_server())
        self._always_identified = scope.participant.identifies(self._writer.guid)
        self._identified = self._always_identified
        """Requests are numbered by the middleware, and sent with an identity until all servers have answered."""
        self._answering = Answering(scope.graph)
        self._presence = Presence(scope.graph, self._requests_on, self._replies_on)
        self._kept = 0
        """How many requests the server that keeps fewest keeps; 0 when all keep all."""

    def service_is_available(self) -> bool:
        """Whether a server is connected, both ways.

        Raises:
            ForeignServiceError: the only servers are on Fast DDS, and this machine's Cyclone DDS cannot talk to them.
            ClosedError: the client is closed.
        """
        self._scope.require_open(self._closed, f"the client of {self.name}")
        self._scope.discovery.refresh()
        return self._is_available()

    async def wait_for_service(self, timeout_s: float | None = None) -> Literal[True]:
        """Wait until a server with matching endpoints is connected.

        Raises:
            WaitTimeoutError: none was in time.
            ForeignServiceError: the only servers are on Fast DDS, and this machine's Cyclone DDS cannot talk to them.
        """
        return await self._scope.expect(self._is_available, timeout_s, lambda: self._closed, self._missing)

    wait_for_service_sync = blocking(wait_for_service)

    def _missing(self) -> str:
        told = self._check.others(self._requests_on, self._written_hash)
        return f"no server of {self.name} ({self.service_type}) appeared{told}"

    def servers(self) -> set[bytes]:
        """The reply writers of all servers; empty when none can be talked to."""
        try:
            return set(self._reader.matched_writers()) if self._is_available() else set()
        except ForeignServiceError:
            return set()

    def _is_available(self) -> bool:
        if self._identified and self._scope.participant.identity_refusal is not None:
            self._matching.forget()
        return self._matching.is_complete(None)

    def _find_server(self) -> bool:
        """Source: protocol.md 5.2; servers with identities have no ids, but both endpoints in one participant."""
        graph = self._scope.graph
        refusal, identifies = self._scope.participant.identity_refusal, self._scope.participant.identifies
        # Matched but not reported yet: what the server keeps is known a moment later. Other definitions do not count.
        agrees, sent, endpoints = self._check.agrees, self._written_hash, graph.endpoints
        readers = [one for guid in self._writer.matched_readers() if (one := endpoints.get(guid)) and agrees(one, sent)]
        writers = [one for guid in self._reader.matched_writers() if (one := endpoints.get(guid)) and agrees(one)]
        foreign = {one.participant_guid for one in readers if identifies(one.guid)}
        foreign &= {one.participant_guid for one in writers if identifies(one.guid)}
        readers = [one for one in readers if not identifies(one.guid)]
        ids = {one.service_id for one in readers} - {""}
        replying = {one.service_id for one in writers if not identifies(one.guid)}
        is_served = bool(readers and replying) and (not ids or not ids.isdisjoint(replying))
        if refusal is not None and not is_served:
            servers = graph.on(self._requests_on, writers=False)
            if servers and all(identifies(server.guid) for server in servers):
                raise ForeignServiceError(foreign_reason(graph, servers[0], self.name, "the server", refusal))
        is_identified = bool(foreign) and refusal is None
        self._identified = is_identified or self._always_identified
        matched = self._writer.matched_readers()
        self._answering.reach({*matched, *(one.guid for one in graph.on(self._requests_on, writers=False))})
        servers = [endpoints[guid] for guid in matched if guid in endpoints]
        self._kept = kept_by(self._scope.participant, servers, graph.on(self._requests_on, writers=True))
        return is_served or is_identified
