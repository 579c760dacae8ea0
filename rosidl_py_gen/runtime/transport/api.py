"""Interface between the runtime (publishers, services, the graph) and the transports.

A transport sends and receives bytes and reports discovery events; it never sees messages. Names of topics, services and
types are names of ROS; each transport converts them to names on the network. Code above this module does not depend on
the transport, except that error texts, `rosidl-py doctor` and `get_rmw_implementation_identifier` read
`Participant.middleware`.

Thread rules: `Writer.write` may be called from any thread. The loop binding calls sinks on the thread of the event
loop, maybe inside the loop's `select`. A sink pops samples from the queue of its reader.

Services: each client's transport numbers its requests. How a peer identifies the origin of a request or reply is up to
the transport. Thread: loop, except for `send`, which may be called from any thread.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, TypeAlias

from rosidl_py_gen.cdr.layout import Alignment
from rosidl_py_gen.errors import DecodeError, ExtraMissingError, RosidlError
from rosidl_py_gen.runtime.transport.qos import History, QoSProfile

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.runtime.transport.endpoint_index import EndpointIndex
    from rosidl_py_gen.runtime.transport.qos import IncompatibilityKind

GUID_PREFIX_BYTES = 12
"""Length of the part of a GUID that all endpoints of a DDS participant share."""


@dataclass(frozen=True, slots=True)
class ParticipantDiscovered:
    """Event: a participant was discovered (own ones included).

    Attributes:
        enclave: None if the participant is not of ROS.
        vendor: RTPS id of the vendor; empty if unknown; None if the GUID begins with it.
    """

    guid: bytes
    enclave: str | None
    vendor: bytes | None = None


@dataclass(frozen=True, slots=True)
class NodeEntities:
    """Node that a participant has announced, with the GIDs of the node's endpoints."""

    namespace: str
    name: str
    reader_gids: frozenset[bytes]
    writer_gids: frozenset[bytes]


@dataclass(frozen=True, slots=True)
class NodesAnnounced:
    """Event: a participant has announced all of its current nodes, which are in `nodes`.

    `is_humble` is True if the participant is of Humble or earlier, None if unknown.
    """

    guid: bytes
    nodes: tuple[NodeEntities, ...]
    is_humble: bool | None = None


class TopicKey(NamedTuple):
    """Identity of a topic: readers and writers match only if their keys are equal.

    Attributes:
        kind: topic of ROS, requests or replies of a service, or a topic without the naming conventions of ROS.
        name: fully qualified name of the topic or service; the name on the network if the kind is ``unmangled``.
    """

    kind: Literal["topic", "request", "reply", "unmangled"]
    name: str

    @classmethod
    def of_topic(cls, name: str, qos: QoSProfile) -> TopicKey:
        """Return the key of the topic `name`; `qos` states if the name has the naming conventions of ROS."""
        return cls("unmangled" if qos.avoid_ros_namespace_conventions else "topic", name)


@dataclass(frozen=True, slots=True)
class DiscoveredEndpoint:
    """Event: a reader or writer was discovered (own ones included), or its data changed.

    Attributes:
        guid: 16 bytes in network order, as ROS displays a GID.
        participant_guid: GUID of the endpoint's participant.
        type: type of the message, ``pkg/msg/Name`` or ``pkg/srv/Name_Request``; the type name on the wire if it does
            not have the form of a ROS type.
        type_hash: RIHS01 text of the message; empty if not announced.
        service_id: identifier that both endpoints of one client or server share; may be empty.
        service_hash: RIHS01 text of the service; may be empty. Zenoh peers announce it instead of the hashes of the
            service's messages.
        wire_name: name of the topic in the middleware.
        wire_type: name of the type in the middleware.
    """

    guid: bytes
    participant_guid: bytes
    is_writer: bool
    topic_key: TopicKey
    type: str
    qos: QoSProfile
    type_hash: str = ""
    service_id: str = ""
    service_hash: str = ""
    wire_name: str = ""
    wire_type: str = ""

    @property
    def service_type(self) -> str | None:
        """Name ``pkg/srv/Name`` of the service if the type is a request or response of a service; else None."""
        name, _, section = self.type.rpartition("_")
        return name if section in ("Request", "Response") and "/" in name else None


@dataclass(frozen=True, slots=True)
class EntityLost:
    """Event: the participant or endpoint with the GUID `guid` disappeared."""

    guid: bytes


