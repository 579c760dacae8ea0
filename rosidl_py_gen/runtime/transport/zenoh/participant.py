"""Participant of the Zenoh transport: one session, with the endpoints and liveliness tokens of its nodes.

Rules:

- An endpoint is declared before its token and undeclared after it; the same holds for a node and its endpoints.
- Every handler that Zenoh calls is a "direct" one. It adds to a queue and wakes up the loop. It never waits and never
  undeclares anything, which would stop or deadlock the session.
- No lock of this package is held during a call into Zenoh.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, TypeVar

import zenoh

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.transport.api import (
    DiscoveryEvent,
    EndpointSpec,
    EntityLost,
    NodeEntities,
    Sink,
    TransportError,
)
from rosidl_py_gen.runtime.transport.dds.names import wire_type
from rosidl_py_gen.runtime.transport.qos import Durability
from rosidl_py_gen.runtime.transport.ready_items import ReadyItems
from rosidl_py_gen.runtime.transport.service_api import ServiceSpec
from rosidl_py_gen.runtime.transport.zenoh.endpoints import ZenohReader, ZenohWriter, leak_after_fork, zenoh_handler
from rosidl_py_gen.runtime.transport.zenoh.services import ZenohClient, ZenohServer
from rosidl_py_gen.runtime.transport.zenoh.token_graph import (
    TokenGraph,
    endpoints_of,
    incompatibility,
    participant_guid,
)
from rosidl_py_gen.runtime.transport.zenoh.wire_formats import (
    CPU_BACKEND,
    EndpointToken,
    EntityKind,
    NodeToken,
    data_key,
    gid_of,
    qos_text,
    read_qos,
    tokens_of,
)

_EndpointT = TypeVar("_EndpointT", bound=ZenohReader | ZenohWriter)
_NO_NODE_NAME = "_"
"""Node name in the tokens of endpoints that belong to no node. Such a token is not announced; it only determines the
endpoint's GID."""


