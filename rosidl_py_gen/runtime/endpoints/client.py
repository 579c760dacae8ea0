"""Service clients: send a request, find its response among all that arrive.

Decides how replies are matched (own id plus sequence number, protocol.md 5.1; nothing of other clients' is copied),
and that a request never outlives who made it: an answer, a time limit,
cancellation and `close` all remove it. So does the end of the last server that got it: one that comes in its place has
never heard of the request. `ask` is the core, `call` a future on top of it.

A request goes to all servers of its service, in the way one kind of them understands. As soon as one of them wants an
`Identity`, as those on Fast DDS, it is theirs: Cyclone's have to refuse most requests of that kind as too short, ours
understand them, whereas Fast DDS would take the header of the other kind for the message. In that way requests are
numbered by the middleware, 1, 2, 3 ... for each writer, so they are counted here. The first ones say which reader waits
for the reply, so that a server waits until it is connected with it. Servers that have answered are; when all have,
requests say nothing, which takes less time: Fast DDS takes them for those of their writer.
"""

from __future__ import annotations

import asyncio
import sys
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from rosidl_py_gen.errors import ClosedError, DecodeError, RosidlError
from rosidl_py_gen.runtime.endpoints.answering import ServersOfClient
from rosidl_py_gen.runtime.endpoints.header import (
    CallTimeoutError,
    ForeignServiceError,
    ServerLostError,
    header_of,
    message_of,
    send,
)
from rosidl_py_gen.runtime.endpoints.window import OutOfTimeError, PendingRequest
from rosidl_py_gen.runtime.loop.callbacks import settle, settle_threadsafe
from rosidl_py_gen.runtime.loop.time_limits import TimeLimits
from rosidl_py_gen.runtime.time.deadline import Deadline
from rosidl_py_gen.runtime.transport.unanswered import why_unanswered

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.endpoints.header import ClientId
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import ServiceType
    from rosidl_py_gen.runtime.graph.definitions import TypeCheck
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")


