"""Participant of the Zenoh transport: one session, with the endpoints and liveliness tokens of its nodes.

Rules:

- An endpoint is declared before its token and undeclared after it; the same holds for a node and its endpoints.
- Every handler that Zenoh calls is a "direct" one. It adds to a queue and wakes up the loop. It never waits and never
  undeclares anything, which would stop or deadlock the session.
- No lock of this package is held during a call into Zenoh.

`ZenohTransport` opens a session for a context and waits for a router. Zenoh cannot be used after a fork: its threads,
which all sessions of a process share, do not exist in the child, and the first call would never return.

Configuration of sessions and routers: defaults of rmw_zenoh_cpp, and its environment variables, which are read from a
mapping, never from `os.environ`. Sessions listen on this machine only and find each other through a router, never by
multicast.

Source: docs/internals/zenoh.md 1 (rmw_zenoh_cpp of Jazzy, its two configuration files and zenoh_config.cpp).
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import re
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, TypeVar

import zenoh

from rosidl_py_gen.errors import ClosedError, RosidlError, printable
from rosidl_py_gen.runtime.logs import get_root_logger
from rosidl_py_gen.runtime.transport.api import (
    SYSTEM_CLOCKS,
    DiscoveryEvent,
    DomainSettings,
    EndpointSpec,
    EntityLost,
    NodeEntities,
    ServiceSpec,
    Sink,
    TransportError,
)
from rosidl_py_gen.runtime.transport.dds.names import wire_type
from rosidl_py_gen.runtime.transport.middleware_threads import ReadyItems
from rosidl_py_gen.runtime.transport.qos import FORMAT_VARIABLE, Durability
from rosidl_py_gen.runtime.transport.zenoh.endpoints import ZenohReader, ZenohWriter, leak_after_fork, zenoh_handler
from rosidl_py_gen.runtime.transport.zenoh.services import ZenohClient, ZenohServer
from rosidl_py_gen.runtime.transport.zenoh.wire_formats import (
    CPU_BACKEND,
    EndpointToken,
    EntityKind,
    NodeToken,
    TokenGraph,
    data_key,
    endpoints_of,
    gid_of,
    incompatibility,
    participant_guid,
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


# ------------------------------------------------------------------------------------------------------------ transport

_ROUTER_RETRY_INTERVAL_S = 1.0
"""Interval between two checks for a router, in seconds; the same as in rmw_zenoh_cpp."""
_ROUTER_POLL_INTERVAL_S = 0.001


class ZenohTransport:
    """Transport that joins domains by Zenoh sessions."""

    _was_used: ClassVar[bool] = False
    _is_forked: ClassVar[bool] = False

    clocks = SYSTEM_CLOCKS

    def open(self, settings: DomainSettings, enclave: str = "/") -> ZenohParticipant:
        """Open a Zenoh session and join the domain of `settings`; discovery range and static peers are ignored.

        Raises:
            ZenohConfigError: a configuration file or environment variable is not usable.
            TransportError: Zenoh cannot open a session, or this process was forked from a process that uses Zenoh.
        """
        if ZenohTransport._is_forked:
            raise TransportError(
                "this process was forked from one that uses Zenoh, whose threads do not exist here; start it with "
                'multiprocessing\'s "spawn" method, or fork before the first node is created'
            )
        config = session_config(os.environ, get_root_logger().warning)
        # Otherwise Zenoh waits for all discovered peers, often half a second for one that is gone.
        insert_setting(config, "open/return_conditions/connect_scouted", "false", where="own settings")
        attempts, humble = router_attempts(os.environ), is_humble(os.environ)
        where = ", ".join(configured_endpoints(config, "connect"))
        ZenohTransport._was_used = True
        try:
            session = zenoh.open(config)
        except zenoh.ZError as error:
            reason = str(error).split(" at ", 1)[0]
            raise TransportError(
                f"Zenoh could not open a session: {reason}. It was configured to connect to {where or 'no endpoint'}"
            ) from None
        _check_for_router(session, attempts, where or "any endpoint")
        return ZenohParticipant(session, settings.domain_id, enclave, is_humble=humble)

    @classmethod
    def after_fork(cls) -> None:
        """Refuse to use Zenoh in this forked child if the parent has used it."""
        cls._is_forked = cls._was_used


def _check_for_router(session: zenoh.Session, attempts: float, where: str) -> None:
    """Wait for a router as configured by ZENOH_ROUTER_CHECK_ATTEMPTS, and warn if there is none."""
    if attempts <= 0 or _wait_for_router(session, _ROUTER_RETRY_INTERVAL_S):
        return
    if attempts > 1:
        get_root_logger().warning(f"waiting for a Zenoh router at {where}")
        if _wait_for_router(session, (attempts - 1) * _ROUTER_RETRY_INTERVAL_S):
            return
    get_root_logger().warning(
        f"no Zenoh router answers at {where}, so other processes are not found; start `rosidl-py zenoh-router`. The "
        "connection is retried"
    )


def _wait_for_router(session: zenoh.Session, timeout_s: float) -> bool:
    end_s = time.monotonic() + timeout_s
    while not session.info.routers_zid():
        if time.monotonic() >= end_s:
            return False
        time.sleep(_ROUTER_POLL_INTERVAL_S)
    return True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=ZenohTransport.after_fork)


# -------------------------------------------------------------------------------------------------------- configuration

ROUTER_PORT = 7447
_MAX_QUOTED_CHARS = 200
_MAX_DEPTH = 100
"""Maximum nesting of brackets in a configuration of Zenoh; some thousands would crash Zenoh's parser."""
_BRACKET = re.compile(r"[\[{}\]]")
_SOURCE_LOCATION = re.compile(r" at \S+\.rs:\d+\.?")
_MESSAGE = re.compile(r'(?:msg: |Str\()"((?:[^"\\]|\\.)*)"')
_LINE_COLUMN = re.compile(r"line: (\d+), column: (\d+)")

