"""Clients and servers: a request is a query of Zenoh, its response a reply to it.

Decides that a request waits until a server is within reach, so that it is never lost for being early; that a query
which ends without a response, because its servers died, is told to the client as such; and how long queries are kept
that nobody answers: until their client is gone, or many others came behind. A query has the time that its
call has, as Zenoh keeps 1 kB of each until that has passed, answered or not; a client that gives one up cancels it.

Source: zenoh.md 6.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple

import zenoh

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.port import TransportError, identified
from rosidl_py_gen.runtime.transport.unanswered import unanswered
from rosidl_py_gen.runtime.transport.zenoh.attachment import pack
from rosidl_py_gen.runtime.transport.zenoh.endpoints import ZenohReader, handler, keep
from rosidl_py_gen.runtime.transport.zenoh.graph import twin

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.discovered import EndpointFound
    from rosidl_py_gen.runtime.transport.port import Identity, Payload
    from rosidl_py_gen.runtime.transport.zenoh.endpoints import Host

_ENDLESS_S = 1e9
"""Zenoh refuses infinity."""
_GET_RESULT = "/_action/get_result/"
"""In the keys of requests that may take for ever, as rmw_zenoh_cpp has it. Others have `queries_default_timeout`."""
_LATER_S = 1.0
"""So much longer than a call Zenoh waits: the call says it better."""
_TIMEOUT = b"Timeout"
_MOST_QUERIES = 10_000
_MOST_BYTES = 64 * 2**20
"""Of requests that nobody answered yet, together."""
_MOST_ANSWERED = 16
_HEADER_BYTES = 4
_MOST_CHARACTERS = 300
_time_ns = time.time_ns


class _Half:
    """A writer whose other half has the Zenoh entity; see `port.Writer`."""

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

    def forget(self, number: int) -> None:
        """Only requests are kept."""

    def reaches(self, client: bytes) -> bool:
        """A reply goes where its query came from."""
        return True

    def all_acknowledged(self) -> bool:
        """See `ZenohWriter`."""
        return True

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        return None

    def assert_liveliness(self) -> None:
        """Nobody looks for it."""

    def close(self) -> None:
        self._closed = True


# -------------------------------------------------------------------------------------------------------------- client


class ReplyReader(ZenohReader):
    """The half of a client that has its queries answered."""

    def __init__(self, owner: Host, info: EndpointFound, key: str) -> None:
        self._asked: dict[int, _Asked] = {}
        self._answered: deque[int] = deque()
        """Those that other servers may still answer."""
        self._servers: tuple[int, dict[str, int]] = (-1, {})
        """The handles of the servers of each session, when the graph had changed so often."""
        self._reached_at = -1
        """How often the graph had changed when a server was within reach; asking Zenoh takes 40 us."""
        self._key = key
        self._longest_s = _ENDLESS_S if _GET_RESULT in key else None
        super().__init__(owner, info, key)

    def _declare(self, key: str) -> Any:
        return self._owner.session.declare_querier(
            key,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def ask(self, data: bytes, number: int, timeout_s: float | None) -> bool:
        """Send a request; False while no server is within reach."""
        # Not by a listener: Zenoh calls that on the thread which undeclaring an advanced publisher waits for, for up to
        # ten seconds and with Python's lock.
        changes = self._owner.graph.changes
        if changes != self._reached_at:
            if not self._subscriber.matching_status.matching:
                return False
            self._reached_at = changes
        asked = self._asked[number] = _Asked(self, number)
        callback, attachment = handler(asked.on_reply, asked.on_end), pack(number, _time_ns(), self.guid)
        try:
            self._owner.session.get(
                self._key,
                callback,
                target=zenoh.QueryTarget.ALL_COMPLETE,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=self._longest_s if timeout_s is None else min(timeout_s + _LATER_S, _ENDLESS_S),
                payload=data,
                attachment=attachment,
                cancellation_token=asked.token,
            )
        except BaseException:
            self._cancel(number)
            raise
        return True

    def forget(self, number: int) -> None:
        """Nobody waits for that reply any more, or it came: then the query mostly ends by itself, which costs less."""
        asked = self._asked.get(number)
        if asked is None:
            return
        if asked.is_over:
            self._answered.append(number)
            if len(self._answered) <= _MOST_ANSWERED:
                return
            number = self._answered.popleft()
        self._cancel(number)

    def _cancel(self, number: int) -> None:
        """Zenoh may be in one of our functions, and is waited for: no locks."""
        asked = self._asked.pop(number, None)
        if asked is not None:
            asked.cancel()

    def ended(self, number: int) -> None:
        """Called by Zenoh: nothing more will come for that request."""
        self._asked.pop(number, None)

    def close(self) -> None:
        for number in list(self._asked):  # while undeclaring, Zenoh would end them with its session locked
            self._cancel(number)
        super().close()

    def abandon(self) -> None:
        super().abandon()
        keep(self._asked)
        self._asked = {}

    def server_of(self, reply: Any) -> int:
        """The handle of the server that answered, 0 when it is not known."""
        if reply.replier_id is None:
            return 0
        changes = self._owner.graph.changes
        if self._servers[0] != changes:
            connected = self._owner.graph.connected(self.info)
            self._servers = changes, {zid: int.from_bytes(guid, "little") for guid, zid in connected.items()}
        return self._servers[1].get(str(reply.replier_id.zid), 0)


class _Asked:
    """A query under way."""

    __slots__ = ("_client", "_identity", "_reason", "is_over", "token")

    def __init__(self, client: ReplyReader, number: int) -> None:
        self._client = client
        self._identity = (client.guid, number)
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
        told = self._client.read_attachment(sample)
        data = sample.payload.to_bytes()
        if told is not None and len(data) >= _HEADER_BYTES:
            self.is_over = True
            answer = identified(data, self._identity)
            self._client.receive((answer, told[1], self._client.server_of(reply), _time_ns()))

    def on_end(self) -> None:
        """Called by Zenoh when nothing more will come."""
        self._client.ended(self._identity[1])
        if not self.is_over:
            now = _time_ns()
            self._client.receive((unanswered(self._identity, *self._reason), now, 0, now))

    def cancel(self) -> None:
        """Let Zenoh forget it; waits while Zenoh is in one of the functions above."""
        self.is_over = True
        self.token.cancel()


def _printable(text: bytes) -> str:
    """What a peer says, for people."""
    shown = text[: 4 * _MOST_CHARACTERS].decode(errors="replace")[:_MOST_CHARACTERS]
    return "".join(char if char.isprintable() else " " for char in shown)


class RequestWriter(_Half):
    """The half of a client that sends requests."""

    def __init__(self, owner: Host, info: EndpointFound, reader: ReplyReader) -> None:
        super().__init__(owner, info)
        self._reader = reader

    def write(self, data: Payload, identity: Identity | None = None, timeout_s: float | None = None) -> bool:
        """See `port.Writer`; False while no server is within reach."""
        if self._closed:
            raise ClosedError(f"the writer of {self.info.channel.name} is closed")
        if identity is None:
            raise TransportError(f"a request on {self.info.channel.name} needs an identity")
        try:
            return self._reader.ask(bytes(data), identity[1], timeout_s)
        except zenoh.ZError as error:
            raise TransportError(f"send a request of {len(data)} bytes on {self.info.channel.name}: {error}") from None

    def forget(self, number: int) -> None:
        """See `port.Writer`."""
        self._reader.forget(number)


# -------------------------------------------------------------------------------------------------------------- server


class _Query(NamedTuple):
    """A query that is not answered yet."""

    query: Any
    size_bytes: int


class RequestReader(ZenohReader):
    """The half of a server that gets queries, and keeps those that are not answered yet."""

    def __init__(self, owner: Host, info: EndpointFound, key: str) -> None:
        self._queries: dict[Identity, _Query] = {}
        self._queries_bytes = 0
        self._queries_lock = threading.RLock()
        super().__init__(owner, info, key)

    def _declare(self, key: str) -> Any:
        return self._owner.session.declare_queryable(key, handler(self._take), complete=True)

    def _take(self, query: Any) -> None:
        """Called by Zenoh with each query."""
        told = self.read_attachment(query)
        data = b"" if query.payload is None else query.payload.to_bytes()
        if told is None or len(data) < _HEADER_BYTES:
            query.drop()
            return
        number, stamp_ns, gid = told
        if not self._keep((gid, number), _Query(query, len(data))):
            query.drop()
            return
        self.receive((identified(data, (gid, number)), stamp_ns, int.from_bytes(twin(gid), "little"), _time_ns()))

    def _keep(self, identity: Identity, query: _Query) -> bool:
        """Remember a query until it is answered, and give up the oldest where there are too many; False: not wanted."""
        given_up = []
        with self._queries_lock:
            if self._closed or identity in self._queries:
                return False
            self._queries[identity] = query
            self._queries_bytes += query.size_bytes
            while len(self._queries) > 1 and (len(self._queries) > _MOST_QUERIES or self._queries_bytes > _MOST_BYTES):
                given_up.append(self.claim(next(iter(self._queries))))
        for old in filter(None, given_up):
            old.drop()
        return True

    def claim(self, identity: Identity) -> Any | None:
        """The query to be answered; None when it is gone."""
        with self._queries_lock:
            found = self._queries.pop(identity, None)
            if found is None:
                return None
            self._queries_bytes -= found.size_bytes
            return found.query

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

    def abandon(self) -> None:
        super().abandon()
        keep(self._queries)
        self._queries, self._queries_lock = {}, threading.RLock()


class ReplyWriter(_Half):
    """The half of a server that answers."""

    def __init__(self, owner: Host, info: EndpointFound, reader: RequestReader, key: str) -> None:
        super().__init__(owner, info)
        self._reader = reader
        self._key = key

    def write(self, data: Payload, identity: Identity | None = None, timeout_s: float | None = None) -> bool:
        """See `port.Writer`; what answers nothing that is still asked is dropped."""
        if self._closed:
            raise ClosedError(f"the writer of {self.info.channel.name} is closed")
        query = None if identity is None else self._reader.claim(identity)
        if query is None or identity is None:
            return True
        gid, number = identity
        try:
            query.reply(self._key, bytes(data), attachment=pack(number, _time_ns(), gid))
        except zenoh.ZError as error:
            raise TransportError(f"send a response of {len(data)} bytes on {self.info.channel.name}: {error}") from None
        finally:
            query.drop()
        return True
