"""Service servers: a handler, or an async iterator of requests that are answered whenever it suits.

Decides how requests are answered: plain handlers on the event loop, async ones as tasks, many at once. A handler that
raises is logged and sends nothing, as in ROS; its client runs into its timeout.

Before a response is sent, what its client reads must be connected, else it would be lost: that is waited for, longer
than rmw_cyclonedds does, as discovery is late on busy machines.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Generic, NamedTuple, TypeVar

from rosidl_py_gen.base.signatures import require_signature
from rosidl_py_gen.errors import ClosedError, DecodeError, RosidlError
from rosidl_py_gen.runtime.entities.pollable import CallbackInUseError, PollableEntity
from rosidl_py_gen.runtime.entities.service import ServiceEndpoint
from rosidl_py_gen.runtime.entities.service_common import incompatible_peer_text
from rosidl_py_gen.runtime.loop.async_queue import AsyncQueue
from rosidl_py_gen.runtime.loop.callable_checks import require_callable
from rosidl_py_gen.runtime.loop.user_callback import UserCallback
from rosidl_py_gen.runtime.transport.service_api import IncompatiblePeer

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.samples import Payload
    from rosidl_py_gen.runtime.transport.service_api import RequestId

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")

_RESPONSE_HINT = "; it makes the response itself and returns it"
_PATIENCE_S = 5.0
"""So long a response waits for its client's reader. Endpoints of a Fast DDS participant are known up to 1.2 s after it
knows ours and calls (docs/internals/dds.md 6). rmw_cyclonedds waits 0.1 s (docs/internals/protocol.md 5.2).
"""
_POLL_S = 0.01
"""Between two looks whether a client's reader is connected, which nothing announces."""


class AlreadyRespondedError(RosidlError, RuntimeError):
    """The caller answered one request twice; that of a goal or a cancel also when it is over by itself."""


class RequestInfo(NamedTuple):
    """Where and when a request came from.

    Attributes:
        source_timestamp_ns: when it was sent, by the client's clock, ns since the epoch.
        received_timestamp_ns: when this process took it from the transport, ns since the epoch.
        client_gid: 16 bytes by which the client is known, as introspection shows them.
        sequence_number: that of the request, by the client's count.
    """

    source_timestamp_ns: int
    received_timestamp_ns: int
    client_gid: bytes
    sequence_number: int


class ServiceRequest(Generic[RequestT, ResponseT]):
    """One request; answer it from any thread, any time later. Unanswered ones are simply forgotten."""

    __slots__ = ("_asker", "_responded", "_server", "_times_ns", "message")

    def __init__(
        self,
        server: ServiceServer[RequestT, ResponseT],
        origin: RequestId,
        message: RequestT,
        times_ns: tuple[int, int],
    ) -> None:
        self._server = server
        self._asker = origin
        self._times_ns = times_ns
        self.message = message
        """The request."""
        self._responded = False

    @property
    def info(self) -> RequestInfo:
        """Its number, its times, and whose it is."""
        return RequestInfo(*self._times_ns, *self._server._asked_by(self._asker))

    def respond(self, response: ResponseT) -> None:
        """Send the response; returns at once.

        Raises:
            EncodeError: the response does not fit its type; the request stays unanswered and may be tried again.
            AlreadyRespondedError, ClosedError: as their names say.
        """
        if self._responded:
            raise AlreadyRespondedError(f"this request to {self._server.name} was answered already")
        self._server._respond(self._asker, response)
        self._responded = True