_COMMON: dict[str, object] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/target": {"router": ["router", "peer"], "peer": ["router"]},
    "timestamping/enabled": {"router": True, "peer": True, "client": True},
    "queries_default_timeout": 600_000,
    "transport/unicast/open_timeout": 60_000,
    "transport/unicast/accept_timeout": 60_000,
    "transport/unicast/accept_pending": 10_000,
    "transport/unicast/max_sessions": 10_000,
    "transport/link/tx/lease": 60_000,
    "transport/link/tx/keep_alive": 2,
    "transport/shared_memory/enabled": False,  # used if both ends enable it
    "transport/shared_memory/transport_optimization/pool_size": 48 << 20,
    "transport/shared_memory/transport_optimization/message_size_threshold": 512,
    "adminspace/enabled": True,
}
_MAX_CONGESTION_WAIT_US = 250_000
"""Maximum time that a large message waits for a congested link before it is dropped, in microseconds. With the 50 ms of
rmw_zenoh_cpp a busy machine lost one image of ten. After the first drop Zenoh does not wait any more."""
_STRATEGY = {"peer": {"to_router": "always", "to_peer": "greater-zid"}}
_SESSION: dict[str, object] = {
    "mode": "peer",
    "connect/endpoints": [f"tcp/localhost:{ROUTER_PORT}"],
    "listen/endpoints": ["tcp/localhost:0"],
    "scouting/gossip/autoconnect_strategy": _STRATEGY,
    "scouting/multicast/autoconnect_strategy": _STRATEGY,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 60_000_000,
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": _MAX_CONGESTION_WAIT_US,
}
_ROUTER: dict[str, object] = {"mode": "router", "listen/endpoints": [f"tcp/[::]:{ROUTER_PORT}"]}
IPV4_ONLY = f"tcp/0.0.0.0:{ROUTER_PORT}"
"""Address on which a router listens on machines without IPv6, which refuse the default address."""


class ZenohConfigError(RosidlError, ValueError):
    """Raised if a configuration of Zenoh is not usable; the text names the variable or key, and quotes its value."""


def session_config(environ: Mapping[str, str], warn: Callable[[str], None]) -> zenoh.Config:
    """Return the configuration of a context's Zenoh session.

    Args:
        warn: called with a text for each skipped pair of ZENOH_CONFIG_OVERRIDE.

    Raises:
        ZenohConfigError: a variable or file is not usable.
    """
    return _configuration(environ, "ZENOH_SESSION_CONFIG_URI", {**_COMMON, **_SESSION}, warn)


def router_config(
    environ: Mapping[str, str], warn: Callable[[str], None], *, listen: Iterable[str] = (), connect: Iterable[str] = ()
) -> zenoh.Config:
    """Return the configuration of a Zenoh router.

    Args:
        warn: called with a text for each skipped pair of ZENOH_CONFIG_OVERRIDE.
        listen: endpoints that replace the configured ones, if any are given.
        connect: endpoints of other routers that replace the configured ones, if any are given.

    Raises:
        ZenohConfigError: a variable, file or endpoint is not usable.
    """
    config = _configuration(environ, "ZENOH_ROUTER_CONFIG_URI", {**_COMMON, **_ROUTER}, warn)
    for key, endpoints in (("listen/endpoints", list(listen)), ("connect/endpoints", list(connect))):
        if endpoints:
            insert_setting(config, key, json.dumps(endpoints), where="router")
    return config


