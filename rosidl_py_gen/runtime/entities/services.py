"""Service clients and servers, and their common base: names, endpoints, QoS profile, introspection, errors.

The method `_enqueue` of a client sends a request; `call` and `send_request` are based on it. Each request ends with a
reply, a timeout, a cancellation, `close`, or the loss of the last server that received the request: a server that
starts later does not have the request. How a reply is assigned to its request depends on the transport.

The program passes a handler to a server, or iterates over requests and answers each at any later time. Plain handlers
run on the event loop, async handlers as concurrent tasks. If a handler raises an exception, it is logged and no
response is sent, as in ROS: the client's call times out.

A response that is sent before the client's reply reader is matched would be lost. So the server waits for the match,
longer than rmw_cyclonedds does, because discovery is late on busy machines.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import sys
from functools import partial
from typing import TYPE_CHECKING, Generic, Literal, NamedTuple, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import blocking, complete_threadsafe
from rosidl_py_gen.errors import ClosedError, DecodeError, RosidlError
from rosidl_py_gen.runtime.entities.entity_scope import (
    QOS_HINT,
    Entity,
    PollableEntity,
    Throttle,
    entity_repr,
    user_callback,
)
from rosidl_py_gen.runtime.entities.message_types import TypeHashFilter
from rosidl_py_gen.runtime.graph import checked_mode, type_hashes_differ
from rosidl_py_gen.runtime.loop.queues import AsyncQueue, SendQueue
from rosidl_py_gen.runtime.time_values import Deadline, timeout_to_ns, with_reason
from rosidl_py_gen.runtime.transport.api import IncompatiblePeer, NoReply, ServiceSpec, TransportClient, TransportServer
from rosidl_py_gen.runtime.transport.flow_control import PendingRequest, RequestTimedOutError, TimeoutTable
from rosidl_py_gen.runtime.transport.qos import without_best_available

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.runtime.clocks import Clock
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.introspection import IntrospectionState, ServiceEventPublisher
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.graph import Graph, TypeCheck
    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, Payload, RequestId, ServerAvailability
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")
TransportEndT = TypeVar("TransportEndT", TransportClient, TransportServer)


class IncompatibleServiceError(RosidlError):
    """Raised if a peer of a service uses an unsupported wire format; client or server must change its middleware."""


class ServerLostError(RosidlError, ConnectionError):
    """Raised if a server left before it replied, or reported an error; it may or may not have handled the request.

    The loss of a killed server is detected when its lease expires: on DDS after 10 s, on Fast DDS after 20 s.
    """


class CallTimeoutError(RosidlError, TimeoutError):
    """Raised if no response arrived in time; the server may or may not have handled the request."""


class ServiceEndpoint(Entity, Generic[RequestT, ResponseT]):
    """Base of service clients and servers.

    Subclasses own the `TransportClient` or `TransportServer` and the function that takes received data (the sink), and
    implement `close`.
    """

    def __init__(
        self,
        scope: EntityScope,
        service_type: ServiceType[RequestT, ResponseT],
        name: str,
        qos: QoSProfile,
        *,
        is_client: bool,
        type_hash_check: TypeCheck | None = None,
    ) -> None:
        self._mode = checked_mode(type_hash_check, scope.type_hash_check)
        super().__init__(scope)
        self.name: str = name
        """Fully qualified name of the service, after expansion and remapping."""
        self.service_type: str = service_type.ros_name
        """Name of the service type: ``pkg/srv/Name``."""
        self.qos: QoSProfile = service_endpoint_qos(qos)
        """QoS profile in use; its history is always keep-all."""
        self._type = service_type
        self._is_client = is_client
        self._throttle = Throttle(scope.clocks)
        self._introspection: ServiceEventPublisher | None = None
        self._send_queue = SendQueue(scope.loop_binding, None, scope.report_failure)
        request, response = service_type.request, service_type.response
        read, written = (response, request) if is_client else (request, response)
        self._written_hash = written.type_hash
        self._type_hash_filter: TypeHashFilter[bytes | None] = TypeHashFilter(
            scope, self._mode, lambda guid: guid, read, name, service_type.type_hash
        )
        self._accepted_writers = self._type_hash_filter.accepted_writers
        self._spec = ServiceSpec(
            name,
            self.service_type,
            service_type.type_hash,
            request.type_hash,
            response.type_hash,
            self.qos,
            scope.number,
            self._is_compatible,
        )

    def _open(self, transport_end: TransportEndT) -> TransportEndT:
        self._transport_end: TransportClient | TransportServer = transport_end
        self._connected = transport_end.connected
        if transport_end.matches_by_hash:
            self._type_hash_filter.disable()
        reader, writer = transport_end.endpoints
        self._scope.set_type_hash_check(self._mode, reader, self._type_hash_filter.remember)
        self._scope.set_type_hash_check(self._mode, writer)
        return transport_end

    def _is_compatible(self, endpoint: DiscoveredEndpoint) -> bool:
        if endpoint.is_writer:
            return self._type_hash_filter.is_compatible(endpoint)
        own_hashes = self._written_hash, self._type_hash_filter.service_hash
        return self._mode in ("warn", "off") or not type_hashes_differ(endpoint, *own_hashes)

    @property
    def srv_name(self) -> str:
        """Service name, equal to `name`; for compatibility with rclpy."""
        return self.name

    @property
    def incompatible_dropped(self) -> int:
        """Number of requests or responses dropped because the peer has another definition of the type."""
        return self._type_hash_filter.incompatible_dropped

    def configure_introspection(self, clock: Clock, qos: QoSLike, state: IntrospectionState) -> None:
        """Start to publish requests and responses on ``<service>/_service_event``, or stop it.

        Args:
            clock: stamps the events; usually the node's clock.
            qos: profile of the publisher; used when introspection was OFF before.
            state: contents of the events; OFF stops publishing.

        Raises:
            TypeError: clock or state has another type; nothing is changed.
            InvalidQoSError: the profile is invalid; nothing is changed.
            ClosedError: the entity is closed.
        """
        self._require_open()
        from rosidl_py_gen.runtime.entities.introspection import ServiceEventPublisher

        publisher = self._introspection
        if publisher is None:
            publisher = ServiceEventPublisher(self._scope, self._type, self.name, is_client=self._is_client)
        self._introspection = publisher if publisher.configure(clock, qos, state) else None
        self._transport_end.is_introspected = self._introspection is not None

    def __repr__(self) -> str:
        details, peer = (self.name, self.service_type, self.qos.short()), "server" if self._is_client else "client"
        return entity_repr(self, *details, peers=lambda: len(self._connected()), peer=peer)

    def _begin_close(self, *guids: bytes) -> bool:
        is_first = super()._begin_close(*guids)
        if is_first and self._introspection is not None:
            self._introspection.close()
        return is_first


def service_endpoint_qos(qos: QoSProfile) -> QoSProfile:
    """Return the QoS profile for the endpoints of a service: the requested profile, but with history keep-all.

    If a queue overwrote a request or response, its call would never return. History does not affect matching, so peers
    with keep-last 10, the default of ROS, match anyway.
    """
    return without_best_available(qos).keep_all()


def incompatible_peer_text(graph: Graph, peer: IncompatiblePeer, service: str, role: str) -> str:
    """Return the error text about a peer of a service that cannot be called or served."""
    endpoint = graph.endpoints.get(peer.guid)
    node = "a node" if endpoint is None else graph.describe_node(endpoint)
    if not peer.has_topics:
        return f"{role} of service {service} is {node} on Fast DDS, and {peer.reason}"
    return (
        f"{role} of service {service} is {node} on Fast DDS. Topics work with it, services do not here: "
        f"{peer.reason}. "
        "Another version of Cyclone DDS's library (libddsc) may support them: set ROSIDL_LIBDDSC to its path; or start "
        "that node with RMW_IMPLEMENTATION=rmw_cyclonedds_cpp"
    )


def _complete(future: asyncio.Future[ResponseT], response: ResponseT, _: bytes | None) -> None:
    if not future.done() and not future.get_loop().is_closed():
        future.set_result(response)


# -------------------------------------------------------------------------------------------------------------- clients


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
        if left_s is not None and pending in self._pending:
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


# -------------------------------------------------------------------------------------------------------------- servers

_RESPONSE_HINT = "; it makes the response itself and returns it"
_CLIENT_MATCH_TIMEOUT_S = 5.0
"""Maximum time in seconds to wait for the match with a client's reply reader before the response is dropped.

