"""Service servers: a handler, or an async iterator of requests that are answered whenever it suits.

Decides how requests are answered: plain handlers on the event loop, async ones as tasks, many at once. A handler that
raises is logged and sends nothing, as in ROS; its client runs into its timeout.

Before a reply is sent, the client's reply reader must be connected, else the reply would be lost. It is waited for up
to 100 ms (protocol.md 5.2), that of a client on Fast DDS up to 5 s.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Generic, TypeAlias, TypeVar

from rosidl_py_gen.errors import ClosedError, DecodeError, RosidlError
from rosidl_py_gen.runtime.endpoints.header import (
    foreign_reason,
    header_of,
    message_of,
    request_gid,
    send,
)
from rosidl_py_gen.runtime.endpoints.matching import Matching
from rosidl_py_gen.runtime.endpoints.service import ServiceEnd
from rosidl_py_gen.runtime.loop.callbacks import require_callable
from rosidl_py_gen.runtime.loop.stream import Stream
from rosidl_py_gen.runtime.loop.user_function import UserFunction
from rosidl_py_gen.runtime.transport.port import identity_of
from rosidl_py_gen.signatures import require_signature

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.runtime.endpoints.header import ClientId
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import ServiceType
    from rosidl_py_gen.runtime.graph.definitions import TypeCheck
    from rosidl_py_gen.runtime.transport.port import Sample
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")

_RESPONSE_HINT = "; it makes the response itself and returns it"
_PATIENCE_S = 0.1
_FAST_DDS_PATIENCE_S = 5.0
"""Endpoints of a Fast DDS participant are known up to 1.2 s after it knows ours and calls (fastdds.md 7)."""


_Asker: TypeAlias = "tuple[ClientId, int, bytes | None, int]"
"""Whom a response goes to: the client, the number of its request, the GUID of its request writer (None when it vanished
before it was known) and the local handle of that writer.