class ZenohParticipant:
    """Participant of the Zenoh transport: one session; with `is_humble`, its keys and tokens have no type hashes."""

    middleware = "Zenoh"
    library = ""
    capabilities: Mapping[str, str] = MappingProxyType({})
    services_unavailable_reason: str | None = None
    incompatibility_reason = staticmethod(incompatibility)

    def __init__(self, session: Any, domain_id: int, enclave: str, *, is_humble: bool = False) -> None:
        self.session = session
        self.is_humble = is_humble
        self._domain_id = domain_id
        self._enclave = enclave
        self._zid = str(session.zid())
        self.guid = participant_guid(self._zid)
        self._closed = False
        self._ids = itertools.count()
        """Counter that numbers nodes and endpoints, as in rmw_zenoh_cpp."""
        self._nodes: dict[int, NodeToken] = {}
        self._no_node = NodeToken(domain_id, self._zid, 0, _NO_NODE_NAME)
        self._node_tokens: dict[int, Any] = {}
        self._local_endpoints: dict[bytes, ZenohReader | ZenohWriter] = {}
        """Readers, writers, clients and servers of this participant, by GUID."""
        self.ready_sinks: ReadyItems[Sink] = ReadyItems()
        self.set_wakeup, self.fileno = self.ready_sinks.set_wakeup, self.ready_sinks.fileno
        self.take_ready_sinks = self.ready_sinks.take
        self._discovery_sink: Callable[[list[DiscoveryEvent]], None] | None = None
        self._report_lock = threading.RLock()
        """Lock that is held until the sink has applied the events: without a running loop, several threads report."""
        self.graph = self.endpoint_index = TokenGraph(self._zid, enclave)
        self._liveliness = session.liveliness()
        self._listener = self._liveliness.declare_subscriber(
            tokens_of(domain_id), zenoh_handler(self._on_token), history=True
        )

    def create_writer(self, spec: EndpointSpec) -> ZenohWriter:
        return self._create(ZenohWriter, EntityKind.PUBLISHER, spec.topic_key.name, spec)

    def create_reader(self, spec: EndpointSpec) -> ZenohReader:
        is_volatile = spec.qos.durability is not Durability.TRANSIENT_LOCAL
        has_buffer = spec.has_buffer and is_volatile and not self.is_humble
        options = {"ignore_local": spec.ignore_local, "has_buffer": has_buffer}
        return self._create(ZenohReader, EntityKind.SUBSCRIPTION, spec.topic_key.name, spec, **options)

    def create_client(self, service: ServiceSpec) -> ZenohClient:
        return self._create(ZenohClient, EntityKind.CLIENT, service.name, service)

    def create_server(self, service: ServiceSpec) -> ZenohServer:
        return self._create(ZenohServer, EntityKind.SERVER, service.name, service)

    def _create(
        self,
        endpoint_class: type[_EndpointT],
        kind: EntityKind,
        name: str,
        spec: EndpointSpec | ServiceSpec,
        **options: Any,
    ) -> _EndpointT:
        """Create a reader, writer, client or server, and then announce its token, if it belongs to a node."""
        if self._closed:
            raise ClosedError("this participant is closed")
        name = f"/{name.removeprefix('/')}"  # Zenoh has no prefixes: an unmangled name is a topic's name
        type, type_hash = wire_type(spec.type), "" if self.is_humble else spec.type_hash
        profile = read_qos(qos_text(spec.qos))
        assert profile is not None
        owner = self._nodes.get(spec.node)
        backends = CPU_BACKEND if options.get("has_buffer") else ""
        node = owner or self._no_node
        token = EndpointToken(node, next(self._ids), kind, name, type, type_hash, profile, backends)
        infos = endpoints_of(token, gid_of(str(token)))
        if isinstance(spec, ServiceSpec):
            # Only our own graph knows the hashes of the messages; tokens do not contain them.
            hashes = {"request": spec.request_hash, "reply": spec.response_hash}
            infos = tuple(replace(info, type_hash=hashes[info.topic_key.kind]) for info in infos)
        key = data_key(self._domain_id, name, type, type_hash)
        endpoint = None
        try:
            endpoint = endpoint_class(self, infos, key, **options)
            endpoint.token = self._liveliness.declare_token(str(token)) if owner else None
        except zenoh.ZError as error:
            if endpoint is not None:
                endpoint.close()
            subject = f"an endpoint of {infos[0].topic_key.name} at {key}"
            raise TransportError(f"Zenoh could not create {subject}: {error}") from None
        self._local_endpoints[endpoint.guid] = endpoint
        self.graph.add_endpoints(infos)
        self.ready_sinks.put(self.report_discovery)
        return endpoint

    def undeclare_token(self, guid: bytes) -> None:
        """Undeclare the token of an endpoint, before the endpoint itself is undeclared."""
        endpoint = self._local_endpoints.pop(guid, None)
        if endpoint is not None:
            if endpoint.token is not None:
                endpoint.token.undeclare()
            self.graph.remove_endpoints(endpoint.infos)
            self.ready_sinks.put(self.report_discovery)

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        for number in self._nodes.keys() - nodes.keys():
            del self._nodes[number]
            self._node_tokens.pop(number).undeclare()
        for number, node in nodes.items():
            if number not in self._nodes and not self._closed:
                token = NodeToken(self._domain_id, self._zid, next(self._ids), node.name, node.namespace, self._enclave)
                self._nodes[number] = token
                self._node_tokens[number] = self._liveliness.declare_token(str(token))

    def _on_token(self, sample: Any) -> None:
        """Record that a liveliness token has appeared or disappeared. Called by Zenoh; must not block or log."""
        self.graph.on_token(sample.kind == zenoh.SampleKind.PUT, str(sample.key_expr))
        self.ready_sinks.put(self.report_discovery)

    def set_discovery_sink(self, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        self._discovery_sink = sink
        self.ready_sinks.put(self.report_discovery)

    def report_discovery(self) -> None:
        sink = self._discovery_sink  # another thread may close the participant
        if sink is None:
            return
        with self._report_lock:
            events = self.graph.events()
            lost = {event.guid for event in events if isinstance(event, EntityLost)}
            for endpoint in list(self._local_endpoints.values()) if lost else ():
                if isinstance(endpoint, ZenohServer):
                    endpoint.drop_requests(lost)
            if events:
                sink(events)

    def detach_after_fork(self) -> None:
        self._closed = True
        self._discovery_sink = None
        for endpoint in self._local_endpoints.values():
            endpoint.detach_after_fork()
            leak_after_fork(endpoint.token)
        leak_after_fork(self.session, self._liveliness, self._listener, *self._node_tokens.values())

    def close(self) -> None:
        if self._closed:
            return
        # Endpoints that Zenoh refuses to undeclare end with the session; on a busy machine its close may fail.
        for endpoint in list(self._local_endpoints.values()):
            with contextlib.suppress(zenoh.ZError):
                endpoint.close()
        self._closed = True
        self._discovery_sink = None
        try:
            with contextlib.suppress(zenoh.ZError):
                self.announce({})
                self._listener.undeclare()
        finally:
            with contextlib.suppress(zenoh.ZError):
                self.session.close()
            self.ready_sinks.close()
