"""Common parts of service clients and servers: names, endpoints, QoS profile, introspection, errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.entities.entity_scope import Entity, Throttle, entity_repr
from rosidl_py_gen.runtime.entities.type_hash_filter import TypeHashFilter
from rosidl_py_gen.runtime.graph.type_hashes import checked_mode, type_hashes_differ
from rosidl_py_gen.runtime.loop.send_queue import SendQueue
from rosidl_py_gen.runtime.transport.matching import without_best_available
from rosidl_py_gen.runtime.transport.service_api import ServiceSpec, TransportClient, TransportServer

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.introspection import IntrospectionState, ServiceEventPublisher
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.graph.graph import Graph
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile
    from rosidl_py_gen.runtime.transport.service_api import IncompatiblePeer

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")
TransportEndT = TypeVar("TransportEndT", TransportClient, TransportServer)


class IncompatibleServiceError(RosidlError):
    """Raised if a peer of a service uses an unsupported wire format; client or server must change its middleware."""


class ServerLostError(RosidlError, ConnectionError):
    """Raised if a server left before it replied, or reported an error; it may or may not have handled the request.

    The loss of a killed server is detected when its lease expires: on DDS after 10 s, on Fast DDS after 20 s.
    """


class CallTimeoutError(RosidlError, TimeoutError):
    """Raised if no response arrived in time; the server may or may not have handled the request."""


class ServiceEndpoint(Entity, Generic[RequestT, ResponseT]):
    """Base of service clients and servers.

    Subclasses own the `TransportClient` or `TransportServer` and the function that takes received data (the sink), and
    implement `close`.
    """

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
        self._mode = checked_mode(type_hash_check, scope.type_hash_check)
        super().__init__(scope)
        self.name: str = name
        """Fully qualified name of the service, after expansion and remapping."""
        self.service_type: str = service_type.ros_name
        """Name of the service type: ``pkg/srv/Name``."""
        self.qos: QoSProfile = service_endpoint_qos(qos)
        """QoS profile in use; its history is always keep-all."""
        self._type = service_type
        self._is_client = is_client
        self._throttle = Throttle(scope.clocks)
        self._introspection: ServiceEventPublisher | None = None
        self._send_queue = SendQueue(scope.loop_binding, None, scope.report_failure)
        request, response = service_type.request, service_type.response
        read, written = (response, request) if is_client else (request, response)
        self._written_hash = written.type_hash
        self._type_hash_filter: TypeHashFilter[bytes | None] = TypeHashFilter(
            scope, self._mode, lambda guid: guid, read, name, service_type.type_hash
        )
        self._accepted_writers = self._type_hash_filter.accepted_writers
        self._spec = ServiceSpec(
            name,
            self.service_type,
            service_type.type_hash,
            request.type_hash,
            response.type_hash,
            self.qos,
            scope.number,
            self._is_compatible,
        )

    def _open(self, transport_end: TransportEndT) -> TransportEndT:
        self._transport_end: TransportClient | TransportServer = transport_end
        self._connected = transport_end.connected
        if transport_end.matches_by_hash:
            self._type_hash_filter.disable()
        reader, writer = transport_end.endpoints
        self._scope.set_type_hash_check(self._mode, reader, self._type_hash_filter.remember)
        self._scope.set_type_hash_check(self._mode, writer)
        return transport_end

    def _is_compatible(self, endpoint: DiscoveredEndpoint) -> bool:
        if endpoint.is_writer:
            return self._type_hash_filter.is_compatible(endpoint)
        own_hashes = self._written_hash, self._type_hash_filter.service_hash
        return self._mode in ("warn", "off") or not type_hashes_differ(endpoint, *own_hashes)

    @property
    def srv_name(self) -> str:
        """Service name, equal to `name`; for compatibility with rclpy."""
        return self.name

    @property
    def incompatible_dropped(self) -> int:
        """Number of requests or responses dropped because the peer has another definition of the type."""
        return self._type_hash_filter.incompatible_dropped

    def configure_introspection(self, clock: Clock, qos: QoSLike, state: IntrospectionState) -> None:
        """Start to publish requests and responses on ``<service>/_service_event``, or stop it.

        Args:
            clock: stamps the events; usually the node's clock.
            qos: profile of the publisher; used when introspection was OFF before.
            state: contents of the events; OFF stops publishing.

        Raises:
            TypeError: clock or state has another type; nothing is changed.
            InvalidQoSError: the profile is invalid; nothing is changed.
            ClosedError: the entity is closed.
        """
        self._require_open()
        from rosidl_py_gen.runtime.entities.introspection import ServiceEventPublisher

        publisher = self._introspection
        if publisher is None:
            publisher = ServiceEventPublisher(self._scope, self._type, self.name, is_client=self._is_client)
        self._introspection = publisher if publisher.configure(clock, qos, state) else None
        self._transport_end.is_introspected = self._introspection is not None

    def __repr__(self) -> str:
        details, peer = (self.name, self.service_type, self.qos.short()), "server" if self._is_client else "client"
        return entity_repr(self, *details, peers=lambda: len(self._connected()), peer=peer)

    def _begin_close(self, *guids: bytes) -> bool:
        is_first = super()._begin_close(*guids)
        if is_first and self._introspection is not None:
            self._introspection.close()
        return is_first


def service_endpoint_qos(qos: QoSProfile) -> QoSProfile:
    """Return the QoS profile for the endpoints of a service: the requested profile, but with history keep-all.

    If a queue overwrote a request or response, its call would never return. History does not affect matching, so peers
    with keep-last 10, the default of ROS, match anyway.
    """
    return without_best_available(qos).keep_all()


def incompatible_peer_text(graph: Graph, peer: IncompatiblePeer, service: str, role: str) -> str:
    """Return the error text about a peer of a service that cannot be called or served."""
    endpoint = graph.endpoints.get(peer.guid)
    node = "a node" if endpoint is None else graph.describe_node(endpoint)
    if not peer.has_topics:
        return f"{role} of service {service} is {node} on Fast DDS, and {peer.reason}"
    return (
        f"{role} of service {service} is {node} on Fast DDS. Topics work with it, services do not here: "
        f"{peer.reason}. "
        "Another version of Cyclone DDS's library (libddsc) may support them: set ROSIDL_LIBDDSC to its path; or start "
        "that node with RMW_IMPLEMENTATION=rmw_cyclonedds_cpp"
    )