A plain tuple, as it is made for each request.
"""


class AlreadyRespondedError(RosidlError, RuntimeError):
    """The caller answered one request twice; that of a goal or a cancel also when it is over by itself."""


class ServiceRequest(Generic[RequestT, ResponseT]):
    """One request; answer it from any task of the loop, any time later. Unanswered ones are simply forgotten."""

    __slots__ = ("_respond", "_responded", "_service", "client_id", "message")

    def __init__(
        self, service: str, message: RequestT, client_id: ClientId, respond: Callable[[ResponseT], None]
    ) -> None:
        self._service = service
        self.message = message
        self.client_id = client_id
        """By which the client knows its replies: the number of one on Cyclone DDS, the GUID of any other."""
        self._respond = respond
        self._responded = False

    def respond(self, response: ResponseT) -> None:
        """Send the response; returns at once.

        Raises:
            EncodeError: the response does not fit its type; the request stays unanswered and may be tried again.
            AlreadyRespondedError, ClosedError: as their names say.
        """
        if self._responded:
            raise AlreadyRespondedError(f"this request to {self._service} was answered already")
        self._respond(response)
        self._responded = True


class ServiceServer(ServiceEnd[RequestT, ResponseT]):
    """Made by `Node.create_service`."""

    def __init__(
        self,
        scope: Scope,
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
        super().__init__(scope, service_type, name, qos, is_client=False, type_check=type_check)
        self._handler = None if handler is None else UserFunction(scope, handler, f"the handler of service {name}")
        self._requests: Stream[ServiceRequest[RequestT, ResponseT]] = Stream()
        self._clients: Matching[tuple[ClientId, bytes | None]] = Matching(scope, lambda who: self._listens(*who))
        self._reader.set_sink(self._on_requests)
        scope.own(self, reader=self._reader.guid, writer=self._writer.guid)

    # ---------------------------------------------------------------------------------------------------- requests

    def __aiter__(self) -> ServiceServer[RequestT, ResponseT]:
        if self._handler is not None:
            raise TypeError(f"service {self.name} has a handler; its requests cannot be iterated over too")
        return self

    async def __anext__(self) -> ServiceRequest[RequestT, ResponseT]:
        if self._closed:
            raise StopAsyncIteration
        self._scope.bridge.running_loop()
        return await anext(self._requests)

    def _on_requests(self) -> Callable[[], None] | None:
        """The sink of the request reader."""
        if self._handler is not None:
            return self._read_all
        self._read_all()
        return None

    def _read_all(self) -> None:
        items = self._reader.queue.items
        while items and not self._closed:
            request = self._read(items.popleft())
            if request is None:
                continue
            if self._handler is None:
                self._requests.push(request)
            else:
                self._handler.call(request.message, then=partial(self._answer, request))

    def _read(self, sample: Sample) -> ServiceRequest[RequestT, ResponseT] | None:
        data, _, handle, _ = sample
        if handle not in self._agreeing and not self._check.admits(handle):
            return None
        writer_guid = self._reader.writer_guid(handle)
        participant = self._scope.participant
        if writer_guid is not None and participant.identifies(writer_guid) and identity_of(data) is None:
            endpoint = self._scope.graph.endpoints.get(writer_guid)
            refusal = participant.identity_refusal
            words = foreign_reason(self._scope.graph, endpoint, self.name, "a client", refusal)
            if self._throttle.passes():
                self._scope.logger.error(f"refused a request: {words}")
            return None
        try:
            client, sequence, begin = header_of(data)
            message = message_of(data, begin)
            asker = (client, sequence, writer_guid, handle)
            if self._tap is not None:
                self._tap.received(request_gid(client, handle), sequence, message)
            return ServiceRequest(self.name, self._type.request.decode(message), client, partial(self._respond, asker))
        except DecodeError as err:
            if self._throttle.passes():
                self._scope.logger.warning(
                    f"dropped a request to {self.name} that is no {self._type.request.ros_name}: {err}"
                )
            return None

    def _answer(self, request: ServiceRequest[RequestT, ResponseT], response: ResponseT) -> None:
        if not self._closed:
            request.respond(response)

    # --------------------------------------------------------------------------------------------------- responses

    def _respond(self, asker: _Asker, response: ResponseT) -> None:
        if self._closed:
            raise ClosedError(f"service {self.name} of node {self._scope.node_name} is closed")
        data = self._type.response.encode(response)
        if self._clients.is_complete((asker[0], asker[2])):
            if self._outbox.waiting or not self._send(asker, data):
                self._outbox.send(partial(self._send, asker, data))
        else:
            self._scope.start(self._send_later(asker, data))

    def _send(self, asker: _Asker, data: bytes) -> bool:
        client, sequence, _, handle = asker
        sent = send(self._writer, data, client, sequence)
        if sent and self._tap is not None:
            self._tap.sent(request_gid(client, handle), sequence, data)
        return sent

    def _listens(self, client: ClientId, writer_guid: bytes | None) -> bool:
        """Whether a client's reply reader is connected, or it does not say which one that is.

        Source: protocol.md 5.2 and 5.3.
        """
        if isinstance(client, bytes):
            return self._writer.reaches(client)
        endpoints = self._scope.graph.endpoints
        known = None if writer_guid is None else endpoints.get(writer_guid)
        if known is None or not known.service_id:
            return True
        matched = (endpoints.get(guid) for guid in self._writer.matched_readers())
        return any(reader is not None and reader.service_id == known.service_id for reader in matched)

    async def _send_later(self, asker: _Asker, data: bytes) -> None:
        client, _, writer_guid, _ = asker
        patience_s = _FAST_DDS_PATIENCE_S if isinstance(client, bytes) else _PATIENCE_S
        try:
            is_there = await self._clients.ready((client, writer_guid), patience_s, lambda: self._closed)
        except ClosedError:
            return
        if is_there:
            self._outbox.send(partial(self._send, asker, data))
        else:
            self._scope.logger.warning(f"a response of {self.name} was lost: its client's reader never appeared")

    # ------------------------------------------------------------------------------------------------------- state

    def matched_clients(self) -> list[bytes]:
        """The GUIDs of the writers whose requests arrive."""
        return self._reader.matched_writers()

    def close(self) -> None:
        """Stop serving; an iterator ends, running handlers are not interrupted but cannot answer. May be called
        twice.
        """
        if self._ends(self._reader.guid, self._writer.guid):
            self._requests.close()
            if self._handler is not None:
                self._handler.close()
            self._outbox.close()
            self._reader.close()
            self._writer.close()
