"""Service servers: the program passes a handler, or iterates over requests and answers each at any later time.

Plain handlers run on the event loop, async handlers as concurrent tasks. If a handler raises an exception, it is logged
and no response is sent, as in ROS: the client's call times out.

A response that is sent before the client's reply reader is matched would be lost. So the server waits for the match,
longer than rmw_cyclonedds does, because discovery is late on busy machines.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from rosidl_py_gen.errors import ClosedError, DecodeError, RosidlError
from rosidl_py_gen.runtime.entities.entity_scope import QOS_HINT, PollableEntity, user_callback
from rosidl_py_gen.runtime.entities.service_common import ServiceEndpoint, incompatible_peer_text
from rosidl_py_gen.runtime.loop.async_queue import AsyncQueue
from rosidl_py_gen.runtime.transport.service_api import IncompatiblePeer

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.api import Payload
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.service_api import RequestId

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")

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
            raise ClosedError(f"service {self._server.name} of node {self._server._scope.node_name} is closed")
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