DiscoveryEvent: TypeAlias = "ParticipantDiscovered | NodesAnnounced | DiscoveredEndpoint | EntityLost"


@dataclass(frozen=True, slots=True)
class ClockFunctions:
    """Clocks of a transport: clocks of this machine, or clocks of a test with virtual time.

    Attributes:
        system_ns: nanoseconds since the epoch.
        steady_ns: nanoseconds of a monotonic clock. The event loop's `time` must run at the same speed.
    """

    system_ns: Callable[[], int] = time.time_ns
    steady_ns: Callable[[], int] = time.monotonic_ns


SYSTEM_CLOCKS = ClockFunctions()
"""System and monotonic clock of this machine, as `ClockFunctions`."""


Payload: TypeAlias = "bytes | memoryview"
"""Serialized sample with its 4-byte encapsulation header. A large payload is a read-only view that shares memory with
DDS."""

Sample: TypeAlias = "tuple[Payload, int, int, int, int | None]"
"""Payload, source timestamp (ns since the epoch), local handle of the writer, time of reception (ns), and the writer's
sequence number if the transport reports it.

A plain tuple: it is created for each message, and a named tuple costs ten times as much.
"""

Sink: TypeAlias = "Callable[[], Callable[[], None] | None]"
"""Internal function that takes received samples or events from a queue, in contrast to a callback, which is a function
of the user.

A sink never calls a function of the user. It may return a function that does, which the caller of the sink calls a
moment later.
"""

_NETWORK_ALIGN = Alignment.NETWORK  # an attribute of a class takes 12 ns more
_PADDING = Alignment.PADDING[_NETWORK_ALIGN]


def pad_to_4_bytes(data: Payload) -> bytes:
    """Return the sample padded with zeros to a multiple of 4 bytes.

    Without padding DDS would send up to three bytes of unrelated memory after the sample.
    """
    return bytes(data) + _PADDING[len(data) % _NETWORK_ALIGN]


class ReceiveQueue:
    """Queue of received samples that were not taken yet.

    With KEEP_LAST, a full queue drops its oldest sample and counts it in `dropped`; with KEEP_ALL, nothing is dropped.

    Thread: any may pop; a lock of the transport serializes `push`. Appending and popping are single operations of a
    deque. The deque has no `maxlen`: another thread may pop between a check of the length and an append that drops, and
    `dropped` would count a sample that was received.
    """

    __slots__ = ("depth", "dropped", "items")

    def __init__(self, qos: QoSProfile) -> None:
        self.depth = sys.maxsize if qos.history is History.KEEP_ALL else max(1, qos.depth)
        self.items: deque[Sample] = deque()
        self.dropped = 0

    def push(self, sample: Sample) -> None:
        """Add the newest sample; drop and count the oldest one if the queue is then longer than its depth."""
        self.items.append(sample)
        if len(self.items) > self.depth:
            self.drop_oldest()

    def drop_oldest(self) -> None:
        """Drop the oldest sample and count it, unless other threads have emptied the queue."""
        try:  # `suppress` takes as long as all the rest
            self.items.popleft()
        except IndexError:
            return
        self.dropped += 1


class TransportError(RosidlError):
    """Raised if the middleware refuses an operation; the text contains the middleware's reason."""


class SecurityError(TransportError):
    """Raised if security (SROS 2) prevents a context or endpoint: because of a file, the DDS library or permissions."""


class BackendMissingError(ExtraMissingError):
    """Raised if the pip extra that contains the middleware is not installed."""


class DiscoveryRange(Enum):
    """Range in which peers are discovered."""

    SUBNET = "subnet"
    LOCALHOST = "localhost"
    OFF = "off"
    SYSTEM_DEFAULT = "system_default"


@dataclass(frozen=True, slots=True)
class SecurityEnclave:
    """SROS 2 enclave of a secured context; all its files exist.

    Attributes:
        name: announced name of the enclave.
        folder: folder of the files.
        is_enforced: the context must not start unsecured, even if the DDS library has no security.
    """

    name: str
    folder: str
    is_enforced: bool


@dataclass(frozen=True, slots=True)
class DomainSettings:
    """Settings with which a context creates its participant.

    Attributes:
        static_peers: hosts or addresses to contact directly, in this order.
        cyclonedds_uri: configuration of the user, XML or ``file://`` names separated by commas; may be empty.
        warnings: texts to log once.
        security: enclave of the context; None if it is not secured.
        ros_distro: name of the ROS distribution that was selected; may be empty.
    """

    domain_id: int = 0
    discovery_range: DiscoveryRange = DiscoveryRange.SUBNET
    static_peers: tuple[str, ...] = ()
    cyclonedds_uri: str = ""
    warnings: tuple[str, ...] = ()
    security: SecurityEnclave | None = None
    ros_distro: str = ""