Endpoints of a Fast DDS participant are discovered up to 1.2 s after it has discovered the server and calls it
(docs/internals/dds.md 6). rmw_cyclonedds waits 0.1 s (docs/internals/protocol.md 5.2).
"""
_CLIENT_MATCH_POLL_INTERVAL_S = 0.01
"""Interval in seconds of the checks for the match with a client's reply reader; DDS reports no event of the match."""


class AlreadyRespondedError(RosidlError, RuntimeError):
    """Raised if a request was answered already.

    A goal or cancel request may also have ended without a decision of the program.
    """


class RequestInfo(NamedTuple):
    """Times and origin of a service request.

    Attributes:
        source_timestamp_ns: time of sending, by the client's clock, ns since the epoch.
        received_timestamp_ns: time when this process took the request from the transport, ns since the epoch.
        client_gid: 16 bytes that identify the client, as in introspection events.
        sequence_number: sequence number that the client assigned.
    """

    source_timestamp_ns: int
    received_timestamp_ns: int
    client_gid: bytes
    sequence_number: int


class ServiceRequest(Generic[RequestT, ResponseT]):
    """Request that a server has received; it may be answered from any thread, at any later time, or not at all."""

    __slots__ = ("_origin", "_responded", "_server", "_times_ns", "message")

    def __init__(
        self,
        server: ServiceServer[RequestT, ResponseT],
        origin: RequestId,
        message: RequestT,
        times_ns: tuple[int, int],
    ) -> None:
        self._server = server
        self._origin = origin
        self._times_ns = times_ns
        self.message: RequestT = message
        """Request message."""
        self._responded = False

    @property
    def info(self) -> RequestInfo:
        """Times, client and sequence number of the request."""
        return RequestInfo(*self._times_ns, *self._server._transport_server.request_origin(self._origin))

    def respond(self, response: ResponseT) -> None:
        """Send the response to the client; return at once.

        Raises:
            EncodeError: the response does not fit its type; another response may be sent.
            AlreadyRespondedError: the request was answered before.
            ClosedError: the server is closed.
        """
        if self._responded:
            raise AlreadyRespondedError(f"this request to {self._server.name} was answered already")
        if not self._server._respond(self._origin, response):
            raise self._server._closed_error()
        self._responded = True