class Client(ServersOfClient[RequestT, ResponseT]):
    """Made by `Node.create_client`."""

    def __init__(
        self,
        scope: Scope,
        service_type: ServiceType[RequestT, ResponseT],
        name: str,
        qos: QoSProfile,
        *,
        pause_s: float | None = None,
        type_check: TypeCheck | None = None,
    ) -> None:
        """`pause_s` is that of the `RequestWindow`."""
        super().__init__(scope, service_type, name, qos, type_check=type_check)
        self._pending: dict[int, PendingRequest[ResponseT]] = {}
        self._by_number: dict[int, PendingRequest[ResponseT]] = {}
        """Those that were sent with an identity, by the middleware's numbers."""
        self._sent = 0
        self._limits: TimeLimits | None = None
        self._is_told = scope.participant.ends_requests
        self._was_asked = False
        """Replies go to functions that may be the user's, and not only to futures."""
        self._names: tuple[ClientId, ...] = (self._writer.handle, self._reader.guid, self._writer.guid)
        """By which replies may call us."""
        self._window = scope.request_window(self._requests_on, name, pause_s)
        self._reader.set_sink(self._on_replies)
        self._departures = scope.discovery.departures.add(self._on_departure)
        scope.own(self, reader=self._reader.guid, writer=self._writer.guid)

    # ------------------------------------------------------------------------------------------------------- calls

    async def call(self, request: RequestT, timeout_s: float | None = None) -> ResponseT:
        """Send a request and wait for its response; any number of calls may be under way.

        A server that is not there yet is waited for, as part of `timeout_s`; None waits for ever.

        Raises:
            CallTimeoutError: a `TimeoutError`.
            ServerLostError: all servers that got the request went away, or Zenoh tells that one failed.
            ForeignServiceError: the only servers are on Fast DDS, and this machine's Cyclone DDS cannot talk to them.
            EncodeError: the request does not fit its type. DecodeError: the response does not.
            ClosedError: the client was closed, also while waiting.
        """
        scope = self._scope
        if self._closed or scope.closed:
            scope.require_open(True, f"the client of {self.name}")
        deadline = Deadline(timeout_s)
        loop = scope.bridge.running_loop()
        encoded = self._type.request.encode(request)
        is_there = self._is_available() or await scope.wait_until(
            self._is_available, deadline.left_s(), lambda: self._closed
        )
        if not is_there:
            raise CallTimeoutError(f"{self._missing()} in {timeout_s} s")
        future: asyncio.Future[ResponseT] = loop.create_future()
        on_error = partial(settle_threadsafe, future, None)
        pending: PendingRequest[ResponseT]
        left_s = deadline.left_s()
        pending = PendingRequest(encoded, lambda response, _: settle(future, response), on_error, left_s)
        self._put(pending)
        if left_s is not None:
            self._limit(pending, loop, left_s)
        try:
            return await future
        except OutOfTimeError:
            message = f"no response from {self.name} ({self.service_type}) in {timeout_s} s"
            raise CallTimeoutError(message) from None
        finally:
            self.forget(pending.sequence)

    def call_sync(self, request: RequestT, timeout_s: float | None = None) -> ResponseT:
        """`call` for plain code: from a script without event loop, or from another thread than the loop's.

        Raises:
            WouldDeadlockError: called on the event loop's thread; use ``await client.call(...)`` there, or run the
                callback in a thread (`asyncio.to_thread`). Otherwise like `call`.
        """
        call = self.call(request, timeout_s)
        return self._scope.run(call, f"call_sync on {self.name}", "'await client.call(...)'")

    def ask(
        self,
        request: RequestT,
        on_reply: Callable[[ResponseT, bytes | None], object],
        on_error: Callable[[Exception], object],
    ) -> int:
        """Send a request to the servers that are connected now; one of the functions is called, on the loop's thread.

        Args:
            on_reply: gets a response, and the GUID of the reply writer it came from. It answers True to hear what other
                servers say, too.
            on_error: gets `DecodeError`, `TransportError`, `ServerLostError`, or `ClosedError` of `close`; nothing
                comes after that.

        Returns:
            The number for `forget`.

        Raises:
            EncodeError: the request does not fit its type. ClosedError.
        """
        self._scope.require_open(self._closed, f"the client of {self.name}")
        self._scope.bridge.running_loop()
        self._was_asked = True
        pending = PendingRequest(self._type.request.encode(request), on_reply, on_error)
        self._put(pending)
        return pending.sequence

    def forget(self, sequence: int) -> None:
        """Nobody waits for this reply any more; without effect when it is over already."""
        pending = self._pending.pop(sequence, None)
        if pending is not None:
            if pending.number:
                self._by_number.pop(pending.number, None)
                self._writer.forget(pending.number)
            if pending.limits is not None:
                pending.limits.remove(sequence)
            if pending.turn:
                self._window.leave(pending.turn)

    def _put(self, pending: PendingRequest[ResponseT]) -> None:
        pending.servers = self._presence.now()
        self._pending[pending.sequence] = pending
        if self._kept:
            self._window.enter(partial(self._send_in_turn, pending), self._kept, self)
        else:
            self._send_soon(pending)

    def _limit(self, pending: PendingRequest[ResponseT], loop: asyncio.AbstractEventLoop, left_s: float) -> None:
        """Let a request fail when its time has passed."""
        if self._limits is None or self._limits.loop is not loop:
            self._limits = TimeLimits(loop, self._expire)
        pending.limits = self._limits
        self._limits.add(pending.sequence, left_s)

    def _expire(self, sequence: int) -> None:
        pending = self._pending.get(sequence)
        if pending is not None:
            self._fail(pending, OutOfTimeError())

    def _send_soon(self, pending: PendingRequest[ResponseT]) -> None:
        if self._outbox.waiting or not self._send(pending):
            self._outbox.send(partial(self._send, pending))

    def _send_in_turn(self, pending: PendingRequest[ResponseT], turn: int) -> bool:
        if pending.sequence not in self._pending:
            return False
        with suppress(ForeignServiceError):
            self._is_available()  # others may have come who share what the server keeps
        self._window.kept = self._kept or sys.maxsize
        pending.turn = turn
        self._send_soon(pending)
        return True

    def _send(self, pending: PendingRequest[ResponseT]) -> bool:
        """Write a request; False when the servers are so far behind that it has to wait."""
        if pending.sequence not in self._pending:
            return True
        number = self._sent + 1
        client: ClientId = self._writer.handle
        shown = pending.sequence
        if self._identified:
            client, shown = self._reader.guid, number
        try:
            # The second look comes after one at the graph, if that has changed.
            all_have = self._identified and self._answering.all_have()
            if all_have and self._matching.is_complete(None) and self._answering.all_have():
                sent = self._writer.write(pending.encoded)
            else:
                sent = send(self._writer, pending.encoded, client, shown, pending.timeout_s)
        except RosidlError as error:
            self._fail(pending, error)
            return True
        except BaseException:
            self._sent = number  # it was written; what interrupted us came behind
            self.forget(pending.sequence)
            raise
        if sent:
            self._sent = number
            pending.is_sent, pending.servers = True, self._presence.now()
            if isinstance(client, bytes):
                pending.number = number
                self._by_number[number] = pending
        if sent and self._tap is not None:
            self._tap.sent(self._gid, shown, pending.encoded)
        return sent

    def _fail(self, pending: PendingRequest[ResponseT], error: Exception) -> None:
        self.forget(pending.sequence)
        pending.on_error(error)

    def _on_replies(self) -> Callable[[], None] | None:
        """The sink of the reply reader."""
        if self._was_asked:
            return self._read_all
        self._read_all()
        return None

    def _read_all(self) -> None:
        """All clients of a service see all replies."""
        items = self._reader.queue.items
        while items:
            data, _, handle, _ = items.popleft()
            if handle not in self._agreeing and not self._check.admits(handle):
                continue
            try:
                client, sequence, begin = header_of(data)
            except DecodeError as err:
                if self._throttle.passes():
                    self._scope.logger.warning(f"dropped a reply on {self.name}: {err}")
                continue
            if client not in self._names:
                continue
            reason = why_unanswered(data)
            if reason is not None:
                self._lose(sequence, reason)
                continue
            server = self._reader.writer_guid(handle)
            if server is not None and not isinstance(client, bytes) and self._scope.participant.identifies(server):
                continue
            if self._tap is not None:
                self._tap.received(self._gid, sequence, message_of(data, begin))
            if server is not None and self._scope.participant.counts_requests(server):
                self._answering.heard(server)
            pending = (self._by_number if isinstance(client, bytes) else self._pending).get(sequence)
            if pending is not None:
                self._take_reply(pending, message_of(data, begin), server)

    def _on_departure(self) -> None:
        """Somebody left the graph; whoever waits for an answer is told on the loop, in a callback of its own."""
        if self._pending:
            self._scope.bridge.call_soon(self._look_for_lost)

    def _look_for_lost(self) -> None:
        """Let requests fail that nobody is left to answer. What was answered before is read before."""
        if self._closed or not self._lost():
            return
        self._reader.fetch()
        self._read_all()
        for pending in self._lost():
            self._fail(pending, ServerLostError(f"the server of {self.name} went away before it answered"))

    def _lost(self) -> list[PendingRequest[ResponseT]]:
        present = self._presence.now()
        return [pending for pending in self._pending.values() if pending.is_lost(present, self._is_told)]

    def _lose(self, number: int, reason: str) -> None:
        pending = self._by_number.get(number)
        if pending is not None:
            self._fail(pending, ServerLostError(f"the server of {self.name} {reason}"))

    def _take_reply(self, pending: PendingRequest[ResponseT], message: bytes, server: bytes | None) -> None:
        if pending.turn:
            self._window.taken(pending.turn, self)
        try:
            response = self._type.response.decode(message)
        except DecodeError as error:
            self._fail(pending, error)
            return
        if pending.on_reply(response, server) is not True:
            self.forget(pending.sequence)

    # ------------------------------------------------------------------------------------------------------- state

    def all_acknowledged(self) -> bool:
        """Whether every server has taken in all requests that were sent; one that lives does so within milliseconds."""
        return self._writer.all_acknowledged()

    @property
    def pending_count(self) -> int:
        """How many calls wait for a response."""
        return len(self._pending)

    def close(self) -> None:
        """Stop; calls under way raise `ClosedError`. May be called twice."""
        if self._ends(self._reader.guid, self._writer.guid):
            self._departures.close()
            for pending in list(self._pending.values()):
                self._fail(pending, ClosedError(f"the client of {self.name} was closed during the call"))
            self._outbox.close()
            self._writer.close()
            self._reader.close()
