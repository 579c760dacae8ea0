"""Clients and servers: a request is a query of Zenoh, its response a reply to it.

Decides that a request waits until a server is within reach, so that it is never lost for being early; that a query
which ends without a response, because its servers died, is told to the client as such; and how long queries are kept
that nobody answers: until their client is gone, or many others came behind. A query has the time that its
call has, as Zenoh keeps 1 kB of each until that has passed, answered or not; a client that gives one up cancels it.

Source: docs/internals/zenoh.md 6.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import zenoh

from rosidl_py_gen.cdr.layout import HEADER_BYTES
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.reply_window import ReplyWindow
from rosidl_py_gen.runtime.transport.service_api import NoReply, ServerAvailability
from rosidl_py_gen.runtime.transport.service_endpoints import fair_queue_share
from rosidl_py_gen.runtime.transport.zenoh.attachment import pack
from rosidl_py_gen.runtime.transport.zenoh.endpoints import ZenohReader, leak_after_fork, zenoh_handler
from rosidl_py_gen.runtime.transport.zenoh.token_graph import paired_gid, participant_guid

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint
    from rosidl_py_gen.runtime.transport.service_api import RequestId
    from rosidl_py_gen.runtime.transport.zenoh.participant import ZenohParticipant

_NO_TIMEOUT_S = 1e9
"""Zenoh refuses infinity."""
_GET_RESULT = "/_action/get_result/"
"""In the keys of requests that may take for ever, as rmw_zenoh_cpp has it. Others have `queries_default_timeout`."""
_QUERY_TIMEOUT_MARGIN_S = 1.0
"""So much longer than a call Zenoh waits: the call says it better."""
_TIMEOUT = b"Timeout"
_MAX_QUERIES = 10_000
_MAX_BYTES = 64 * 2**20
"""Of requests that nobody answered yet, together."""
_MAX_ANSWERED_QUERIES = 16
_MAX_CHARACTERS = 300
_time_ns = time.time_ns


class _ZenohServiceEndpoint(ZenohReader):
    """What both ends of a service have in common.

    Args:
        reads: the endpoint by which the graph knows it as a reader.
        writes: that by which it knows it as a writer.
    """

    def __init__(
        self, owner: ZenohParticipant, reads: DiscoveredEndpoint, writes: DiscoveredEndpoint, key: str
    ) -> None:
        self.gid = reads.guid
        self.endpoints = reads.guid, writes.guid
        self._key = key
        super().__init__(owner, reads, key)

    def take(self) -> Any:
        """The next of what was received."""
        items = self.queue.items
        return items.popleft() if items else None

    def connected(self) -> list[bytes]:
        """The GUIDs of what sends to it."""
        return list(self._owner.graph.connected(self.info))

    def all_acknowledged(self) -> bool:
        """See `ZenohWriter`."""
        return True


# -------------------------------------------------------------------------------------------------------------- client


class ZenohClient(_ZenohServiceEndpoint):
    """See `service_port.ServiceClientTransport`."""

    def __init__(
        self, owner: ZenohParticipant, replies: DiscoveredEndpoint, requests: DiscoveredEndpoint, key: str
    ) -> None:
        self._requests = requests
        self._sent = 0
        self._asked: dict[int, _InFlightQuery] = {}
        self._answered: deque[int] = deque()
        """Those that other servers may still answer."""
        self._seen_at = -1
        """How often the graph had changed when the following was so."""
        self._servers = ServerAvailability()
        self._present: frozenset[bytes] = frozenset()
        self._by_session: dict[bytes, bytes] = {}
        """What answers, by its session."""
        self._reached_at = -1
        """How often the graph had changed when a server was within reach; asking Zenoh takes 40 us."""
        self._longest_s = _NO_TIMEOUT_S if _GET_RESULT in key else None
        super().__init__(owner, replies, requests, key)

    def _declare(self, key: str) -> Any:
        return self._owner.session.declare_querier(
            key,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    # ---------------------------------------------------------------------------------------------------- requests

    def send(self, data: bytes, timeout_s: float | None = None) -> int | None:
        if self._closed:
            raise ClosedError(f"the client of {self.info.channel.name} is closed")
        # Not by a listener: Zenoh calls that on the thread which undeclaring an advanced publisher waits for, for up to
        # ten seconds and with Python's lock.
        changes = self._owner.graph.changes
        if changes != self._reached_at:
            if not self._subscriber.matching_status.matching:
                return None
            self._reached_at = changes
        number = self._sent + 1
        asked = self._asked[number] = _InFlightQuery(self, number)
        callback, attachment = zenoh_handler(asked.on_reply, asked.on_end), pack(number, _time_ns(), self.guid)
        try:
            self._owner.session.get(
                self._key,
                callback,
                target=zenoh.QueryTarget.ALL_COMPLETE,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=self._longest_s
                if timeout_s is None
                else min(timeout_s + _QUERY_TIMEOUT_MARGIN_S, _NO_TIMEOUT_S),
                payload=data,
                attachment=attachment,
                cancellation_token=asked.token,
            )
        except BaseException as error:
            self._sent = number
            self._cancel(number)
            if isinstance(error, zenoh.ZError):
                what = f"send a request of {len(data)} bytes on {self.info.channel.name}"
                raise TransportError(f"{what}: {error}") from None
            raise
        self._sent = number
        return number

    def cancel(self, number: int) -> None:
        """Nobody waits for that reply any more, or it came: then the query mostly ends by itself, which costs less."""
        asked = self._asked.get(number)
        if asked is None:
            return
        if asked.is_over:
            self._answered.append(number)
            if len(self._answered) <= _MAX_ANSWERED_QUERIES:
                return
            number = self._answered.popleft()
        self._cancel(number)

    def _cancel(self, number: int) -> None:
        """Zenoh may be in one of our functions, and is waited for: no locks."""
        asked = self._asked.pop(number, None)
        if asked is not None:
            asked.cancel()

    def on_query_end(self, number: int) -> None:
        """Called by Zenoh: nothing more will come for that request."""
        self._asked.pop(number, None)

    # ----------------------------------------------------------------------------------------------------- servers

    def servers(self) -> ServerAvailability:
        self._look()
        return self._servers

    def server_endpoints(self) -> frozenset[bytes]:
        self._look()
        return self._present

    def report_lost_requests(self) -> None:
        """Nothing to be done: a query ends when nobody is left to answer. Tokens may overtake the last replies."""

    def _look(self) -> None:
        graph = self._owner.graph
        changes = graph.version()
        if changes == self._seen_at:
            return
        reading, answering = graph.connected(self._requests), graph.connected(self.info)
        by_session = {one.participant_guid: one.guid for one in answering.values()}
        is_available = any(one.participant_guid in by_session for one in reading.values())
        keeps = fair_queue_share(
            (one.qos for one in reading.values()), graph.endpoints_on_same_side(self._requests).values()
        )
        self._servers, self._present = ServerAvailability(is_available, keeps), frozenset((*reading, *answering))
        self._by_session, self._seen_at = by_session, changes

    def replying_server(self, reply: Any) -> bytes | None:
        """The GUID of what answered, None when it is not known; called by Zenoh."""
        if reply.replier_id is None:
            return None
        session = participant_guid(str(reply.replier_id.zid))
        if session not in self._by_session:
            self._look()
        return self._by_session.get(session)

    def close(self) -> None:
        for number in list(self._asked):  # while undeclaring, Zenoh would end them with its session locked
            self._cancel(number)
        super().close()

    def detach_after_fork(self) -> None:
        super().detach_after_fork()
        leak_after_fork(self._asked)
        self._asked = {}


class _InFlightQuery:
    """A query under way."""

    __slots__ = ("_client", "_number", "_reason", "is_over", "token")

    def __init__(self, client: ZenohClient, number: int) -> None:
        self._client = client
        self._number = number
        self.is_over = False
        self._reason: tuple[str, ...] = ()
        self.token = zenoh.CancellationToken()

    def on_reply(self, reply: Any) -> None:
        """Called by Zenoh with each reply; an error is none."""
        sample = reply.ok
        if sample is None:
            said = reply.err.payload.to_bytes()
            is_late = said == _TIMEOUT
            self._reason = ("did not answer in time" if is_late else f"answered with an error: {_printable(said)}",)
            return
        data = sample.payload.to_bytes()
        if self._client.read_attachment(sample) is not None and len(data) >= HEADER_BYTES:
            self.is_over = True
            self._client.receive((self._number, data, self._client.replying_server(reply)))

    def on_end(self) -> None:
        """Called by Zenoh when nothing more will come."""
        self._client.on_query_end(self._number)
        if not self.is_over:
            self._client.receive((self._number, NoReply(*self._reason), None))

    def cancel(self) -> None:
        """Let Zenoh forget it; waits while Zenoh is in one of the functions above."""
        self.is_over = True
        self.token.cancel()


def _printable(text: bytes) -> str:
    """What a peer says, for people."""
    shown = text[: 4 * _MAX_CHARACTERS].decode(errors="replace")[:_MAX_CHARACTERS]
    return "".join(char if char.isprintable() else " " for char in shown)


# -------------------------------------------------------------------------------------------------------------- server


_RequestOrigin: TypeAlias = "tuple[bytes, int]"
"""What a `RequestId` is: the GID of the client and the number of its request."""


class _Query(NamedTuple):
    """A query that is not answered yet."""

    query: Any
    size_bytes: int


class ZenohServer(_ZenohServiceEndpoint):
    """See `service_port.ServiceServerTransport`; keeps the queries that are not answered yet."""

    def __init__(
        self, owner: ZenohParticipant, requests: DiscoveredEndpoint, replies: DiscoveredEndpoint, key: str
    ) -> None:
        self._queries: dict[_RequestOrigin, _Query] = {}
        self._queries_bytes = 0
        self._queries_lock = threading.RLock()
        self._replies = replies
        self._window = ReplyWindow(None)
        self._limited_at = -1
        super().__init__(owner, requests, replies, key)

    def take(self) -> Any:
        arrived = super().take()
        if arrived is not None and self._is_limited():
            self._window.on_request(arrived[0][0])
        return arrived

    def _is_limited(self) -> bool:
        graph = self._owner.graph
        if graph.changes != self._limited_at:
            self._limited_at = graph.version()
            self._window.set_readers(one.qos for one in graph.connected(self._replies).values())
        return self._window.limit > 0

    def _declare(self, key: str) -> Any:
        return self._owner.session.declare_queryable(key, zenoh_handler(self._take), complete=True)

    def _take(self, query: Any) -> None:
        """Called by Zenoh with each query."""
        told = self.read_attachment(query)
        data = b"" if query.payload is None else query.payload.to_bytes()
        if told is None or len(data) < HEADER_BYTES:
            query.drop()
            return
        number, source_ns, gid = told
        if not self._store_query((gid, number), _Query(query, len(data))):
            query.drop()
            return
        self.receive(((gid, number), data, paired_gid(gid), source_ns, _time_ns()))

    def _store_query(self, identity: _RequestOrigin, query: _Query) -> bool:
        """Remember a query until it is answered, and give up the oldest where there are too many; False: not wanted."""
        given_up = []
        with self._queries_lock:
            if self._closed or identity in self._queries:
                return False
            self._queries[identity] = query
            self._queries_bytes += query.size_bytes
            while len(self._queries) > 1 and (len(self._queries) > _MAX_QUERIES or self._queries_bytes > _MAX_BYTES):
                given_up.append(self.pop_query(next(iter(self._queries))))
        for old in filter(None, given_up):
            old.drop()
        return True

    def pop_query(self, identity: _RequestOrigin) -> Any | None:
        """The query to be answered; None when it is gone."""
        with self._queries_lock:
            found = self._queries.pop(identity, None)
            if found is None:
                return None
            self._queries_bytes -= found.size_bytes
            return found.query

    def send(self, to: RequestId, data: bytes) -> bool:
        """What answers nothing that is still asked is dropped."""
        if self._closed:
            raise ClosedError(f"the server of {self.info.channel.name} is closed")
        asker: _RequestOrigin = to
        is_limited = self._is_limited()
        if is_limited and not self._window.is_open(asker[0]):
            return False
        query = self.pop_query(asker)
        if query is None:
            return True
        gid, number = asker
        if is_limited:
            self._window.on_sent(gid)
        try:
            query.reply(self._key, data, attachment=pack(number, _time_ns(), gid))
        except zenoh.ZError as error:
            what = f"send a response of {len(data)} bytes on {self.info.channel.name}"
            raise TransportError(f"{what}: {error}") from None
        finally:
            query.drop()
        return True

    def release(self) -> None:
        self._window.release()

    def can_reach_client(self, to: RequestId) -> bool:
        """A response goes where its query came from."""
        return True

    def request_origin(self, to: RequestId) -> tuple[bytes, int]:
        asker: _RequestOrigin = to
        return asker

    def forget(self, client: bytes) -> None:
        """Drop the requests of a client that is gone."""
        with self._queries_lock:
            of_client = [identity for identity in self._queries if identity[0] == client]
        self._drop(of_client)

    def _drop(self, identities: list[_RequestOrigin]) -> None:
        for query in filter(None, map(self.pop_query, identities)):
            query.drop()

    def close(self) -> None:
        super().close()
        with self._queries_lock:
            left = list(self._queries)
        self._drop(left)

    def detach_after_fork(self) -> None:
        super().detach_after_fork()
        leak_after_fork(self._queries)
        self._queries, self._queries_lock = {}, threading.RLock()
