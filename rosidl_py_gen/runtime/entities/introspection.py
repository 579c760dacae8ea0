"""Service introspection: what passes a client or a server, published on ``<service>/_service_event``.

Decides what an event says (docs/internals/protocol.md 12.1). Clients and servers report to a `ServiceEventPublisher`
while they have one, so that services without introspection pay nothing for it.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.entities.message_types import class_of, message_type
from rosidl_py_gen.runtime.entities.publisher import Publisher
from rosidl_py_gen.runtime.entities.service_common import IntrospectionState
from rosidl_py_gen.runtime.time.clock import Clock
from rosidl_py_gen.runtime.transport.qos import as_profile

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.transport.qos import QoSLike
    from rosidl_py_gen.runtime.transport.samples import Payload


class ServiceEventType(IntEnum):
    """Numbers of service_msgs/ServiceEventInfo."""

    REQUEST_SENT = 0
    REQUEST_RECEIVED = 1
    RESPONSE_SENT = 2
    RESPONSE_RECEIVED = 3


class ServiceEventPublisher:
    """Publisher of the events of one client or server."""

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
        """Publish so from now on; `qos` counts when the state was OFF before. Whether there is anything to publish.

        Raises:
            TypeError: no clock, no state. InvalidQoSError. Nothing is changed then.
        """
        if not isinstance(clock, Clock):
            raise TypeError(f"clock must be a Clock such as node.clock, got {clock!r:.100}")
        if not isinstance(state, IntrospectionState):
            names = ", ".join(f"IntrospectionState.{known.name}" for known in IntrospectionState)
            raise TypeError(f"state must be one of {names}, got {state!r:.100}")
        profile = as_profile(qos)
        self._clock, self._state = clock, state
        if state is IntrospectionState.OFF:
            self.close()
        elif self._publisher is None:
            self._publisher = Publisher(self._scope, message_type(self._cls.Event), self._topic, profile)
        return self._publisher is not None

    def sent(self, client_gid: bytes, sequence: int, message: Payload) -> None:
        """Publish that the client or server has written a message."""
        kind = ServiceEventType.REQUEST_SENT if self._is_client else ServiceEventType.RESPONSE_SENT
        self._publish(kind, client_gid, sequence, message)

    def received(self, client_gid: bytes, sequence: int, message: Payload) -> None:
        """Publish that a message has arrived for the client or server."""
        kind = ServiceEventType.RESPONSE_RECEIVED if self._is_client else ServiceEventType.REQUEST_RECEIVED
        self._publish(kind, client_gid, sequence, message)

    def _publish(self, kind: ServiceEventType, client_gid: bytes, sequence: int, message: Payload) -> None:
        if self._scope.closed or self._publisher is None:
            return  # The node is going; a last response must not fail because of us.
        event = self._cls.Event()
        event.info.event_type = int(kind)
        event.info.client_gid = np.frombuffer(client_gid, np.uint8)  # suits either flavour
        event.info.sequence_number = sequence
        set_stamp(event.info.stamp, self._clock.now_ns())
        try:
            if self._state is IntrospectionState.CONTENTS:
                if kind in (ServiceEventType.REQUEST_SENT, ServiceEventType.REQUEST_RECEIVED):
                    event.request = [self._cls.Request._decode(message)]
                else:
                    event.response = [self._cls.Response._decode(message)]
        except DecodeError:
            return  # The endpoint itself will count and log it.
        self._publisher.publish(event)

    def close(self) -> None:
        """Publish nothing more."""
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            publisher.close()