class ServiceServer(PollableEntity, ServiceEndpoint[RequestT, ResponseT]):
    """Server of a service, created by `Node.create_service`."""

    _contents = "requests"

    def __init__(
        self,
        scope: EntityScope,
        service_type: ServiceType[RequestT, ResponseT],
        name: str,
        handler: Callable[[RequestT], ResponseT | Awaitable[ResponseT]] | None,
        qos: QoSProfile,
        *,
        type_hash_check: TypeCheck | None = None,
    ) -> None:
        subject = f"the handler of service {name}"
        callback = user_callback(scope, handler, subject, "the request", hint=_RESPONSE_HINT, type_hint=QOS_HINT)
        super().__init__(scope, service_type, name, qos, is_client=False, type_hash_check=type_hash_check)
        self._callback = callback
        self._requests: AsyncQueue[ServiceRequest[RequestT, ResponseT]] = AsyncQueue()
        self._transport_server = self._open(scope.participant.create_server(self._spec))
        self._transport_server.set_sink(self._on_requests)
        reader, writer = self._transport_server.endpoints
        scope.register(self, reader=reader, writer=writer)

    def __aiter__(self) -> ServiceServer[RequestT, ResponseT]:
        self._require_no_callback()
        return self

    async def __anext__(self) -> ServiceRequest[RequestT, ResponseT]:
        if self._closed:
            raise StopAsyncIteration
        self._scope.loop_binding.running_loop()
        return await anext(self._requests)

    def take(self) -> ServiceRequest[RequestT, ResponseT] | None:
        """Return the oldest request, or None, without waiting; from any thread.

        Requests are received on the event loop, which must run, or be run by a `LoopRunner` that waits.

        Raises:
            CallbackInUseError: the service has a handler.
            ClosedError: the service or its node is closed.
        """
        self._require_takeable()
        return self._requests.take()

    def _described(self) -> str:
        return f"service {self.name}"

    def _is_ready(self) -> bool:
        return self._requests.waiting > 0

    def _on_requests(self) -> Callable[[], None] | None:
        """Read the received requests, or return a function that handles them.

        The transport calls this method when requests arrive.
        """
        if self._callback is not None:
            return self._read_all
        self._read_all()
        return self._on_arrival if self._requests.waiting else None

    def _read_all(self) -> None:
        take, callback = self._transport_server.take, self._callback
        while not self._closed and (received := take()) is not None:
            origin, data, client, source_ns, received_ns = received
            message = self._decode_request(origin, data, client)
            if message is None:
                continue
            if callback is None:
                self._requests._push(ServiceRequest(self, origin, message, (source_ns, received_ns)))
            else:
                callback.call(message, on_result=partial(self._respond, origin))

    def _decode_request(
        self, origin: RequestId, data: Payload | IncompatiblePeer | DecodeError, client: bytes | None
    ) -> RequestT | None:
        if isinstance(data, IncompatiblePeer):
            if self._throttle.allows():
                text = incompatible_peer_text(self._scope.graph, data, self.name, "a client")
                self._scope.logger.error(f"refused a request: {text}")
            return None
        try:
            if isinstance(data, DecodeError):
                raise data
            if client not in self._accepted_writers and not self._type_hash_filter.accepts(client, data):
                return None
            if self._introspection is not None:
                self._introspection.publish(*self._transport_server.request_origin(origin), data, is_sent=False)
            return self._type.request.decode(data)
        except DecodeError as err:
            if self._throttle.allows():
                self._scope.logger.warning(
                    f"dropped a request to {self.name} that is not a {self._type.request.ros_name}: {err}"
                )
            return None

    def _respond(self, origin: RequestId, response: ResponseT) -> bool:
        """Send a response, later if the transport is busy or the client is not reachable yet.

        Returns False if the server is closed.
        """
        if self._closed:
            return False
        data = self._type.response.encode(response)
        if self._transport_server.can_reach_client(origin):
            if self._send_queue.waiting or not self._send(origin, data):
                self._send_queue.send(partial(self._send, origin, data))
        elif self._scope.loop_binding.loop is None or self._scope.loop_binding.in_loop_thread():
            self._wait_and_send(origin, data)
        else:
            self._scope.loop_binding.call_soon(lambda: self._wait_and_send(origin, data))
        return True

    def _closed_error(self) -> ClosedError:
        return ClosedError(f"{self._described()} of node {self._scope.node_name} is closed")

    def _send(self, origin: RequestId, data: bytes) -> bool:
        is_sent = self._transport_server.send(origin, data)
        if is_sent and self._introspection is not None:
            self._introspection.publish(*self._transport_server.request_origin(origin), data, is_sent=True)
        return is_sent

    def _wait_and_send(self, origin: RequestId, data: bytes) -> None:
        if not self._closed:
            self._scope.create_task(self._send_later(origin, data))

    async def _send_later(self, origin: RequestId, data: bytes) -> None:
        can_reach = partial(self._transport_server.can_reach_client, origin)
        try:
            is_reachable = await self._scope.wait_until(
                can_reach, _CLIENT_MATCH_TIMEOUT_S, self, poll_s=_CLIENT_MATCH_POLL_INTERVAL_S
            )
        except ClosedError:
            return
        if is_reachable:
            self._send_queue.send(partial(self._send, origin, data))
        elif self._throttle.allows():
            self._scope.logger.warning(f"dropped a response of {self.name}: its client's reader never appeared")

    def matched_clients(self) -> list[bytes]:
        """Return the GUIDs of the matched clients' request writers."""
        return self._transport_server.connected()

    def close(self) -> None:
        """Close the server: iterators end, running handlers continue, but no response is sent. May be called twice."""
        self._transport_server.release()
        self._send_queue.flush()
        if self._begin_close(*self._transport_server.endpoints):
            self._requests.close()
            if self._callback is not None:
                self._callback.close()
            self._send_queue.close()
            self._transport_server.close()