class ServiceServer(PollableEntity, ServiceEndpoint[RequestT, ResponseT]):
    """Made by `Node.create_service`."""

    def __init__(
        self,
        scope: EntityScope,
        service_type: ServiceType[RequestT, ResponseT],
        name: str,
        handler: Callable[[RequestT], ResponseT | Awaitable[ResponseT]] | None,
        qos: QoSProfile,
        *,
        type_check: TypeCheck | None = None,
    ) -> None:
        require_callable(handler, f"the handler of service {name}", "; QoS is given as qos=...")
        if handler is not None:
            require_signature(handler, f"the handler of service {name}", "the request", hint=_RESPONSE_HINT)
        super().__init__(scope, service_type, name, qos, is_client=False, type_hash_check=type_check)
        self._handler = None if handler is None else UserCallback(scope, handler, f"the handler of service {name}")
        self._requests: AsyncQueue[ServiceRequest[RequestT, ResponseT]] = AsyncQueue()
        self._port = self._open(scope.participant.create_server(self._spec, self.qos, node=scope.number))
        self._port.set_sink(self._on_requests)
        reader, writer = self._port.endpoints
        scope.register(self, reader=reader, writer=writer)

    # ---------------------------------------------------------------------------------------------------- requests

    def __aiter__(self) -> ServiceServer[RequestT, ResponseT]:
        self._require_no_handler()
        return self

    async def __anext__(self) -> ServiceRequest[RequestT, ResponseT]:
        if self._closed:
            raise StopAsyncIteration
        self._scope.bridge.running_loop()
        return await anext(self._requests)

    def take(self) -> ServiceRequest[RequestT, ResponseT] | None:
        """The next request, oldest first, without waiting; None when there is none. From any thread.

        Requests are taken in by the event loop: one that runs, or that of a `Driver` while somebody waits.

        Raises:
            CallbackInUseError: the service has a handler. ClosedError: it, or its node, is closed.
        """
        self._require_takeable()
        return self._requests.take()

    def _require_no_handler(self) -> None:
        if self._handler is not None:
            raise CallbackInUseError(f"{self._described()} has a handler; its requests cannot be received too")

    def _require_takeable(self) -> None:
        self._require_no_handler()
        self._scope.require_open(self._closed, self._described())

    def _described(self) -> str:
        return f"service {self.name}"

    def _is_ready(self) -> bool:
        return self._requests.waiting > 0

    def _on_requests(self) -> Callable[[], None] | None:
        """The sink of the request reader."""
        if self._handler is not None:
            return self._read_all
        self._read_all()
        return self._tell if self._requests.waiting else None

    def _read_all(self) -> None:
        take = self._port.take
        while not self._closed and (arrived := take()) is not None:
            request = self._read(*arrived)
            if request is None:
                continue
            if self._handler is None:
                self._requests._push(request)
            else:
                self._handler.call(request.message, on_result=partial(self._answer, request))

    def _read(
        self,
        origin: RequestId,
        data: Payload | IncompatiblePeer | DecodeError,
        client: bytes | None,
        source_ns: int,
        received_ns: int,
    ) -> ServiceRequest[RequestT, ResponseT] | None:
        if client not in self._agreeing and not self._check.accepts(client):
            return None
        if isinstance(data, IncompatiblePeer):
            if self._throttle.allows():
                words = incompatible_peer_text(self._scope.graph, data, self.name, "a client")
                self._scope.logger.error(f"refused a request: {words}")
            return None
        try:
            if isinstance(data, DecodeError):
                raise data
            if self._tap is not None:
                self._tap.received(*self._port.request_origin(origin), data)
            return ServiceRequest(self, origin, self._type.request.decode(data), (source_ns, received_ns))
        except DecodeError as err:
            if self._throttle.allows():
                self._scope.logger.warning(
                    f"dropped a request to {self.name} that is no {self._type.request.ros_name}: {err}"
                )
            return None

    def _answer(self, request: ServiceRequest[RequestT, ResponseT], response: ResponseT) -> None:
        if not self._closed:
            request.respond(response)

    # --------------------------------------------------------------------------------------------------- responses

    def _respond(self, origin: RequestId, response: ResponseT) -> None:
        if self._closed:
            raise ClosedError(f"service {self.name} of node {self._scope.node_name} is closed")
        data = self._type.response.encode(response)
        if self._port.can_reach_client(origin):
            if self._outbox.waiting or not self._send(origin, data):
                self._outbox.send(partial(self._send, origin, data))
        elif self._scope.bridge.loop is None or self._scope.bridge.in_loop_thread():
            self._wait_and_send(origin, data)
        else:
            self._scope.bridge.call_soon(lambda: self._wait_and_send(origin, data))

    def _asked_by(self, origin: RequestId) -> tuple[bytes, int]:
        return self._port.request_origin(origin)

    def _send(self, origin: RequestId, data: bytes) -> bool:
        sent = self._port.send(origin, data)
        if sent and self._tap is not None:
            self._tap.sent(*self._port.request_origin(origin), data)
        return sent

    def _wait_and_send(self, origin: RequestId, data: bytes) -> None:
        if not self._closed:
            self._scope.create_task(self._send_later(origin, data))

    async def _send_later(self, origin: RequestId, data: bytes) -> None:
        hears = partial(self._port.can_reach_client, origin)
        try:
            is_there = await self._scope.wait_until(hears, _PATIENCE_S, lambda: self._closed, poll_s=_POLL_S)
        except ClosedError:
            return
        if is_there:
            self._outbox.send(partial(self._send, origin, data))
        else:
            self._scope.logger.warning(f"a response of {self.name} was lost: its client's reader never appeared")

    # ------------------------------------------------------------------------------------------------------- state

    def matched_clients(self) -> list[bytes]:
        """The GUIDs of the writers whose requests arrive."""
        return self._port.connected()

    def close(self) -> None:
        """Stop serving; an iterator ends, running handlers are not interrupted but cannot answer. May be called
        twice.
        """
        self._port.release()
        self._outbox.flush()
        if self._begin_close(*self._port.endpoints):
            self._requests.close()
            if self._handler is not None:
                self._handler.close()
            self._outbox.close()
            self._port.close()
