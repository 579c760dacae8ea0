"""Service clients: send a request, find its response among all that arrive.

Decides that a request never outlives who made it: an answer, a time limit, cancellation and `close` all remove it. So
does the end of the last server that got it: one that comes in its place has never heard of the request. `_enqueue`
is the
core, `call` and `send_request` futures on top of it. How a response is known to be the answer is the port's business.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import sys
from functools import partial
from typing import TYPE_CHECKING, Literal, TypeVar

from rosidl_py_gen.base.waiters import complete_threadsafe, set_result_if_pending
from rosidl_py_gen.errors import ClosedError, DecodeError, RosidlError
from rosidl_py_gen.runtime.entities.flow_control import PendingRequest, RequestTimedOutError
from rosidl_py_gen.runtime.entities.service import ServiceEndpoint
from rosidl_py_gen.runtime.entities.service_common import (
    CallTimeoutError,
    IncompatibleServiceError,
    ServerLostError,
    incompatible_peer_text,
)
from rosidl_py_gen.runtime.loop.blocking import blocking
from rosidl_py_gen.runtime.loop.timeout_table import TimeoutTable
from rosidl_py_gen.runtime.time.deadline import Deadline, with_reason
from rosidl_py_gen.runtime.transport.service_api import NoReply

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.samples import Payload
    from rosidl_py_gen.runtime.transport.service_api import ServerAvailability

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")


class Client(ServiceEndpoint[RequestT, ResponseT]):
    """Made by `Node.create_client`."""

    def __init__(
        self,
        scope: EntityScope,
        service_type: ServiceType[RequestT, ResponseT],
        name: str,
        qos: QoSProfile,
        *,
        pause_s: float | None = None,
        type_hash_check: TypeCheck | None = None,
    ) -> None:
        """`pause_s` is that of the `RequestFlowControl`."""
        super().__init__(scope, service_type, name, qos, is_client=True, type_hash_check=type_hash_check)
        self._port = self._open(scope.participant.create_client(self._spec, self.qos, node=scope.number))
        self._pending: dict[int, PendingRequest[ResponseT]] = {}
        self._by_number: dict[int, PendingRequest[ResponseT]] = {}
        """Those that were sent, by the port's numbers."""
        self._limits: TimeoutTable | None = None
        self._was_asked = False
        """Replies go to functions that may be the user's, and not only to futures."""
        self._window = scope.request_window(self._requests_on, name, pause_s)
        self._port.set_sink(self._on_replies)
        self._departures = scope.discovery.on_endpoint_lost.add(self._on_departure)
        reader, writer = self._port.endpoints
        scope.register(self, reader=reader, writer=writer)

    # ----------------------------------------------------------------------------------------------------- servers

    def service_is_available(self) -> bool:
        """Whether a server is connected, both ways.

        Raises:
            IncompatibleServiceError: the only servers are on Fast DDS, and this Cyclone DDS cannot talk to them.
            ClosedError: the client is closed.
        """
        self._scope.require_open(self._closed, f"the client of {self.name}")
        self._scope.discovery.refresh()
        return self._available().is_available

    def service_is_ready(self) -> bool:
        """Return `service_is_available()`; the name in rclpy."""
        return self.service_is_available()

    async def wait_for_service(self, timeout_s: float | None = None) -> Literal[True]:
        """Wait until a server with matching endpoints is connected.

        Raises:
            WaitTimeoutError: none was in time.
            IncompatibleServiceError: the only servers are on Fast DDS, and this Cyclone DDS cannot talk to them.
        """
        return await self._scope.wait_or_raise(
            self._available, timeout_s, lambda: self._closed, self._missing, why=self._why_missing
        )

    wait_for_service_sync = blocking(wait_for_service)

    def _servers(self) -> set[bytes]:
        """The GUIDs of what answers, of all servers; empty when none can be talked to."""
        try:
            return set(self._port.connected()) if self._available() else set()
        except IncompatibleServiceError:
            return set()

    def _available(self) -> ServerAvailability:
        """Return the servers that can be reached; falsy if there are none. Raises `IncompatibleServiceError`."""
        servers = self._port.servers()
        if servers.incompatible_server is not None:
            raise IncompatibleServiceError(
                incompatible_peer_text(self._scope.graph, servers.incompatible_server, self.name, "the server")
            )
        return servers

    def _missing(self) -> str:
        return f"no server of {self.name} ({self.service_type}) appeared"

    def _why_missing(self, ending: str = "") -> str:
        """Return why no server is connected; `ending` is that of `UnmatchedReasons.why`."""
        reader, writer = self._port.endpoints
        requests, replies = self._spec.channels
        why = self._scope.why_unmatched(writer, requests, is_writer=True, ending=ending)
        if not why.is_known:
            why = self._scope.why_unmatched(reader, replies, is_writer=False, ending=ending)
        return why.text

    # ------------------------------------------------------------------------------------------------------- calls

    async def call(self, request: RequestT, timeout_s: float | None = None) -> ResponseT:
        """Send a request and wait for its response; any number of calls may be under way.

        A server that is not there yet is waited for, as part of `timeout_s`; None waits for ever.

        Raises:
            CallTimeoutError: a `TimeoutError`.
            ServerLostError: all servers that got the request went away, or Zenoh tells that one failed.
            IncompatibleServiceError: the only servers are on Fast DDS, and this Cyclone DDS cannot talk to them.
            EncodeError: the request does not fit its type.
            DecodeError: the response does not.
            ClosedError: the client was closed, also while waiting.
        """
        scope = self._scope
        if self._closed or scope.closed:
            scope.require_open(True, f"the client of {self.name}")
        deadline = Deadline(timeout_s)
        loop = scope.bridge.running_loop()
        encoded = self._type.request.encode(request)
        servers = self._available()
        if not servers.is_available:
            await scope.wait_until(self._available, deadline.remaining_s(), lambda: self._closed)
            servers = self._available()
        if not servers.is_available:
            raise CallTimeoutError(with_reason(f"{self._missing()} in {timeout_s:g} s", self._why_missing()))
        future: asyncio.Future[ResponseT] = loop.create_future()
        on_error = partial(complete_threadsafe, future, None)
        pending: PendingRequest[ResponseT]
        left_s = deadline.remaining_s()
        pending = PendingRequest(encoded, lambda response, _: set_result_if_pending(future, response), on_error, left_s)
        self._enqueue(pending, servers)
        if left_s is not None:
            self._limit(pending, loop, left_s)
        try:
            return await future
        except RequestTimedOutError:
            message = f"no response from {self.name} ({self.service_type}) in {timeout_s:g} s"
            raise CallTimeoutError(message) from None
        finally:
            self._abandon_request(pending.sequence)

    def call_sync(self, request: RequestT, timeout_s: float | None = None) -> ResponseT:
        """`call` for plain code: from a script without event loop, or from another thread than the loop's.

        Raises:
            WouldDeadlockError: called on the event loop's thread; use ``await client.call(...)`` there, or run the
                callback in a thread (`asyncio.to_thread`). Otherwise like `call`.
        """
        call = self.call(request, timeout_s)
        return self._scope.run_blocking(call, f"call_sync on {self.name}", "'await client.call(...)'")

    def send_request(self, request: RequestT) -> concurrent.futures.Future[ResponseT]:
        """Send a request to the servers that are there now, and return at once; from any thread.

        Nothing waits for a server: `wait_for_service` and `service_is_available` tell of one. Without any, the request
        is lost on DDS, and is kept for the first that comes on Zenoh.

        Returns:
            A future of the response. It fails with `ServerLostError`, `DecodeError`, `TransportError`, or with
            `ClosedError` when the client is closed, as `call` does; there is no time limit. `cancel` forgets the
            request. Its callbacks are called on the event loop, which has to run, or to be waited for in a `Driver`:
            ``driver.wait(future.done, timeout_s=1.0)``. In an async function use ``await asyncio.wrap_future(future)``,
            or simply `call`.

        Raises:
            EncodeError: the request does not fit its type. TypeError: it is of another type. ClosedError.
        """
        scope = self._scope
        scope.require_open(self._closed, f"the client of {self.name}")
        encoded = self._type.request.encode(request)
        future: concurrent.futures.Future[ResponseT] = concurrent.futures.Future()

        def on_reply(response: ResponseT, _: bytes | None) -> None:
            if future.set_running_or_notify_cancel():
                future.set_result(response)

        def on_error(error: Exception) -> None:
            if not future.done() and future.set_running_or_notify_cancel():
                future.set_exception(error)

        def on_done(_: object) -> None:
            if future.cancelled():
                scope.bridge.call_soon(partial(self._abandon_request, pending.sequence))

        self._was_asked = True
        pending = PendingRequest(encoded, on_reply, on_error)
        future.add_done_callback(on_done)
        scope.bridge.call_in_loop(lambda: self._enqueue(pending, self._port.servers()))
        return future

    def _start_request(
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
        self._enqueue(pending, self._port.servers())
        return pending.sequence

    def _abandon_request(self, sequence: int) -> None:
        """Nobody waits for this reply any more; without effect when it is over already."""
        pending = self._pending.pop(sequence, None)
        if pending is not None:
            if pending.number:
                del self._by_number[pending.number]
                self._port.cancel(pending.number)
            if pending.limits is not None:
                pending.limits.remove(sequence)
            if pending.flow_number:
                self._window.release(pending.flow_number)

    def _enqueue(self, pending: PendingRequest[ResponseT], servers: ServerAvailability) -> None:
        pending.had_servers = servers.is_available or bool(self._port.server_endpoints())
        self._pending[pending.sequence] = pending
        if servers.request_queue_depth:
            self._window.acquire(partial(self._send_in_turn, pending), servers.request_queue_depth, self)
        else:
            self._send_soon(pending)

    def _limit(self, pending: PendingRequest[ResponseT], loop: asyncio.AbstractEventLoop, left_s: float) -> None:
        """Let a request fail when its time has passed."""
        if self._limits is None or self._limits.loop is not loop:
            self._limits = TimeoutTable(loop, self._expire)
        pending.limits = self._limits
        self._limits.add(pending.sequence, left_s)

    def _expire(self, sequence: int) -> None:
        pending = self._pending.get(sequence)
        if pending is not None:
            self._fail(pending, RequestTimedOutError())

    def _send_soon(self, pending: PendingRequest[ResponseT]) -> None:
        if self._outbox.waiting or not self._send(pending):
            self._outbox.send(partial(self._send, pending))

    def _send_in_turn(self, pending: PendingRequest[ResponseT], turn: int) -> bool:
        if pending.sequence not in self._pending:
            return False
        self._window.server_queue_depth = (
            self._port.servers().request_queue_depth or sys.maxsize
        )  # others may have come who share what it is
        pending.flow_number = turn
        self._send_soon(pending)
        return True

    def _send(self, pending: PendingRequest[ResponseT]) -> bool:
        """Write a request; False when the servers are so far behind that it has to wait."""
        if pending.sequence not in self._pending:
            return True
        try:
            number = self._port.send(pending.encoded, pending.timeout_s)
        except RosidlError as error:
            self._fail(pending, error)
            return True
        except BaseException:  # a signal handler's
            self._abandon_request(pending.sequence)
            raise
        if number is None:
            return False
        pending.number = number
        self._by_number[number] = pending
        if self._tap is not None:
            self._tap.sent(self._gid, number, pending.encoded)
        return True

    def _fail(self, pending: PendingRequest[ResponseT], error: Exception) -> None:
        self._abandon_request(pending.sequence)
        pending.on_error(error)

    def _on_replies(self) -> Callable[[], None] | None:
        """The sink of the reply reader."""
        if self._was_asked:
            return self._read_all
        self._read_all()
        return None

    def _read_all(self) -> None:
        take, agreeing = self._port.take, self._agreeing
        while (reply := take()) is not None:
            number, response, server = reply
            if isinstance(response, NoReply):
                self._fail_lost(number, response)
                continue
            if server not in agreeing and not self._check.accepts(server):
                continue
            if self._tap is not None:
                self._tap.received(self._gid, number, response)
            pending = self._by_number.get(number)
            if pending is not None:
                self._take_reply(pending, response, server)

    def _on_departure(self) -> None:
        """Somebody left the graph; whoever waits for an answer is told on the loop, in a callback of its own."""
        if self._pending:
            self._scope.bridge.call_soon(self._check_lost_requests)

    def _check_lost_requests(self) -> None:
        """Let requests fail that nobody is left to answer. What was answered before is read before."""
        if self._closed:
            return
        self._port.report_lost_requests()
        self._read_all()
        if not self._port.server_endpoints():
            for pending in list(self._pending.values()):
                if pending.had_servers and not pending.number:
                    self._fail(pending, self._lost_reason(NoReply()))

    def _fail_lost(self, number: int, why: NoReply) -> None:
        pending = self._by_number.get(number)
        if pending is not None:
            self._fail(pending, self._lost_reason(why))

    def _lost_reason(self, why: NoReply) -> ServerLostError:
        return ServerLostError(f"the server of {self.name} {why.reason}")

    def _take_reply(self, pending: PendingRequest[ResponseT], message: Payload, server: bytes | None) -> None:
        if pending.flow_number:
            self._window.on_response(pending.flow_number, self)
        try:
            response = self._type.response.decode(message)
        except DecodeError as error:
            self._fail(pending, error)
            return
        if pending.on_reply(response, server) is not True:
            self._abandon_request(pending.sequence)

    # ------------------------------------------------------------------------------------------------------- state

    def all_acknowledged(self) -> bool:
        """Whether every server has taken in all requests that were sent; one that lives does so within milliseconds."""
        return self._port.all_acknowledged()

    @property
    def in_flight_count(self) -> int:
        """How many calls wait for a response."""
        return len(self._pending)

    def close(self) -> None:
        """Stop; calls under way raise `ClosedError`. May be called twice."""
        if self._begin_close(*self._port.endpoints):
            self._departures.close()
            for pending in list(self._pending.values()):
                self._fail(pending, ClosedError(f"the client of {self.name} was closed during the call"))
            self._outbox.close()
            self._port.close()
