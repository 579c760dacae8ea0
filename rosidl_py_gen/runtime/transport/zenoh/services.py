"""Clients and servers of services on Zenoh: a request is a query of Zenoh, its response a reply to the query.

A request is not sent before a server is reachable, so that it cannot be lost. A query that ends without a response,
because its servers died, is reported to the client. A server retains unanswered queries until their client disappears
or too many others follow. A query has the timeout of its call, because Zenoh retains 1 kB of each until the timeout,
answered or not; a client cancels a query that it abandons.

Keys contain the hash of the service, so clients and servers with different definitions exchange nothing.

Source: docs/internals/zenoh.md 2.4 and 6.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import zenoh

from rosidl_py_gen.cdr.layout import Header
from rosidl_py_gen.errors import ClosedError, printable
from rosidl_py_gen.runtime.transport.api import NoReply, ServerAvailability, TransportError
from rosidl_py_gen.runtime.transport.endpoint_index import MatchCache, fair_queue_share
from rosidl_py_gen.runtime.transport.flow_control import ReplyWindow
from rosidl_py_gen.runtime.transport.zenoh.endpoints import ZenohReader, leak_after_fork, zenoh_handler
from rosidl_py_gen.runtime.transport.zenoh.wire_formats import Infos, pack_attachment, paired_gid, participant_guid

if TYPE_CHECKING:
    from collections.abc import Collection

    from rosidl_py_gen.runtime.transport.zenoh.participant import ZenohParticipant

_NO_TIMEOUT_S = 1e9
"""Timeout in seconds of a query without a timeout, because Zenoh refuses infinity."""
_GET_RESULT = "/_action/get_result/"
"""Text in the keys of get_result requests, which have no timeout, as in rmw_zenoh_cpp. Other requests have
`queries_default_timeout`."""
_QUERY_TIMEOUT_MARGIN_S = 1.0
"""Time in seconds by which a query's timeout is longer than the timeout of its call, because the call has the better
error text."""
_TIMEOUT_ERROR = b"Timeout"
MAX_QUERIES = 10_000
"""Maximum number of unanswered requests that a server retains; beyond that, the oldest are discarded."""
MAX_BYTES = 64 * 2**20
"""Maximum size in bytes of all unanswered requests that a server retains."""
MAX_ANSWERED_QUERIES = 16
"""Maximum number of answered queries that a client leaves to end without cancelling them, which costs less."""
_MAX_ERROR_CHARS = 300
_time_ns = time.time_ns


class _ZenohServiceEndpoint(ZenohReader):
    """Base of the clients and servers on Zenoh, which are a reader and a writer in the graph (`infos`)."""

    def __init__(self, owner: ZenohParticipant, infos: Infos, key: str) -> None:
        reader, writer = infos
        self.matches_by_hash = not owner.is_humble
        self.gid = reader.guid
        self.is_introspected = False
        self.endpoints = reader.guid, writer.guid
        self._writer_info = writer
        super().__init__(owner, infos, key)

    def take(self) -> Any:
        items = self.queue.items
        if not items:
            return None
        try:
            return items.popleft()
        except IndexError:  # another thread was faster
            return None

    def connected(self) -> list[bytes]:
        return list(self._owner.graph.connected(self.info))

    def all_acknowledged(self) -> bool:
        return True


class ZenohClient(_ZenohServiceEndpoint):
    """Client of a service on Zenoh."""

    def __init__(self, owner: ZenohParticipant, infos: Infos, key: str) -> None:
        self._sent = 0
        self.in_flight: dict[int, _InFlightQuery] = {}
        """Queries without an end, by the number of the request."""
        self._answered: deque[int] = deque()
        """Queries that one server has answered and that further servers may still answer."""
        self._servers_version = -1
        """Version of `_is_reachable` for which the cached data about servers in the following attributes was computed.
        """
        self._servers = ServerAvailability()
        self._server_endpoints: frozenset[bytes] = frozenset()
        self._writer_by_session: dict[bytes, bytes] = {}
        self._default_timeout_s = _NO_TIMEOUT_S if _GET_RESULT in key else None
        super().__init__(owner, infos, key)
        topic_keys = (info.topic_key for info in infos)
        self._is_reachable: MatchCache[bool] = MatchCache(owner.graph, topic_keys, self._has_reachable_server)
        """Cache with one entry, for the key None: True if a server is reachable. A check in Zenoh takes 40 us."""

    def _declare(self, key: str) -> Any:
        self._querier: Any = self._owner.session.declare_querier(
            key, target=zenoh.QueryTarget.ALL_COMPLETE, consolidation=zenoh.ConsolidationMode.NONE
        )
        return self._querier

    def _has_reachable_server(self, _: object) -> bool:
        return bool(self._querier.matching_status.matching)

    def send(self, data: bytes, timeout_s: float | None = None) -> int | None:
        if self._closed:
            raise ClosedError(f"the client of {self.info.topic_key.name} is closed")
        # Not by a listener: Zenoh calls it in the thread that undeclaring an advanced publisher waits for, up to ten
        # seconds with the GIL.
        if not self._is_reachable[None]:
            return None
        number = self._sent + 1
        query = self.in_flight[number] = _InFlightQuery(self, number)
        query_timeout_s = self._default_timeout_s
        if timeout_s is not None:
            query_timeout_s = min(timeout_s + _QUERY_TIMEOUT_MARGIN_S, _NO_TIMEOUT_S)
        callback, attachment = (
            zenoh_handler(query.on_reply, query.on_end),
            pack_attachment(number, _time_ns(), self.guid),
        )
        try:
            self._owner.session.get(
                self._key,
                callback,
                target=zenoh.QueryTarget.ALL_COMPLETE,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=query_timeout_s,
                payload=data,
                attachment=attachment,
                cancellation_token=query.token,
            )
        except BaseException as error:
            self._sent = number
            self._cancel(number)
            if isinstance(error, zenoh.ZError):
                subject = f"Zenoh could not send a request of {len(data)} bytes on {self.info.topic_key.name}"
                raise TransportError(f"{subject}: {error}") from None
            raise
        self._sent = number
        return number

    def cancel(self, number: int) -> None:
        query = self.in_flight.get(number)
        if query is None:
            return
        if query.is_over:
            self._answered.append(number)
            if len(self._answered) <= MAX_ANSWERED_QUERIES:
                return
            number = self._answered.popleft()
        self._cancel(number)

    def _cancel(self, number: int) -> None:
        # cancel() waits for running Zenoh callbacks, so hold no lock here.
        query = self.in_flight.pop(number, None)
        if query is not None:
            query.cancel()

    def on_query_end(self, number: int) -> None:
        """Forget a query that has ended. Called by Zenoh; must not block or log."""
        self.in_flight.pop(number, None)

    def servers(self) -> ServerAvailability:
        self._refresh_servers()
        return self._servers

    def server_endpoints(self) -> frozenset[bytes]:
        self._refresh_servers()
        return self._server_endpoints

    def report_lost_requests(self) -> None:
        """Do nothing: a query ends when no server is left, and the tokens of lost servers may overtake their last
        replies.
        """

    def _refresh_servers(self) -> None:
        graph = self._owner.graph
        graph.read()
        version = self._is_reachable.version
        if version == self._servers_version:
            return
        readers, writers = graph.connected(self._writer_info), graph.connected(self.info)
        writer_by_session = {writer.participant_guid: writer.guid for writer in writers.values()}
        is_available = any(reader.participant_guid in writer_by_session for reader in readers.values())
        clients = graph.endpoints_on_same_side(self._writer_info).values()
        depth = fair_queue_share((reader.qos for reader in readers.values()), clients)
        self._servers = ServerAvailability(is_available, depth)
        self._server_endpoints = frozenset((*readers, *writers))
        self._writer_by_session, self._servers_version = writer_by_session, version

    def replying_server(self, reply: Any) -> bytes | None:
        """Return the GUID of the writer of a reply; None if unknown. Called by Zenoh."""
        if reply.replier_id is None:
            return None
        session = participant_guid(str(reply.replier_id.zid))
        if session not in self._writer_by_session:
            self._refresh_servers()
        return self._writer_by_session.get(session)

    def close(self) -> None:
        for number in list(self.in_flight):  # undeclaring would end them while Zenoh's session is locked
            self._cancel(number)
        self._is_reachable.close()
        super().close()

    def detach_after_fork(self) -> None:
        super().detach_after_fork()
        leak_after_fork(self.in_flight)
        self.in_flight = {}


class _InFlightQuery:
    """Query of a client that has not ended yet. Zenoh calls `on_reply` and `on_end`, which must not block or log."""

    __slots__ = ("_client", "_number", "_reason", "is_over", "token")

    def __init__(self, client: ZenohClient, number: int) -> None:
        self._client = client
        self._number = number
        self.is_over = False
        self._reason: tuple[str, ...] = ()
        self.token = zenoh.CancellationToken()

    def on_reply(self, reply: Any) -> None:
        """Receive a reply, or the reason why there is none."""
        sample = reply.ok
        if sample is None:
            error = reply.err.payload.to_bytes()
            is_late = error == _TIMEOUT_ERROR
            text = printable(error.decode(errors="replace"), _MAX_ERROR_CHARS)
            self._reason = ("did not answer in time" if is_late else f"answered with an error: {text}",)
            return
        data = sample.payload.to_bytes()
        if self._client.read_attachment(sample) is not None and len(data) >= Header.SIZE:
            self.is_over = True
            self._client.receive((self._number, data, self._client.replying_server(reply)))

    def on_end(self) -> None:
        """Report a query that has ended without a reply."""
        self._client.on_query_end(self._number)
        if not self.is_over:
            self._client.receive((self._number, NoReply(*self._reason), None))

    def cancel(self) -> None:
        """End the query in Zenoh. Waits while Zenoh calls a function of the query."""
        self.is_over = True
        self.token.cancel()


_RequestOrigin: TypeAlias = "tuple[bytes, int]"
"""Contents of a `RequestId` on Zenoh: GID of the client, number of its request."""


class _UnansweredQuery(NamedTuple):
    query: Any
    size_bytes: int


class ZenohServer(_ZenohServiceEndpoint):
    """Server of a service on Zenoh; it retains unanswered queries."""

    def __init__(self, owner: ZenohParticipant, infos: Infos, key: str) -> None:
        self.queries: dict[_RequestOrigin, _UnansweredQuery] = {}
        """Unanswered queries by the origin of the request."""
        self._queries_bytes = 0
        self._queries_lock = threading.RLock()
        self._window = ReplyWindow(None)
        self._window_version = -1
        super().__init__(owner, infos, key)

    def take(self) -> Any:
        request = super().take()
        if request is not None and self._is_limited():
            self._window.on_request(request[0][0])
        return request

    def _is_limited(self) -> bool:
        version = self._owner.graph.version
        if version != self._window_version:
            self._window_version = version
            readers = self._owner.graph.connected(self._writer_info)
            self._window.set_readers(reader.qos for reader in readers.values())
        return self._window.limit > 0

    def _declare(self, key: str) -> Any:
        return self._owner.session.declare_queryable(key, zenoh_handler(self._take), complete=True)

    def _take(self, query: Any) -> None:
        attachment = self.read_attachment(query)
        data = b"" if query.payload is None else query.payload.to_bytes()
        if attachment is None or len(data) < Header.SIZE:
            query.drop()
            return
        number, source_ns, gid = attachment
        if not self._store_query((gid, number), _UnansweredQuery(query, len(data))):
            query.drop()
            return
        self.receive(((gid, number), data, paired_gid(gid), source_ns, _time_ns()))

    def _store_query(self, origin: _RequestOrigin, query: _UnansweredQuery) -> bool:
        """Store a query and discard the oldest if there are too many; return False for a repeated request."""
        discarded = []
        with self._queries_lock:
            if self._closed or origin in self.queries:
                return False
            self.queries[origin] = query
            self._queries_bytes += query.size_bytes
            while len(self.queries) > 1 and (len(self.queries) > MAX_QUERIES or self._queries_bytes > MAX_BYTES):
                discarded.append(self.pop_query(next(iter(self.queries))))
        for old in filter(None, discarded):
            old.query.drop()
        return True

    def pop_query(self, origin: _RequestOrigin) -> _UnansweredQuery | None:
        """Remove and return the query to be answered; None if it was discarded."""
        with self._queries_lock:
            entry = self.queries.pop(origin, None)
            if entry is not None:
                self._queries_bytes -= entry.size_bytes
            return entry

    def send(self, to: _RequestOrigin, data: bytes) -> bool:
        if self._closed:
            raise ClosedError(f"the server of {self.info.topic_key.name} is closed")
        gid, number = to
        is_limited = self._is_limited()
        if is_limited and not self._window.is_open(gid):
            return False
        entry = self.pop_query(to)
        if entry is None:  # discarded, or answered before
            return True
        if is_limited:
            self._window.on_sent(gid)
        query = entry.query
        try:
            query.reply(self._key, data, attachment=pack_attachment(number, _time_ns(), gid))
        except zenoh.ZError as error:
            subject = f"Zenoh could not send a response of {len(data)} bytes on {self.info.topic_key.name}"
            raise TransportError(f"{subject}: {error}") from None
        finally:
            query.drop()
        return True

    def release(self) -> None:
        self._window.release()

    def can_reach_client(self, to: _RequestOrigin) -> bool:
        return True  # a response takes the path of its query

    def request_origin(self, to: _RequestOrigin) -> tuple[bytes, int]:
        return to

    def drop_requests(self, clients: Collection[bytes] | None = None) -> None:
        """Discard the requests of clients that have disappeared, given by their GIDs, or of all clients."""
        with self._queries_lock:
            origins = [origin for origin in self.queries if clients is None or origin[0] in clients]
        for entry in filter(None, map(self.pop_query, origins)):
            entry.query.drop()

    def close(self) -> None:
        super().close()
        self.drop_requests()

    def detach_after_fork(self) -> None:
        super().detach_after_fork()
        leak_after_fork(self.queries)
        self.queries, self._queries_lock = {}, threading.RLock()
