"""Common part of action clients and servers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity
from rosidl_py_gen.runtime.entities.service_common import ServiceEndpoint

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.introspection import IntrospectionState
    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.transport.qos import QoSLike


class ActionEntity(CompositeEntity):
    """Base of action clients and servers, which consist of three services and two topics."""

    name: str

    def configure_introspection(self, clock: Clock, qos: QoSLike, state: IntrospectionState) -> None:
        """Publish the requests and responses of all three services on ``<service>/_service_event`` from now on.

        ``ros2 action echo`` of Kilted and later shows them. Arguments and errors as those of a client or service.
        """
        self._scope.require_open(self._closed, f"action {self.name}")
        for entity in list(self._parts.owned.values()):
            if isinstance(entity, ServiceEndpoint):
                entity.configure_introspection(clock, qos, state)
