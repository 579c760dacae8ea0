"""The member of a domain that Zenoh sees: one session, with the endpoints and liveliness tokens of our nodes.

Rules a newcomer would otherwise break:

- An endpoint is there before its token, and its token is gone before it is; so with a node and its endpoints.
- Every function that Zenoh calls is a "direct" one. It puts what came into a queue and says that something did; it
  never waits and never undeclares anything, which would stop or deadlock the session.
- No lock of ours is held during a call into Zenoh.
"""

from __future__ import annotations

import contextlib
import itertools
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import zenoh

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.api import TransportError
from rosidl_py_gen.runtime.transport.qos import Durability
from rosidl_py_gen.runtime.transport.type_names import wire_type
from rosidl_py_gen.runtime.transport.zenoh.endpoints import (
    BufferReader,
    ZenohReader,
    ZenohWriter,
    leak_after_fork,
    zenoh_handler,
)
from rosidl_py_gen.runtime.transport.zenoh.keys import data_key
from rosidl_py_gen.runtime.transport.zenoh.liveliness_tokens import (
    CPU_BACKEND,
    EndpointToken,
    EntityKind,
    NodeToken,
    gid_of,
    tokens_of,
)
from rosidl_py_gen.runtime.transport.zenoh.qos import qos_text, read_qos
from rosidl_py_gen.runtime.transport.zenoh.ready_sinks import ReadySinks
from rosidl_py_gen.runtime.transport.zenoh.services import ZenohClient, ZenohServer
from rosidl_py_gen.runtime.transport.zenoh.token_graph import (
    TokenGraph,
    endpoints_of,
    incompatibility,
    participant_guid,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.transport.api import EndpointSpec
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, DiscoveryEvent, NodeEntities
    from rosidl_py_gen.runtime.transport.incompatibility import IncompatibilityKind
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.samples import Sink
    from rosidl_py_gen.runtime.transport.service_api import ServiceSpec

_EndpointT = TypeVar("_EndpointT", bound=ZenohReader | ZenohWriter)
_NO_NODE_NAME = "_"
"""Stands for the node of endpoints that have none; they have no token, so nobody reads it."""


class _Description(NamedTuple):
    """A new endpoint: its key, its token (empty when it belongs to no node), and what the graph shall know of it."""

    key: str
    token: str
    endpoints: tuple[DiscoveredEndpoint, ...]


class _LocalEndpoint(NamedTuple):
    """An endpoint of ours, its liveliness token, and what the graph knows of it."""

    endpoint: ZenohReader | ZenohWriter
    token: Any
    told: tuple[DiscoveredEndpoint, ...]


class ZenohParticipant:
    """See `port.Participant`."""

    middleware = "Zenoh"
    library = ""
    capabilities: Mapping[str, str] = MappingProxyType({})
    services_unavailable_reason: str | None = None

    def __init__(self, session: Any, domain_id: int, enclave: str, *, is_humble: bool = False) -> None:
        """`is_humble`: keys and tokens as in Humble, so without hashes."""
        self.session = session
        self._is_humble = is_humble
        self._domain_id = domain_id
        self._enclave = enclave
        self._zid = str(session.zid())
        self.guid = participant_guid(self._zid)
        self._closed = False
        self._ids = itertools.count()
        """Of nodes and endpoints alike, as in rmw_zenoh_cpp."""
        self._nodes: dict[int, NodeToken] = {}
        self._nobody = NodeToken(domain_id, self._zid, 0, _NO_NODE_NAME)
        self._node_tokens: dict[int, Any] = {}
        self._owned: dict[bytes, _LocalEndpoint] = {}
        self.arrivals = ReadySinks()
        self._discovery_sink: Callable[[list[DiscoveryEvent]], None] | None = None
        self.graph = TokenGraph(self._zid, enclave)
        self._liveliness = session.liveliness()
        self._listener = self._liveliness.declare_subscriber(
            tokens_of(domain_id), zenoh_handler(self._on_token), history=True
        )

    # ------------------------------------------------------------------------------------------------ endpoints

    def create_writer(self, spec: EndpointSpec) -> ZenohWriter:
        told = self._endpoint_description(EntityKind.PUBLISHER, *_named(spec))
        return self._register_endpoint(told, lambda: ZenohWriter(self, told.endpoints[0], told.key))

    def create_reader(self, spec: EndpointSpec) -> ZenohReader:
        is_late = spec.qos.durability is Durability.TRANSIENT_LOCAL
        takes_buffers = spec.has_buffer and not self._is_humble and not is_late
        backends, make = (CPU_BACKEND, BufferReader) if takes_buffers else ("", ZenohReader)
        told = self._endpoint_description(EntityKind.SUBSCRIPTION, *_named(spec), backends)
        return self._register_endpoint(
            told, lambda: make(self, told.endpoints[0], told.key, ignore_local=spec.ignore_local)
        )

    def create_client(self, service: ServiceSpec, qos: QoSProfile, *, node: int = 0) -> ZenohClient:
        told = self._describe_service(EntityKind.CLIENT, service, qos, node)
        replies, requests = told.endpoints
        return self._register_endpoint(told, lambda: ZenohClient(self, replies, requests, told.key))

    def create_server(self, service: ServiceSpec, qos: QoSProfile, *, node: int = 0) -> ZenohServer:
        told = self._describe_service(EntityKind.SERVER, service, qos, node)
        requests, replies = told.endpoints
        return self._register_endpoint(told, lambda: ZenohServer(self, requests, replies, told.key))

    def _endpoint_description(
        self,
        kind: EntityKind,
        name: str,
        type: str,
        type_hash: str,
        qos: QoSProfile,
        node: int,
        backends: str = "",
    ) -> _Description:
        if self._closed:
            raise ClosedError("this participant is closed")
        if self._is_humble:
            type_hash = ""
        profile = read_qos(qos_text(qos))
        assert profile is not None
        owner = self._nodes.get(node)
        type = wire_type(type)
        token = EndpointToken(owner or self._nobody, next(self._ids), kind, name, type, type_hash, profile, backends)
        text = str(token)
        key = data_key(self._domain_id, name, type, type_hash)
        return _Description(key, text if owner else "", endpoints_of(token, gid_of(text)))

    def _describe_service(self, kind: EntityKind, service: ServiceSpec, qos: QoSProfile, node: int) -> _Description:
        """`_endpoint_description` for a service; our own graph knows the hashes of the messages, which no token
        tells.
        """
        told = self._endpoint_description(kind, service.name, service.type, service.type_hash, qos, node)
        halves = [service.request_hash, service.response_hash]
        if kind is EntityKind.CLIENT:
            halves.reverse()
        endpoints = tuple(replace(one, type_hash=half) for one, half in zip(told.endpoints, halves, strict=True))
        return told._replace(endpoints=endpoints)

    def _register_endpoint(self, told: _Description, make: Callable[[], _EndpointT]) -> _EndpointT:
        """Make an endpoint, and tell others of it when it is ready."""
        endpoint = None
        try:
            endpoint = make()
            token = self._liveliness.declare_token(told.token) if told.token else None
        except zenoh.ZError as error:
            if endpoint is not None:
                endpoint.close()
            raise TransportError(
                f"create an endpoint of {told.endpoints[0].channel.name} at {told.key}: {error}"
            ) from None
        self._owned[endpoint.guid] = _LocalEndpoint(endpoint, token, told.endpoints)
        self.graph.add_own(told.endpoints)
        self.arrivals.put(self.report_discovery)
        return endpoint

    def undeclare_token(self, guid: bytes) -> None:
        """Tell others no more of an endpoint of ours, which will be undeclared."""
        owned = self._owned.pop(guid, None)
        if owned is not None:
            if owned.token is not None:
                owned.token.undeclare()
            self.graph.remove_own(owned.told)
            self.arrivals.put(self.report_discovery)

    def incompatibility_reason(
        self, writer: DiscoveredEndpoint, reader: DiscoveredEndpoint
    ) -> IncompatibilityKind | None:
        """See `port.Participant`; QoS profiles play no part here."""
        return incompatibility(writer, reader)

    # ---------------------------------------------------------------------------------------------------- nodes

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        for number in self._nodes.keys() - nodes.keys():
            del self._nodes[number]
            self._node_tokens.pop(number).undeclare()
        for number, node in nodes.items():
            if number not in self._nodes and not self._closed:
                token = NodeToken(self._domain_id, self._zid, next(self._ids), node.name, node.namespace, self._enclave)
                self._nodes[number] = token
                self._node_tokens[number] = self._liveliness.declare_token(str(token))

    # ------------------------------------------------------------------------------------------------ discovery

    def _on_token(self, sample: Any) -> None:
        """Called by Zenoh with each token that appears or disappears."""
        self.graph.on_token(sample.kind == zenoh.SampleKind.PUT, str(sample.key_expr))
        self.arrivals.put(self.report_discovery)

    def set_discovery_sink(self, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        self._discovery_sink = sink
        self.arrivals.put(self.report_discovery)

    def report_discovery(self) -> None:
        sink = self._discovery_sink  # another thread may close us
        if sink is None:
            return
        events = self.graph.events()
        for client in self.graph.take_gone_clients():
            for owned in list(self._owned.values()):
                if isinstance(owned.endpoint, ZenohServer):
                    owned.endpoint.forget(client)
        if events:
            sink(events)

    # -------------------------------------------------------------------------------------------------- waiting

    def set_wakeup(self, notify: Callable[[], None] | None) -> None:
        self.arrivals.set_wakeup(notify)

    def fileno(self) -> int | None:
        return self.arrivals.fileno()

    def take_ready_sinks(self) -> list[Sink]:
        return self.arrivals.take()

    # -------------------------------------------------------------------------------------------------- closing

    def detach_after_fork(self) -> None:
        self._closed = True
        self._discovery_sink = None
        for owned in self._owned.values():
            owned.endpoint.detach_after_fork()
            leak_after_fork(owned.token)
        leak_after_fork(self.session, self._liveliness, self._listener, *self._node_tokens.values())

    def close(self) -> None:
        if self._closed:
            return
        # What Zenoh refuses to undeclare goes with the session, whose end it gives up when the machine is too busy.
        for owned in list(self._owned.values()):
            with contextlib.suppress(zenoh.ZError):
                owned.endpoint.close()
        self._closed = True
        self._discovery_sink = None
        try:
            with contextlib.suppress(zenoh.ZError):
                self.announce({})
                self._listener.undeclare()
        finally:
            with contextlib.suppress(zenoh.ZError):
                self.session.close()
            self.arrivals.close()


def _named(spec: EndpointSpec) -> tuple[str, str, str, QoSProfile, int]:
    """Zenoh has no prefixes: a bare name is that of a topic."""
    return f"/{spec.name.removeprefix('/')}", spec.type, spec.type_hash, spec.qos, spec.node