def router_attempts(environ: Mapping[str, str]) -> float:
    """Return how often a new session checks for a router, from ZENOH_ROUTER_CHECK_ATTEMPTS; `math.inf`: until found.

    Raises:
        ZenohConfigError: the variable is not a whole number.
    """
    text = environ.get("ZENOH_ROUTER_CHECK_ATTEMPTS", "")
    try:
        attempts = int(text) if text else 1
    except ValueError:
        raise ZenohConfigError(
            "ZENOH_ROUTER_CHECK_ATTEMPTS must be a whole number (0 waits for ever, a negative one does not look), "
            f"got {_quoted(text)}"
        ) from None
    return math.inf if attempts == 0 else max(0, attempts)


def is_humble(environ: Mapping[str, str]) -> bool:
    """Return True if Zenoh keys and tokens must have the format of Humble, not the format of later distributions.

    Raises:
        ZenohConfigError: the variable `FORMAT_VARIABLE` has another value than ``humble``.
    """
    text = environ.get(FORMAT_VARIABLE, "")
    if text not in ("", "humble"):
        raise ZenohConfigError(
            f"{FORMAT_VARIABLE} must be 'humble', or empty for later distributions, got {_quoted(text)}"
        )
    return text == "humble"


def insert_setting(config: zenoh.Config, key: str, value: str, *, where: str) -> None:
    """Set a key of a configuration to a JSON5 text.

    Raises:
        ZenohConfigError: Zenoh refuses the key or value; the text begins with `where`, the origin of the value.
    """
    _require_shallow(value, f"{where}: {key}")
    try:
        config.insert_json5(key, value)
    except zenoh.ZError as error:
        raise ZenohConfigError(f"{where}: {key}={_quoted(value)}: {error_text(error)}") from None


def configured_endpoints(config: zenoh.Config, kind: Literal["listen", "connect"]) -> list[str]:
    """Return the endpoints to listen on, or to connect to, that apply in the mode of a configuration."""
    endpoints = json.loads(config.get_json(f"{kind}/endpoints"))
    if isinstance(endpoints, dict):  # one list for each mode
        endpoints = endpoints.get(json.loads(config.get_json("mode")) or "peer") or []
    return [str(endpoint) for endpoint in endpoints]


def _configuration(
    environ: Mapping[str, str], variable: str, defaults: Mapping[str, object], warn: Callable[[str], None]
) -> zenoh.Config:
    path = environ.get(variable, "")
    if path:
        try:
            _require_shallow(Path(path).read_text("utf-8", "replace"), f"{variable}={_quoted(path)}")
            config: zenoh.Config = zenoh.Config.from_file(path)
        except (zenoh.ZError, OSError) as error:
            raise ZenohConfigError(f"{variable}={_quoted(path)}: {error_text(error)}") from None
    else:
        config = zenoh.Config()
        for key, value in defaults.items():
            insert_setting(config, key, json.dumps(value), where="defaults of rmw_zenoh")
    for pair in filter(None, environ.get("ZENOH_CONFIG_OVERRIDE", "").split(";")):
        key, equals, value = pair.partition("=")
        try:
            if not equals or not value:
                raise ZenohConfigError(f"ZENOH_CONFIG_OVERRIDE: expected key=value, found {_quoted(pair)}")
            insert_setting(config, key, value, where="ZENOH_CONFIG_OVERRIDE")
        except ZenohConfigError as error:
            hint = "; texts need quotes" if value and value.strip().isalpha() else ""
            warn(f"{error}{hint}; this pair has no effect")
    return config


def _require_shallow(text: str, where: str) -> None:
    depth = 0
    for bracket in _BRACKET.findall(text):
        depth += 1 if bracket in "[{" else -1
        if depth > _MAX_DEPTH:
            raise ZenohConfigError(f"{where}: expected at most {_MAX_DEPTH} nested brackets, found more")


def _quoted(text: str) -> str:
    return printable(repr(text if len(text) <= _MAX_QUOTED_CHARS else text[:_MAX_QUOTED_CHARS] + "..."))


def error_text(error: Exception) -> str:
    """Return the text of a Zenoh error without locations in Zenoh's sources and names of its types."""
    text = _SOURCE_LOCATION.sub("", str(error))
    message = _MESSAGE.search(text)
    if message is None:
        return printable(text.strip())
    reason = message[1].replace('\\"', '"').split("\\n")[-1].strip(" =")
    location = _LINE_COLUMN.search(text)
    return printable(f"{reason} (line {location[1]}, column {location[2]})" if location else reason)