# ----------------------------------------------------------------------------------------------------------- contract


class _Endpoint(Protocol):
    """Interface that writers and readers have in common."""

    @property
    def guid(self) -> bytes:
        """GUID of the endpoint, 16 bytes in network order."""

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        """Return the total counts of an event; None if the middleware does not report the event.

        Events of a writer: ``deadline`` (missed deadlines), ``liveliness`` (lost liveliness), ``matched`` (matched
        readers). Events of a reader: ``deadline``, ``liveliness`` (two counts: publishers alive, publishers not alive),
        ``message_lost`` (lost samples), ``matched`` (matched writers).
        """

    def close(self) -> None:
        """Delete the endpoint. May be called twice."""


class Writer(_Endpoint, Protocol):
    """Interface of the sender of one endpoint's samples."""

    @property
    def handle(self) -> int:
        """Unsigned number that is unique among the writers of this process (docs/internals/protocol.md 5.1)."""

    def write(self, data: Payload) -> bool:
        """Send a sample. Never blocks and never holds the GIL inside the middleware.

        Returns:
            False if a reliable reader is so far behind that the middleware would block; nothing was sent.
        """

    def matched_readers(self) -> list[bytes]:
        """Return the GUIDs of the matched readers."""

    def has_readers(self) -> bool:
        """Return True if a reader is matched; cheaper than `matched_readers`."""

    def all_acknowledged(self) -> bool:
        """Return True if every matched reliable reader has acknowledged all samples. Never blocks."""

    def assert_liveliness(self) -> None:
        """Assert that the publisher is alive (liveliness MANUAL_BY_TOPIC)."""


class Reader(_Endpoint, Protocol):
    """Interface of the receiver of one endpoint's samples, which has a queue."""

    @property
    def queue(self) -> ReceiveQueue:
        """Received samples that were not taken yet."""

    def set_sink(self, sink: Sink | None) -> None:
        """Call `sink` on the loop's thread whenever samples were added to the queue; None: stop calling."""

    def fetch(self) -> bool:
        """Move received samples into the queue without calling the sink; return True if there were samples."""

    def matched_writers(self) -> list[bytes]:
        """Return the GUIDs of the matched writers."""

    def writer_guid(self, handle: int) -> bytes | None:
        """Return the GUID of the writer whose local handle a sample contains; None if unknown or expired."""


@dataclass(frozen=True, slots=True)
class EndpointSpec:
    """Reader or writer to be created.

    Attributes:
        type: ``pkg/msg/Name``, or ``pkg/srv/Name_Request`` and ``pkg/srv/Name_Response`` of a service.
        type_hash: RIHS01 text; may be empty.
        node: number of the announced node that the endpoint belongs to; 0 for none.
        ignore_local: do not receive samples of writers of the same participant.
        has_buffer: messages have, or may have, an unbounded array of bytes.
        client_id: identifier of the client that the endpoint belongs to, if any.
        service_id: identifier of the server that the endpoint belongs to, if any.
        service_hash: RIHS01 text of the service that the endpoint belongs to, if any.
    """

    topic_key: TopicKey
    type: str
    qos: QoSProfile
    type_hash: str = ""
    node: int = 0
    ignore_local: bool = False
    has_buffer: bool = False
    client_id: str = ""
    service_id: str = ""
    service_hash: str = ""


# -------------------------------------------------------------------------------------------------------- participants


