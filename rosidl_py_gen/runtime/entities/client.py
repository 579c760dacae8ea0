"""Service clients.

The method `_enqueue` sends a request; `call` and `send_request` are based on it. Each request ends with a reply, a
timeout, a cancellation, `close`, or the loss of the last server that received the request: a server that starts later
does not have the request. How a reply is assigned to its request depends on the transport.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import sys
from functools import partial
from typing import TYPE_CHECKING, Literal, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import blocking, complete_threadsafe
from rosidl_py_gen.errors import ClosedError, DecodeError, RosidlError
from rosidl_py_gen.runtime.entities.flow_control import PendingRequest, RequestTimedOutError
from rosidl_py_gen.runtime.entities.service_common import (
    CallTimeoutError,
    IncompatibleServiceError,
    ServerLostError,
    ServiceEndpoint,
    incompatible_peer_text,
)
from rosidl_py_gen.runtime.loop.timeout_table import TimeoutTable
from rosidl_py_gen.runtime.time.values import Deadline, timeout_to_ns, with_reason
from rosidl_py_gen.runtime.transport.service_api import NoReply

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.service_api import ServerAvailability

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")


def _complete(future: asyncio.Future[ResponseT], response: ResponseT, _: bytes | None) -> None:
    if not future.done() and not future.get_loop().is_closed():
        future.set_result(response)


class Client(ServiceEndpoint[RequestT, ResponseT]):
    """Client of a service, created by `Node.create_client`."""

    def __init__(
        self,
        scope: EntityScope,
        service_type: ServiceType[RequestT, ResponseT],
        name: str,
        qos: QoSProfile,
        *,
        batch_interval_s: float | None = None,
        type_hash_check: TypeCheck | None = None,
    ) -> None:
        super().__init__(scope, service_type, name, qos, is_client=True, type_hash_check=type_hash_check)
        self._transport_client = self._open(scope.participant.create_client(self._spec))
        self._pending: dict[PendingRequest[ResponseT], Literal[True]] = {}
        """Requests without a response, in the order of their creation. A dict, because its `pop` is one operation for
        all threads."""
        self._by_sequence_number: dict[int, PendingRequest[ResponseT]] = {}
        """Pending requests that were sent, by sequence number."""
        self._timeouts: TimeoutTable[PendingRequest[ResponseT]] | None = None
        self._has_direct_callbacks = False
        """True once a request has a callback that may run code of the user; False while callbacks only complete asyncio
        futures."""
        self._window = scope.request_windows.get(self._spec.topic_keys[0], name, batch_interval_s)
        self._transport_client.set_sink(self._on_replies)
        self._loss_registration = scope.discovery.on_change.add(self._on_discovery)
        reader, writer = self._transport_client.endpoints
        scope.register(self, reader=reader, writer=writer)

    def service_is_available(self) -> bool:
        """Return True if a server is connected in both directions.

        Raises:
            IncompatibleServiceError: all servers use Fast DDS, and the installed Cyclone DDS cannot call them.
            ClosedError: the client is closed.
        """
        self._require_open()
        self._scope.discovery.refresh()
        return self._available().is_available

    def service_is_ready(self) -> bool:
        """Return `service_is_available()`; for compatibility with rclpy."""
        return self.service_is_available()

    async def wait_for_service(self, timeout_s: float | None = None) -> Literal[True]:
        """Wait until a server with matching endpoints is connected.

        Raises:
            WaitTimeoutError: no server appeared within `timeout_s`.
            IncompatibleServiceError: all servers use Fast DDS, and the installed Cyclone DDS cannot call them.
        """
        return await self._scope.wait_or_raise(self._available, timeout_s, self._missing, self, why=self._why_missing)

    wait_for_service_sync = blocking(wait_for_service)

    def _servers(self) -> set[bytes]:
        """Return the GUIDs of the reply writers of all connected servers; empty if no server can be called."""
        return set(self._transport_client.connected()) if self._transport_client.servers().is_available else set()

    def _available(self) -> ServerAvailability:
        """Return the availability of servers as an object that is false in a condition if no server can be called.

        Raises:
            IncompatibleServiceError: all servers use Fast DDS, and the installed Cyclone DDS cannot call them.
        """
        servers = self._transport_client.servers()
        if servers.incompatible_server is not None:
            raise IncompatibleServiceError(
                incompatible_peer_text(self._scope.graph, servers.incompatible_server, self.name, "the server")
            )
        return servers

    def _missing(self) -> str:
        return f"no server of {self.name} ({self.service_type}) appeared"

    def _why_missing(self, ending: str = "") -> str:
        """Return a text with the reason why no server is connected; "" if it is unknown.

        Args:
            ending: rest of the service name of an action or a parameter service, as for `UnmatchedReasons.why`.
        """
        reader, writer = self._transport_client.endpoints
        requests, replies = self._spec.topic_keys
        why = self._scope.why_unmatched(writer, requests, is_writer=True, ending=ending)
        if not why.is_known:
            why = self._scope.why_unmatched(reader, replies, is_writer=False, ending=ending)
        return why.text

    async def call(self, request: RequestT, timeout_s: float | None = None) -> ResponseT:
        """Send a request and wait for its response; any number of calls may be in flight.

        If no server is connected, the call waits for a server. `timeout_s` covers both waits; None waits forever.

        Raises:
            CallTimeoutError: a `TimeoutError`: no server or no response arrived within `timeout_s`.
            ServerLostError: all servers that received the request have left, or Zenoh reports that the server failed.
            IncompatibleServiceError: all servers use Fast DDS, and the installed Cyclone DDS cannot call them.
            EncodeError: the request does not fit its type.
            DecodeError: the response does not fit its type.
            ClosedError: the client was closed, also while waiting.
        """
        scope = self._scope
        if self._closed or scope.closed:
            self._require_open()
        timeout_ns = None if timeout_s is None else timeout_to_ns("timeout_s", timeout_s)
        left_s = None if timeout_ns is None else timeout_ns / NS_PER_S
        loop = asyncio.get_running_loop()
        if loop is not scope.loop_binding.bound_loop:
            scope.loop_binding.attach(loop)
        encoded = self._type.request.encode(request)
        servers = self._transport_client.servers()
        if not servers.is_available:
            deadline = Deadline(timeout_s)
            await scope.wait_until(self._available, timeout_s, self)
            servers, left_s = self._available(), deadline.remaining_s()
            if not servers.is_available:
                raise CallTimeoutError(with_reason(f"{self._missing()} in {timeout_s:g} s", self._why_missing()))
        future: asyncio.Future[ResponseT] = loop.create_future()
        on_error = partial(complete_threadsafe, future, None)
        pending: PendingRequest[ResponseT] = PendingRequest(encoded, partial(_complete, future), on_error, left_s)
        self._enqueue(pending, servers)
        if left_s is not None:
            if self._timeouts is None or self._timeouts.loop is not loop:
                self._timeouts = TimeoutTable(loop, self._expire)
            pending.timeouts = self._timeouts
            self._timeouts.add(pending, left_s)
        try:
            return await future
        except RequestTimedOutError:
            text = f"no response from {self.name} ({self.service_type}) in {timeout_s:g} s"
            raise CallTimeoutError(with_reason(text, self._type_hash_filter.drop_reason)) from None
        finally:
            if pending in self._pending:
                self._abandon_request(pending)

    call_sync = blocking(call)

    def send_request(self, request: RequestT) -> concurrent.futures.Future[ResponseT]:
        """Send a request to the servers that are connected now, and return at once; from any thread.

        The method does not wait for a server; use `wait_for_service` or `service_is_available`. Without a server, the
        request is lost on DDS, and retained for the first server on Zenoh.

        Returns:
            A future of the response, without time limit. It fails like `call`: with `ServerLostError`, `DecodeError`,
            `TransportError`, or `ClosedError` when the client is closed. `cancel` discards the request. The future's
            callbacks are called on the event loop, which must run, or be run by a `LoopRunner`:
            ``runner.wait(future.done, timeout_s=1.0)``. In an async function use ``await asyncio.wrap_future(future)``
            or `call`.

        Raises:
            EncodeError: the request does not fit its type.
            TypeError: the request has another type.
            ClosedError: the client is closed.
        """
        scope = self._scope
        self._require_open()
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
                scope.loop_binding.call_soon(partial(self._abandon_request, pending))

        self._has_direct_callbacks = True
        pending = PendingRequest(encoded, on_reply, on_error)
        future.add_done_callback(on_done)
        scope.loop_binding.call_in_loop(lambda: self._enqueue(pending, self._transport_client.servers()))
        return future

    def _start_request(
        self,
        request: RequestT,
        on_reply: Callable[[ResponseT, bytes | None], object],
        on_error: Callable[[Exception], object],
    ) -> PendingRequest[ResponseT]:
        """Send a request to the servers that are connected now; return the request, for `_abandon_request`.

        Thread: loop.

        Args:
            request: request message.
            on_reply: called with a response and the GUID of its reply writer; returns True to get replies of further
                servers. Thread: loop.
            on_error: called with `DecodeError`, `TransportError`, `ServerLostError`, or `ClosedError`; no other call
                follows. Thread: loop.
        """
        if self._closed or self._scope.closed:
            self._require_open()
        self._has_direct_callbacks = True
        pending = PendingRequest(self._type.request.encode(request), on_reply, on_error)
        self._enqueue(pending, self._transport_client.servers())
        return pending

    def _abandon_request(self, pending: PendingRequest[ResponseT]) -> None:
        """Discard a request, if it is still pending."""
        if not self._pending.pop(pending, False):
            return
        if pending.sequence_number:
            del self._by_sequence_number[pending.sequence_number]
            self._transport_client.cancel(pending.sequence_number)
        if pending.timeouts is not None:
            pending.timeouts.remove(pending)
        if pending.flow_number:
            self._window.release(pending.flow_number)

    def _enqueue(self, pending: PendingRequest[ResponseT], servers: ServerAvailability) -> None:
        pending.had_servers = servers.is_available or bool(self._transport_client.server_endpoints())
        self._pending[pending] = True
        if servers.request_queue_depth:
            self._window.acquire(partial(self._send_in_window, pending), servers.request_queue_depth, self)
        elif self._send_queue.waiting or not self._send(pending):
            self._send_queue.send(partial(self._send, pending))

    def _expire(self, pending: PendingRequest[ResponseT]) -> None:
        if pending in self._pending:
            self._fail(pending, RequestTimedOutError())

    def _send_in_window(self, pending: PendingRequest[ResponseT], flow_number: int) -> bool:
        if pending not in self._pending:
            return False
        # Clients that share the server's queue may have appeared since the request was enqueued.
        self._window.server_queue_depth = self._transport_client.servers().request_queue_depth or sys.maxsize
        pending.flow_number = flow_number
        if self._send_queue.waiting or not self._send(pending):
            self._send_queue.send(partial(self._send, pending))
        return True

    def _send(self, pending: PendingRequest[ResponseT]) -> bool:
        """Write a request.

        Returns False if the request must wait, because servers are slow to acknowledge earlier requests.
        """
        if pending not in self._pending:
            return True
        try:
            number = self._transport_client.send(pending.encoded, pending.timeout_s)
        except RosidlError as error:
            self._fail(pending, error)
            return True
        except BaseException:  # raised by a signal handler
            self._abandon_request(pending)
            raise
        if number is None:
            return False
        pending.sequence_number = number
        self._by_sequence_number[number] = pending
        if self._introspection is not None:
            self._introspection.publish(self._transport_client.gid, number, pending.encoded, is_sent=True)
        return True

    def _fail(self, pending: PendingRequest[ResponseT], error: Exception) -> None:
        self._abandon_request(pending)
        pending.on_error(error)

    def _on_replies(self) -> Callable[[], None] | None:
        """Read the received replies, or return a function that does so later.

        The transport calls this method when replies arrive.
        """
        if self._has_direct_callbacks:
            return self._read_all
        self._read_all()
        return None

    def _read_all(self) -> None:
        take, accepted = self._transport_client.take, self._accepted_writers
        while (reply := take()) is not None:
            number, response, server = reply
            pending = self._by_sequence_number.get(number)
            if isinstance(response, NoReply):
                if pending is not None:
                    self._fail(pending, self._lost_reason(response))
                continue
            if server not in accepted and not self._type_hash_filter.accepts(server, response):
                continue
            if self._introspection is not None:
                self._introspection.publish(self._transport_client.gid, number, response, is_sent=False)
            if pending is None:
                continue
            if pending.flow_number:
                self._window.on_response(pending.flow_number, self)
            try:
                message = self._type.response.decode(response)
            except DecodeError as error:
                self._fail(pending, error)
                continue
            if pending.on_reply(message, server) is not True and pending in self._pending:
                self._abandon_request(pending)

    def _on_discovery(self, _: object) -> None:
        if self._pending:
            self._scope.loop_binding.call_soon(self._check_lost_requests)

    def _check_lost_requests(self) -> None:
        """Read all received replies, then report an error for each request to which no server can reply any more."""
        if self._closed:
            return
        self._transport_client.report_lost_requests()
        self._read_all()
        if not self._transport_client.server_endpoints():
            for pending in list(self._pending):
                if pending.had_servers and not pending.sequence_number:
                    self._fail(pending, self._lost_reason(NoReply()))

    def _lost_reason(self, why: NoReply) -> ServerLostError:
        return ServerLostError(f"the server of {self.name} {why.reason}")

    def _described(self) -> str:
        return f"the client of {self.name}"

    def all_acknowledged(self) -> bool:
        """Return True if every server has received all requests of the client, which takes some milliseconds."""
        return self._transport_client.all_acknowledged()

    @property
    def in_flight_count(self) -> int:
        """Number of requests of the client that wait for a response, including requests that are not sent yet."""
        return len(self._pending)

    def close(self) -> None:
        """Close the client; calls in flight raise `ClosedError`. May be called twice."""
        if self._begin_close(*self._transport_client.endpoints):
            self._loss_registration.close()
            for pending in list(self._pending):
                self._fail(pending, ClosedError(f"the client of {self.name} was closed during the call"))
            self._send_queue.close()
            self._transport_client.close()
