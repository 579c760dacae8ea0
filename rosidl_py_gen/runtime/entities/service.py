"""What clients and servers of a service have in common: names, a pair of endpoints, introspection."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.runtime.entities.entity_scope import Entity, Throttle, entity_repr
from rosidl_py_gen.runtime.entities.service_common import service_endpoint_qos
from rosidl_py_gen.runtime.entities.type_hash_filter import TypeHashFilter
from rosidl_py_gen.runtime.graph.type_hashes import checked_mode
from rosidl_py_gen.runtime.loop.send_queue import SendQueue
from rosidl_py_gen.runtime.transport.service_api import ServiceClientTransport, ServiceServerTransport, ServiceSpec

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.introspection import ServiceEventPublisher
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.entities.service_common import IntrospectionState
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")
PortT = TypeVar("PortT", ServiceClientTransport, ServiceServerTransport)


class ServiceEndpoint(Entity, Generic[RequestT, ResponseT]):
    """A client or a server; the port, its sink and `close` are theirs."""

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
        mode = checked_mode(type_hash_check, scope.type_hash_check)
        super().__init__(scope)
        self.name = name
        """Fully qualified service name, after expansion and remapping."""
        self.service_type = service_type.ros_name
        """``pkg/srv/Name``."""
        self.qos = service_endpoint_qos(qos)
        """The profile in use; nothing is dropped for depth, see `service_endpoint_qos`."""
        self._type = service_type
        self._is_client = is_client
        self._throttle = Throttle(scope.clocks)
        self._events: ServiceEventPublisher | None = None
        self._tap: ServiceEventPublisher | None = None
        self._outbox = SendQueue(scope.bridge, None, scope.report_failure)
        read, written = service_type.request.type_hash, service_type.response.type_hash
        if is_client:
            read, written = written, read
        self._written_hash = written
        self._check: TypeHashFilter[bytes | None] = TypeHashFilter(scope, mode, _itself, read, service_type.type_hash)
        self._agreeing = self._check.accepted_writers
        self._mode = mode
        self._spec = ServiceSpec(
            name,
            self.service_type,
            service_type.type_hash,
            service_type.request.type_hash,
            service_type.response.type_hash,
            qos.avoid_ros_namespace_conventions,
            self._is_compatible,
        )
        self._requests_on = self._spec.channels[0]

    def _open(self, port: PortT) -> PortT:
        """Take a port into use."""
        self._gid = port.gid
        self._connected = port.connected
        self._scope.set_type_hash_check(self._mode, *port.endpoints)
        return port

    def _is_compatible(self, endpoint: DiscoveredEndpoint) -> bool:
        """Whether an endpoint of the other side may be talked to."""
        return self._check.is_compatible(endpoint, None if endpoint.is_writer else self._written_hash)

    @property
    def srv_name(self) -> str:
        """The same as `name`; the name in rclpy."""
        return self.name

    @property
    def incompatible_dropped(self) -> int:
        """Requests or responses that were not handed out because the other side announces another definition."""
        return self._check.incompatible_dropped

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
            from rosidl_py_gen.runtime.entities.introspection import ServiceEventPublisher

            self._events = ServiceEventPublisher(self._scope, self._type, self.name, is_client=self._is_client)
        self._tap = self._events if self._events.configure(clock, qos, state) else None

    def __repr__(self) -> str:
        parts, peer = (self.name, self.service_type, self.qos.short()), "server" if self._is_client else "client"
        return entity_repr(self, *parts, peers=lambda: len(self._connected()), peer=peer)

    def _begin_close(self, *guids: bytes) -> bool:
        """Whether the endpoint ends now, as `Owned._ends`; from then on no events are published, either."""
        ends = super()._begin_close(*guids)
        if ends and self._events is not None:
            self._events.close()
        return ends


def _itself(guid: bytes | None) -> bytes | None:
    return guid
