"""Service introspection: what passes a client or a server, published on ``<service>/_service_event``.

Decides what an event says (protocol.md 12.1). It listens at the endpoint's reader and writer, where the header is still
to be seen, so that services without introspection pay nothing for it. `introspect` installs it; calling it again
changes the state, and OFF removes it.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.endpoints.header import split_header
from rosidl_py_gen.runtime.endpoints.publisher import Publisher
from rosidl_py_gen.runtime.endpoints.types import class_of, message_type
from rosidl_py_gen.runtime.time.clock import Clock
from rosidl_py_gen.runtime.transport.interface import identified
from rosidl_py_gen.runtime.transport.qos import SYSTEM_DEFAULT, as_profile

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime.endpoints.client import Client
    from rosidl_py_gen.runtime.endpoints.header import ClientId
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.server import ServiceServer
    from rosidl_py_gen.runtime.transport.interface import Identity, Payload, Sink, Writer
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile

_MASK = 2**64 - 1


class IntrospectionState(IntEnum):
    """How much is published."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2


class ServiceEventType(IntEnum):
    """Numbers of service_msgs/ServiceEventInfo."""

    REQUEST_SENT = 0
    REQUEST_RECEIVED = 1
    RESPONSE_SENT = 2
    RESPONSE_RECEIVED = 3


def introspect(
    endpoint: Client[Any, Any] | ServiceServer[Any, Any],
    clock: Clock,
    state: IntrospectionState,
    qos: QoSLike = SYSTEM_DEFAULT,
) -> None:
    """Publish what passes a client or server; `qos` counts when introspection goes from OFF to something else.

    Raises:
        TypeError: no clock, no state. InvalidQoSError. Nothing is changed then.
    """
    if not isinstance(clock, Clock):
        raise TypeError(f"clock must be a Clock such as node.clock, got {clock!r:.100}")
    if not isinstance(state, IntrospectionState):
        names = ", ".join(f"IntrospectionState.{known.name}" for known in IntrospectionState)
        raise TypeError(f"state must be one of {names}, got {state!r:.100}")
    profile = as_profile(qos)
    tap: _Tap | None = getattr(endpoint, "_introspection", None)
    if state is IntrospectionState.OFF:
        if tap is not None:
            tap.close()
            endpoint._introspection = None
    elif tap is not None:
        tap.state = state
        tap.clock = clock
    else:
        endpoint._introspection = _Tap(endpoint, clock, state, profile)


class _Tap:
    """Sits between an endpoint and its reader and writer."""

    def __init__(
        self,
        endpoint: Client[Any, Any] | ServiceServer[Any, Any],
        clock: Clock,
        state: IntrospectionState,
        qos: QoSProfile,
    ) -> None:
        from rosidl_py_gen import get_service

        self.state = state
        self.clock = clock
        self._endpoint = endpoint
        self._scope: Scope = endpoint._scope
        # Clients and servers import this file, so they are told apart by what they have.
        self._is_client = hasattr(endpoint, "_on_replies")
        service: Any = class_of(endpoint.service_type, endpoint._type.type_hash) or get_service(endpoint.service_type)
        self._event, self._request, self._response = service.Event, service.Request, service.Response
        self._publisher: Publisher[Any] = Publisher(
            self._scope, message_type(service.Event), f"{endpoint.name}/_service_event", qos
        )
        self._scope.own(self._publisher)
        self._reader, self._writer = endpoint._reader, endpoint._writer
        self._sink: Sink = getattr(endpoint, "_on_replies" if self._is_client else "_on_requests")
        self._client_gid = self._own_gid() if self._is_client else b""
        self._handles: dict[tuple[ClientId, int], int] = {}
        endpoint._writer = _TappedWriter(self._writer, self)
        self._reader.set_sink(self._arrived)

    def _own_gid(self) -> bytes:
        """The client id of protocol.md 5.2, which rmw_get_gid_for_client gives."""
        self._scope.discovery.refresh()
        endpoint = self._scope.graph.endpoints.get(self._writer.guid)
        text = endpoint.user_data.get("clientid", "") if endpoint is not None else ""
        return bytes(int(part, 16) for part in text.split(".")) if text else bytes(16)

    def _arrived(self) -> None:
        for data, _, handle, _ in list(self._reader.queue.items):
            self._note_arrival(data, handle)
        self._sink()

    def _note_arrival(self, data: Payload, handle: int) -> None:
        try:
            client, sequence, message = split_header(data)
            if not self._is_client:
                self._handles[client, sequence] = handle
                gid = self._server_gid(client, handle)
                self._publish(ServiceEventType.REQUEST_RECEIVED, gid, sequence, message, self._request)
            elif client in (self._writer.handle, self._reader.guid, self._writer.guid):
                self._publish(ServiceEventType.RESPONSE_RECEIVED, self._client_gid, sequence, message, self._response)
        except DecodeError:
            return  # The endpoint itself will count and log it.

    def sent(self, data: Payload) -> None:
        """The endpoint has written."""
        client, sequence, message = split_header(data)
        if self._is_client:
            self._publish(ServiceEventType.REQUEST_SENT, self._client_gid, sequence, message, self._request)
        else:
            gid = self._server_gid(client, self._handles.pop((client, sequence), 0))
            self._publish(ServiceEventType.RESPONSE_SENT, gid, sequence, message, self._response)

    @staticmethod
    def _server_gid(client: ClientId, handle: int) -> bytes:
        """The request id's writer guid: of a client on Cyclone its number and the handle of its request writer."""
        if isinstance(client, bytes):
            return client
        return (client & _MASK).to_bytes(8, "little") + (handle & _MASK).to_bytes(8, "little")

    def _publish(self, kind: ServiceEventType, gid: bytes, sequence: int, data: bytes, cls: type[Message]) -> None:
        if self._scope.closed:
            return  # The node is going; a last response must not fail because of us.
        event = self._event()
        event.info.event_type = int(kind)
        event.info.client_gid = gid
        event.info.sequence_number = sequence
        event.info.stamp.sec, event.info.stamp.nanosec = divmod(self.clock.now_ns(), 1_000_000_000)
        if self.state is IntrospectionState.CONTENTS:
            setattr(event, "request" if cls is self._request else "response", [cls._decode(data)])
        self._publisher.publish(event)

    def close(self) -> None:
        """Take the endpoint's reader and writer back."""
        self._endpoint._writer = self._writer
        self._reader.set_sink(self._sink)
        self._publisher.close()


class _TappedWriter:
    """A writer that tells the tap what was sent."""

    def __init__(self, writer: Writer, tap: _Tap) -> None:
        self._writer = writer
        self._tap = tap

    @property
    def guid(self) -> bytes:
        """See `transport.Writer`."""
        return self._writer.guid

    @property
    def handle(self) -> int:
        """See `transport.Writer`."""
        return self._writer.handle

    def write(self, data: Payload, identity: Identity | None = None) -> bool:
        """See `transport.Writer`."""
        written = self._writer.write(data, identity)
        if written:
            self._tap.sent(data if identity is None else identified(data, identity))
        return written

    def matched_readers(self) -> list[bytes]:
        """See `transport.Writer`."""
        return self._writer.matched_readers()

    def has_readers(self) -> bool:
        """See `transport.Writer`."""
        return self._writer.has_readers()

    def all_acknowledged(self) -> bool:
        """See `transport.Writer`."""
        return self._writer.all_acknowledged()

    def assert_liveliness(self) -> None:
        """See `transport.Writer`."""
        self._writer.assert_liveliness()

    def close(self) -> None:
        """See `transport.Writer`."""
        self._writer.close()
