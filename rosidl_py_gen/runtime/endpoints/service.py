"""What clients and servers of a service have in common: names, a pair of endpoints, introspection."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.runtime.endpoints.header import carrier_qos
from rosidl_py_gen.runtime.endpoints.scope import Owned, Throttle, shown
from rosidl_py_gen.runtime.endpoints.type_check import WriterCheck
from rosidl_py_gen.runtime.graph.definitions import checked_mode
from rosidl_py_gen.runtime.loop.outbox import Outbox
from rosidl_py_gen.runtime.transport.discovered import Channel
from rosidl_py_gen.runtime.transport.port import Service

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.endpoints.header import IntrospectionState, Tap
    from rosidl_py_gen.runtime.endpoints.introspection import ServiceEvents
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import ServiceType
    from rosidl_py_gen.runtime.graph.definitions import TypeCheck
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
        self._tap: Tap | None = None
        self._outbox = Outbox(scope.bridge, None, scope.report_failure)
        is_bare = qos.avoid_ros_namespace_conventions
        self._requests_on = Channel("bare", f"{name}Request") if is_bare else Channel("request", name)
        self._replies_on = Channel("bare", f"{name}Reply") if is_bare else Channel("reply", name)
        told = Service(
            name,
            service_type.ros_name,
            service_type.type_hash,
            service_type.request.type_hash,
            service_type.response.type_hash,
        )
        create = scope.participant.create_client if is_client else scope.participant.create_server
        self._reader, self._writer, self._gid = create(told, self.qos, node=scope.number)
        read, written = told.request_hash, told.response_hash
        if is_client:
            read, written = written, read
        self._check = WriterCheck(scope, mode, self._reader, read, told.type_hash)
        self._agreeing = self._check.agreeing
        self._written_hash = written
        scope.set_type_check(mode, self._reader.guid, self._writer.guid)

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
        return shown(self, *parts, peers=lambda: len(self._reader.matched_writers()), peer=peer)

    def _ends(self, *guids: bytes) -> bool:
        """As `Owned._ends`; from then on no events are published, either."""
        ends = super()._ends(*guids)
        if ends and self._events is not None:
            self._events.close()
        return ends
