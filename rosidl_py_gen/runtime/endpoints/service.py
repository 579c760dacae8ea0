"""What clients and servers of a service have in common: names, a pair of endpoints, introspection."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.runtime.endpoints.scope import Owned, Throttle, shown
from rosidl_py_gen.runtime.endpoints.service_parts import carrier_qos
from rosidl_py_gen.runtime.endpoints.type_check import WriterCheck
from rosidl_py_gen.runtime.graph.definitions import checked_mode
from rosidl_py_gen.runtime.loop.outbox import Outbox
from rosidl_py_gen.runtime.transport.service_port import ClientPort, ServerPort, Service

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.endpoints.introspection import ServiceEvents
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.service_parts import IntrospectionState
    from rosidl_py_gen.runtime.endpoints.types import ServiceType
    from rosidl_py_gen.runtime.graph.definitions import TypeCheck
    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.transport.discovered import EndpointFound
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")
PortT = TypeVar("PortT", ClientPort, ServerPort)


class ServiceEnd(Owned, Generic[RequestT, ResponseT]):
    """A client or a server; the port, its sink and `close` are theirs."""

    def __init__(
        self,
        scope: Scope,
        service_type: ServiceType[RequestT, ResponseT],
        name: str,
        qos: QoSProfile,
        *,
        is_client: bool,
        type_check: TypeCheck | None = None,
    ) -> None:
        mode = checked_mode(type_check, scope.type_check)
        super().__init__(scope)
        self.name = name
        """Fully qualified service name, after expansion and remapping."""
        self.service_type = service_type.ros_name
        """``pkg/srv/Name``."""
        self.qos = carrier_qos(qos)
        """The profile in use; nothing is dropped for depth, see `carrier_qos`."""
        self._type = service_type
        self._is_client = is_client
        self._throttle = Throttle(scope.clocks)
        self._events: ServiceEvents | None = None
        self._tap: ServiceEvents | None = None
        self._outbox = Outbox(scope.bridge, None, scope.report_failure)
        read, written = service_type.request.type_hash, service_type.response.type_hash
        if is_client:
            read, written = written, read
        self._written_hash = written
        self._check: WriterCheck[bytes | None] = WriterCheck(scope, mode, _itself, read, service_type.type_hash)
        self._agreeing = self._check.agreeing
        self._mode = mode
        self._told = Service(
            name,
            self.service_type,
            service_type.type_hash,
            service_type.request.type_hash,
            service_type.response.type_hash,
            qos.avoid_ros_namespace_conventions,
            self._counts,
        )
        self._requests_on = self._told.channels[0]

    def _open(self, port: PortT) -> PortT:
        """Take a port into use."""
        self._gid = port.gid
        self._connected = port.connected
        self._scope.set_type_check(self._mode, *port.endpoints)
        return port

    def _counts(self, endpoint: EndpointFound) -> bool:
        """Whether an endpoint of the other side may be talked to."""
        return self._check.agrees(endpoint, None if endpoint.is_writer else self._written_hash)

    @property
    def srv_name(self) -> str:
        """The same as `name`; the name in rclpy."""
        return self.name

    @property
    def withheld(self) -> int:
        """Requests or responses that were not handed out because the other side announces another definition."""
        return self._check.withheld

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

    def __repr__(self) -> str:
        parts, peer = (self.name, self.service_type, self.qos.short()), "server" if self._is_client else "client"
        return shown(self, *parts, peers=lambda: len(self._connected()), peer=peer)

    def _ends(self, *guids: bytes) -> bool:
        """Whether the endpoint ends now, as `Owned._ends`; from then on no events are published, either."""
        ends = super()._ends(*guids)
        if ends and self._events is not None:
            self._events.close()
        return ends


def _itself(guid: bytes | None) -> bytes | None:
    return guid
