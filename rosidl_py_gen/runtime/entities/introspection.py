"""Service introspection: publishes requests and responses on ``<service>/_service_event``.

Contents of an event: docs/internals/protocol.md 12.1. A client or server has a `ServiceEventPublisher` only while its
introspection is switched on.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.clocks import Clock
from rosidl_py_gen.runtime.entities.message_types import class_of, message_type
from rosidl_py_gen.runtime.entities.topics import Publisher
from rosidl_py_gen.runtime.transport.qos import as_profile

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.transport.api import Payload
    from rosidl_py_gen.runtime.transport.qos import QoSLike


class IntrospectionState(IntEnum):
    """Contents of the introspection events of a client or server.

    OFF publishes no events, METADATA publishes client and time of each request and response, CONTENTS also the
    messages.
    """

    OFF = 0
    METADATA = 1
    CONTENTS = 2


class ServiceEventType(IntEnum):
    """Type of an introspection event, with the numbers of service_msgs/ServiceEventInfo."""

    REQUEST_SENT = 0
    REQUEST_RECEIVED = 1
    RESPONSE_SENT = 2
    RESPONSE_RECEIVED = 3


class ServiceEventPublisher:
    """Publisher of the introspection events of one client or server."""

    def __init__(self, scope: EntityScope, service: ServiceType[Any, Any], name: str, *, is_client: bool) -> None:
        from rosidl_py_gen import get_service

        self._scope = scope
        self._cls: Any = class_of(service.ros_name, service.type_hash) or get_service(service.ros_name)
        self._topic = f"{name}/_service_event"
        self._is_client = is_client
        self._publisher: Publisher[Any] | None = None
        self._clock = scope.make_clock()
        self._state = IntrospectionState.OFF

    def configure(self, clock: Clock, qos: QoSLike, state: IntrospectionState) -> bool:
        """Switch introspection events on or off (see `ServiceEndpoint.configure_introspection`).

        Returns False if they are off now.

        Raises:
            TypeError: clock or state has another type.
            InvalidQoSError: the profile is invalid.
        """
        if not isinstance(clock, Clock):
            raise TypeError(f"clock must be a Clock such as node.clock, got {clock!r:.100}")
        if not isinstance(state, IntrospectionState):
            names = ", ".join(f"IntrospectionState.{member.name}" for member in IntrospectionState)
            raise TypeError(f"state must be one of {names}, got {state!r:.100}")
        profile = as_profile(qos)
        self._clock, self._state = clock, state
        if state is IntrospectionState.OFF:
            self.close()
        elif self._publisher is None:
            self._publisher = Publisher(self._scope, message_type(self._cls.Event), self._topic, profile)
        return self._publisher is not None

    def publish(self, client_gid: bytes, sequence_number: int, message: Payload, *, is_sent: bool) -> None:
        """Publish an event: the client or server has sent (`is_sent`) or received a request or response.

        Args:
            client_gid: 16 bytes that identify the client.
            sequence_number: sequence number of the request.
            message: serialized request or response.
            is_sent: False if the message was received.
        """
        publisher = self._publisher  # another thread may close it
        if self._scope.closed or publisher is None:
            return  # a response that is sent while the node closes must not fail
        is_request = is_sent is self._is_client
        if is_request:
            event_type = ServiceEventType.REQUEST_SENT if is_sent else ServiceEventType.REQUEST_RECEIVED
        else:
            event_type = ServiceEventType.RESPONSE_SENT if is_sent else ServiceEventType.RESPONSE_RECEIVED
        event = self._cls.Event()
        event.info.event_type = int(event_type)
        event.info.client_gid = np.frombuffer(client_gid, np.uint8)  # fits messages of both APIs
        event.info.sequence_number = sequence_number
        set_stamp(event.info.stamp, self._clock.now_ns())
        try:
            if self._state is IntrospectionState.CONTENTS:
                if is_request:
                    event.request = [self._cls.Request._decode(message)]
                else:
                    event.response = [self._cls.Response._decode(message)]
        except DecodeError:
            return  # the client or server itself counts and logs it
        publisher.publish(event)

    def close(self) -> None:
        """Close the publisher of the events; may be called twice."""
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            publisher.close()
