"""Clients and servers: a request is a query of Zenoh, its response a reply to it.

Decides that a request waits until a server is within reach, so that it is never lost for being early; that a query
which ends without a response, because its servers died, is told to the client as such; and how long queries are kept
that nobody answers: until their client is gone, or many others came behind.

Source: zenoh.md 6.
"""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

import zenoh

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.interface import TransportError, identified, unanswered
from rosidl_py_gen.runtime.transport.zenoh.attachment import pack
from rosidl_py_gen.runtime.transport.zenoh.endpoints import ZenohReader, handler, read_attachment
from rosidl_py_gen.runtime.transport.zenoh.graph import twin

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.interface import EndpointFound, Identity, Payload
    from rosidl_py_gen.runtime.transport.zenoh.endpoints import Host

_QUERY_TIMEOUT_S = 600.0
_ENDLESS_S = 1e9
"""For results of actions, which rmw_zenoh_cpp waits for without end, too; Zenoh refuses infinity."""
_MOST_QUERIES = 10_000
_time_ns = time.time_ns


class _Half:
    """A writer whose other half has the Zenoh entity; see `transport.Writer`."""

    def __init__(self, owner: Host, info: EndpointFound) -> None:
        self._owner = owner
        self.info = info
        self.guid = info.guid
        self.handle = int.from_bytes(info.guid, "little")
        self._closed = False

    def matched_readers(self) -> list[bytes]:
        return list(self._owner.graph.connected(self.info))

    def has_readers(self) -> bool:
        return bool(self._owner.graph.connected(self.info))

    def reaches(self, client: bytes) -> bool:
        """A reply goes where its query came from."""
        return True

    def all_acknowledged(self) -> bool:
        """See `ZenohWriter`."""
        return True

    def assert_liveliness(self) -> None:
        """Nobody looks for it."""

    def close(self) -> None:
        self._closed = True


# -------------------------------------------------------------------------------------------------------------- client


class ReplyReader(ZenohReader):
    """The half of a client that has its queries answered."""

    def _declare(self, key: str) -> Any:
        return self._owner.session.declare_querier(
            key,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_ENDLESS_S if "/_action/get_result/" in key else _QUERY_TIMEOUT_S,
        )

    def ask(self, data: bytes, number: int) -> bool:
        """Send a request; False while no server is within reach."""
        querier = self._subscriber
        if not querier.matching_status.matching:
            return False
        asked = _Asked(self, number)
        querier.get(handler(asked.on_reply, asked.on_end), payload=data, attachment=pack(number, _time_ns(), self.guid))
        return True

    def server_of(self, reply: Any) -> int:
        """The handle of the server that answered, 0 when it is not known."""
        zid = None if reply.replier_id is None else str(reply.replier_id.zid)
        found = (guid for guid, owner in self._owner.graph.connected(self.info).items() if owner == zid)
        return int.from_bytes(next(found, b""), "little")


class _Asked:
    """A query under way."""

    __slots__ = ("_client", "_is_answered", "_number")

    def __init__(self, client: ReplyReader, number: int) -> None:
        self._client = client
        self._number = number
        self._is_answered = False

    def on_reply(self, reply: Any) -> None:
        """Called by Zenoh with each reply; an error is none."""
        sample = reply.ok
        told = None if sample is None else read_attachment(sample)
        data = b"" if sample is None else sample.payload.to_bytes()
        if told is not None and data:
            self._is_answered = True
            answer = identified(data, (self._client.guid, self._number))
            self._client.receive((answer, told[1], self._client.server_of(reply), _time_ns()))

    def on_end(self) -> None:
        """Called by Zenoh when nothing more will come."""
        if not self._is_answered:
            now = _time_ns()
            self._client.receive((unanswered((self._client.guid, self._number)), now, 0, now))


class RequestWriter(_Half):
    """The half of a client that sends requests."""

    def __init__(self, owner: Host, info: EndpointFound, reader: ReplyReader) -> None:
        super().__init__(owner, info)
        self._reader = reader

    def write(self, data: Payload, identity: Identity | None = None) -> bool:
        """See `transport.Writer`; False while no server is within reach."""
        if self._closed:
            raise ClosedError(f"the writer of {self.info.topic} is closed")
        if identity is None:
            raise TransportError(f"a request on {self.info.topic} needs an identity")
        try:
            return self._reader.ask(bytes(data), identity[1])
        except zenoh.ZError as error:
            raise TransportError(f"send a request of {len(data)} bytes on {self.info.topic}: {error}") from None


# -------------------------------------------------------------------------------------------------------------- server


class RequestReader(ZenohReader):
    """The half of a server that gets queries, and keeps those that are not answered yet."""

    def __init__(self, owner: Host, info: EndpointFound, key: str) -> None:
        self._queries: dict[Identity, Any] = {}
        self._queries_lock = threading.RLock()
        super().__init__(owner, info, key)

    def _declare(self, key: str) -> Any:
        return self._owner.session.declare_queryable(key, handler(self._take), complete=True)

    def _take(self, query: Any) -> None:
        """Called by Zenoh with each query."""
        told = read_attachment(query)
        data = b"" if query.payload is None else query.payload.to_bytes()
        if told is None or not data:
            query.drop()
            return
        number, stamp_ns, gid = told
        with self._queries_lock:
            is_new = self._queries.setdefault((gid, number), query) is query
            oldest = next(iter(self._queries)) if len(self._queries) > _MOST_QUERIES else None
        if not is_new:
            query.drop()
            return
        if oldest is not None:
            self._drop([oldest])
        self.receive((identified(data, (gid, number)), stamp_ns, int.from_bytes(twin(gid), "little"), _time_ns()))

    def claim(self, identity: Identity) -> Any | None:
        """The query to be answered; None when it is gone."""
        with self._queries_lock:
            return self._queries.pop(identity, None)

    def forget(self, client: bytes) -> None:
        """That client is gone."""
        with self._queries_lock:
            of_client = [identity for identity in self._queries if identity[0] == client]
        self._drop(of_client)

    def _drop(self, identities: list[Identity]) -> None:
        for query in filter(None, map(self.claim, identities)):
            query.drop()

    def close(self) -> None:
        super().close()
        with self._queries_lock:
            left = list(self._queries)
        self._drop(left)


class ReplyWriter(_Half):
    """The half of a server that answers."""

    def __init__(self, owner: Host, info: EndpointFound, reader: RequestReader, key: str) -> None:
        super().__init__(owner, info)
        self._reader = reader
        self._key = key

    def write(self, data: Payload, identity: Identity | None = None) -> bool:
        """See `transport.Writer`; what answers nothing that is still asked is dropped."""
        if self._closed:
            raise ClosedError(f"the writer of {self.info.topic} is closed")
        query = None if identity is None else self._reader.claim(identity)
        if query is None or identity is None:
            return True
        gid, number = identity
        try:
            query.reply(self._key, bytes(data), attachment=pack(number, _time_ns(), gid))
        except zenoh.ZError as error:
            raise TransportError(f"send a response of {len(data)} bytes on {self.info.topic}: {error}") from None
        finally:
            query.drop()
        return True
