"""What clients and servers of a service have in common: names, a pair of endpoints, introspection."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.runtime.endpoints.header import carrier_qos
from rosidl_py_gen.runtime.endpoints.scope import Owned, Throttle
from rosidl_py_gen.runtime.loop.outbox import Outbox
from rosidl_py_gen.runtime.names.dds import reply_name, request_name
from rosidl_py_gen.runtime.transport.interface import Service

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.endpoints.header import IntrospectionState, Tap
    from rosidl_py_gen.runtime.endpoints.introspection import ServiceEvents
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import ServiceType
    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")


class ServiceEnd(Owned, Generic[RequestT, ResponseT]):
    """A client or a server; `close` and the sink of the reader are theirs."""

    def __init__(
        self,
        scope: Scope,
        service_type: ServiceType[RequestT, ResponseT],
        name: str,
        qos: QoSProfile,
        *,
        is_client: bool,
    ) -> None:
        super().__init__(scope)
        self.name = name
        """Fully qualified service name, after expansion and remapping."""
        self.service_type = service_type.ros_name
        """``pkg/srv/Name``."""
        self._type = service_type
        self._is_client = is_client
        self._throttle = Throttle()
        self._events: ServiceEvents | None = None
        self._tap: Tap | None = None
        self._outbox = Outbox(scope.bridge, None, scope.report_failure)
        self._request_topic = request_name(name, prefix=not qos.avoid_ros_namespace_conventions)
        self._reply_topic = reply_name(name, prefix=not qos.avoid_ros_namespace_conventions)
        told = Service(
            name,
            service_type.ros_name,
            service_type.type_hash,
            service_type.request.type_hash,
            service_type.response.type_hash,
        )
        create = scope.participant.create_client if is_client else scope.participant.create_server
        self._reader, self._writer, self._gid = create(told, carrier_qos(qos), node=scope.number)

    def configure_introspection(self, clock: Clock, qos: QoSLike, state: IntrospectionState) -> None:
        """Publish what passes on ``<service>/_service_event`` from now on; see `introspection.py`.

        Args:
            clock: stamps the events; usually the node's.
            qos: counts when introspection goes from OFF to something else.
        """
        self._scope.require_open(
            self._closed, f"the client of {self.name}" if self._is_client else f"service {self.name}"
        )
        if self._events is None:
            from rosidl_py_gen.runtime.endpoints.introspection import ServiceEvents

            self._events = ServiceEvents(self._scope, self._type, self.name, is_client=self._is_client)
        self._tap = self._events if self._events.configure(clock, qos, state) else None

    def _ends(self, *guids: bytes) -> bool:
        """As `Owned._ends`; from then on no events are published, either."""
        ends = super()._ends(*guids)
        if ends and self._events is not None:
            self._events.close()
        return ends