class Participant(Protocol):
    """Interface of a member of a domain, which creates endpoints, and reports discovery and received samples.

    The `create_` methods raise `TransportError` if the middleware refuses.
    """

    @property
    def guid(self) -> bytes:
        """GUID of the participant, 16 bytes in network order."""

    @property
    def endpoint_index(self) -> EndpointIndex:
        """Index of the discovered endpoints and participants.

        The discovery sink is called after the index was changed.
        """

    @property
    def middleware(self) -> str:
        """Name of the middleware for people, such as ``DDS``."""

    @property
    def library(self) -> str:
        """Text with version and file of the middleware's C library; empty if the user cannot choose the library."""

    @property
    def capabilities(self) -> Mapping[str, str]:
        """Names of capabilities that depend on the C library, each with ``"yes"`` or the reason why it is missing."""

    @property
    def services_unavailable_reason(self) -> str | None:
        """Reason why services of Fast DDS peers cannot be used; None if they can be used."""

    def incompatibility_reason(
        self, writer: DiscoveredEndpoint, reader: DiscoveredEndpoint
    ) -> IncompatibilityKind | None:
        """Return a text that states what keeps a writer and a reader of one topic and type from matching.

        Returns None if they match.
        """

    def create_writer(self, spec: EndpointSpec) -> Writer:
        """Create the writer that `spec` describes."""

    def create_reader(self, spec: EndpointSpec) -> Reader:
        """Create the reader that `spec` describes."""

    def create_client(self, service: ServiceSpec) -> TransportClient:
        """Create a client of a service."""

    def create_server(self, service: ServiceSpec) -> TransportServer:
        """Create a server of a service."""

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        """Announce all nodes of the participant, given by number, to peers. Thread: any."""

    def set_discovery_sink(self, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        """Pass discovery events to `sink` on the loop's thread, starting with everything that is known already.

        The context's own participant, nodes and endpoints are reported, too.
        """

    def report_discovery(self) -> None:
        """Pass all discovery events that were not reported yet to the sink.

        Thread: the loop's, or any if no loop runs.
        """

    def set_wakeup(self, notify: Callable[[], None] | None) -> None:
        """Set a function that is called from any thread when `take_ready_sinks` has sinks, for loops that cannot watch
        `fileno`.

        With None, no function is called any more.
        """

    def fileno(self) -> int | None:
        """Return a file descriptor that is readable while `take_ready_sinks` has sinks.

        Returns None if loops must use `set_wakeup`.
        """

    def take_ready_sinks(self) -> list[Sink]:
        """Return the sinks that have samples or events to take, each once.

        The caller must call them on the loop's thread.
        """

    def detach_after_fork(self) -> None:
        """Stop using resources that were inherited from the parent process; called in a forked child."""

    def close(self) -> None:
        """Delete the participant and its endpoints. May be called twice."""


class Transport(Protocol):
    """Interface of a middleware that can join domains.

    A transport that supports security (SROS 2) has an attribute `has_security`, which is True.
    """

    clocks: ClockFunctions

    def open(self, settings: DomainSettings, enclave: str = "/") -> Participant:
        """Join the domain of `settings` as a participant that announces `enclave`; ignore unsupported settings."""


# ------------------------------------------------------------------------------------------------------------- services


def service_topic_keys(name: str, qos: QoSProfile) -> tuple[TopicKey, TopicKey]:
    """Return the topic of a service's requests and the topic of its replies."""
    if qos.avoid_ros_namespace_conventions:
        return TopicKey("unmangled", f"{name}Request"), TopicKey("unmangled", f"{name}Reply")
    return TopicKey("request", name), TopicKey("reply", name)


@dataclass(frozen=True, slots=True)
class ServiceSpec:
    """Name, type, hashes and QoS of a service, from which a transport creates a client or server.

    Attributes:
        name: fully qualified.
        type: ``pkg/srv/Name``.
        type_hash: RIHS01 text of the service; may be empty, as may be the hashes of its messages.
        node: number of the announced node that the client or server belongs to; 0 for none.
        is_compatible: returns False for an endpoint of the other side that must not be used, because it has another
            definition.
    """

    name: str
    type: str
    type_hash: str
    request_hash: str
    response_hash: str
    qos: QoSProfile
    node: int = 0
    is_compatible: Callable[[DiscoveredEndpoint], bool] = lambda _: True

    @property
    def topic_keys(self) -> tuple[TopicKey, TopicKey]:
        """Topic of the requests and topic of the replies."""
        return service_topic_keys(self.name, self.qos)

    @property
    def endpoints(self) -> tuple[EndpointSpec, EndpointSpec]:
        """Specifications of two endpoints, on the topic of the requests and on the topic of the replies."""
        requests, replies = self.topic_keys
        hash = self.type_hash
        return (
            EndpointSpec(requests, f"{self.type}_Request", self.qos, self.request_hash, service_hash=hash),
            EndpointSpec(replies, f"{self.type}_Response", self.qos, self.response_hash, service_hash=hash),
        )


class NoReply(NamedTuple):
    """Object that a client receives in place of a response if no server will answer its request.

    `reason` completes the sentence "the server of /add ...".
    """

    reason: str = "went away before it answered"


class IncompatiblePeer(NamedTuple):
    """Endpoint, by GUID, of a client or server that cannot be used, and the reason."""

    guid: bytes
    reason: str
    has_topics: bool = True
    """True if topics of the peer can be used, and its services could be used with another DDS library."""


@dataclass(frozen=True, slots=True)
class ServerAvailability:
    """Availability of the servers that one client can call.

    Attributes:
        is_available: a server is matched in both directions.
        request_queue_depth: this participant's share of the smallest request queue of the servers; 0 if unlimited.
        incompatible_server: a server that cannot be used, if no server can be used.
        is_matching_complete: all discovered endpoints of servers are matched, so only another endpoint changes the
            availability.
    """

    is_available: bool = False
    request_queue_depth: int = 0
    incompatible_server: IncompatiblePeer | None = None
    is_matching_complete: bool = True

    def __bool__(self) -> bool:
        return self.is_available


Reply: TypeAlias = "tuple[int, Payload | NoReply, bytes | None]"
"""Tuple of a received reply: number of the request; response or `NoReply`; GUID of the sender if known.

A plain tuple, because one is created for each reply.
"""
RequestId: TypeAlias = "Any"
"""Origin of a request; only the transport that created it knows its contents."""
Request: TypeAlias = "tuple[RequestId, Payload | IncompatiblePeer | DecodeError, bytes | None, int, int]"
"""Tuple of a received request: origin; the request; GUID of the sender if known; times of sending and reception in ns
since the epoch.

If the request cannot be served, an `IncompatiblePeer` or the error in the request's bytes replaces the request.
"""


class _ServiceEndpoint(Protocol):
    """Interface that clients and servers of a service have in common.

    Attributes:
        is_introspected: events are published, so servers must identify each request by the `gid` of its client.
        matches_by_hash: only endpoints with the same hash of the service exchange data.
    """

    is_introspected: bool
    matches_by_hash: bool

    @property
    def gid(self) -> bytes:
        """16 bytes that identify the client or server in ROS."""

    @property
    def endpoints(self) -> tuple[bytes, bytes]:
        """GUIDs under which the graph contains the reader and the writer of the client or server."""

    def connected(self) -> list[bytes]:
        """Return the GUIDs of the matched writers: of the servers for a client, of the clients for a server."""

    def all_acknowledged(self) -> bool:
        """Return True if the other side has acknowledged all requests, or all replies, that were sent."""

    def set_sink(self, sink: Sink | None) -> None:
        """Call `sink` on the loop's thread whenever a reply or request can be taken; None: stop calling."""

    def close(self) -> None:
        """Delete the client or server. May be called twice."""


class TransportClient(_ServiceEndpoint, Protocol):
    """Interface of a client of a service."""

    def send(self, data: bytes, timeout_s: float | None = None) -> int | None:
        """Send a request to all matched servers. Never blocks.

        Args:
            timeout_s: maximum time to wait for the response, if known.

        Returns:
            The number of the request, counted from 1; None if the caller must retry later.
        """

    def cancel(self, number: int) -> None:
        """Discard a request, because its response arrived, or because the caller no longer waits for it.

        Thread: loop.
        """

    def take(self) -> Reply | None:
        """Return the next received reply; None if there is none. Several servers may reply to one request."""

    def report_lost_requests(self) -> None:
        """Make `take` return a `NoReply`, after all received replies, for each request whose servers are all gone."""

    def servers(self) -> ServerAvailability:
        """Return the availability of servers; the result is cached until discovery changes."""

    def server_endpoints(self) -> frozenset[bytes]:
        """Return the GUIDs of all endpoints of servers, matched or not; the same object until an endpoint changes."""


class TransportServer(_ServiceEndpoint, Protocol):
    """Interface of a server of a service."""

    def take(self) -> Request | None:
        """Return the next received request; None if there is none."""

    def send(self, to: RequestId, data: bytes) -> bool:
        """Send a response to the request with origin `to`.

        Returns:
            False if the caller must retry later: the transport is busy, or the client might lose a response now.
        """

    def release(self) -> None:
        """Stop the flow control of responses, because the server closes and responses must be sent before."""

    def can_reach_client(self, to: RequestId) -> bool:
        """Return False if a response to the request with origin `to` would not arrive; True if unknown."""

    def request_origin(self, to: RequestId) -> tuple[bytes, int]:
        """Return the client's GID (16 bytes) and the number of the request, for service introspection events."""
