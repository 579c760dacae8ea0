"""The narrow contract between ROS things (publishers, services, the graph) and whatever carries their bytes.

Bytes go in, bytes and discovery events come out; messages are never seen. Names of topics, services and types are those
of ROS; how they are spelled on the wire is the business of who carries them: `cyclone/participant.py` over DDS,
`zenoh/participant.py` over Zenoh, `memory.py` inside one process. Nothing above this file can tell which one it is.

Threads: `write` may be called from any thread. A sink is called by the bridge on the event loop's thread, perhaps while
the loop still waits, and takes what it wants from the queue of its reader.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Protocol

from rosidl_py_gen.errors import ExtraMissingError, RosidlError
from rosidl_py_gen.runtime.transport.discovery_events import TopicKey
from rosidl_py_gen.runtime.transport.qos import QoSProfile

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.transport.clock_functions import ClockFunctions
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, DiscoveryEvent, NodeEntities
    from rosidl_py_gen.runtime.transport.incompatibility import IncompatibilityKind
    from rosidl_py_gen.runtime.transport.samples import Payload, ReceiveQueue, Sink
    from rosidl_py_gen.runtime.transport.service_api import ServiceClientTransport, ServiceServerTransport, ServiceSpec


class TransportError(RosidlError):
    """The middleware refused something; the message carries its own words."""


class BackendMissingError(ExtraMissingError):
    """The user has to install the extra that brings the middleware."""


class DiscoveryRange(Enum):
    """How far discovery looks for peers."""

    SUBNET = "subnet"
    LOCALHOST = "localhost"
    OFF = "off"
    SYSTEM_DEFAULT = "system_default"


@dataclass(frozen=True, slots=True)
class DomainSettings:
    """What a context needs to know before it creates a participant.

    Attributes:
        discovery_range: how far discovery looks for peers.
        static_peers: hosts or addresses to contact directly, in the order given.
        cyclonedds_uri: the user's own configuration, XML or ``file://`` names separated by commas; may be empty.
        warnings: sentences to log once.
    """

    domain_id: int = 0
    discovery_range: DiscoveryRange = DiscoveryRange.SUBNET
    static_peers: tuple[str, ...] = ()
    cyclonedds_uri: str = ""
    warnings: tuple[str, ...] = ()


# ----------------------------------------------------------------------------------------------------------- contract


class Writer(Protocol):
    """What sends the samples of one endpoint."""

    @property
    def guid(self) -> bytes:
        """16 bytes, network order."""

    @property
    def handle(self) -> int:
        """Unsigned number that is unique among the writers of this machine's process.

        Source: docs/internals/protocol.md 5.1.
        """

    def write(self, data: Payload) -> bool:
        """Send a sample. Never blocks and never holds the GIL inside the middleware.

        Returns:
            False when a reliable reader is so far behind that the middleware wants us to wait; nothing was sent.
        """

    def matched_readers(self) -> list[bytes]:
        """GUIDs of the readers this writer sends to."""

    def has_readers(self) -> bool:
        """Whether anybody receives what is written; cheaper than listing them."""

    def all_acknowledged(self) -> bool:
        """True when every matched reliable reader confirmed everything written so far. Never blocks."""

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        """How often ``deadline`` or ``liveliness`` was not kept so far, or how many readers were ``matched``.

        None where the middleware does not tell.
        """

    def assert_liveliness(self) -> None:
        """Say that the publisher is alive (liveliness MANUAL_BY_TOPIC)."""

    def close(self) -> None:
        """Delete it; may be called twice."""


class Reader(Protocol):
    """What receives the samples of one endpoint, with its queue."""

    @property
    def guid(self) -> bytes:
        """16 bytes, network order."""

    @property
    def queue(self) -> ReceiveQueue:
        """Samples received and not taken yet."""

    def set_sink(self, sink: Sink | None) -> None:
        """Call `sink` on the loop's thread whenever samples were added to the queue."""

    def fetch(self) -> bool:
        """Move what has arrived into the queue, without calling the sink; returns whether there was anything."""

    def matched_writers(self) -> list[bytes]:
        """GUIDs of the writers this reader receives from."""

    def event_counts(self, event: str) -> tuple[int, ...] | None:
        """``deadline``: missed ones; ``liveliness``: publishers alive, and not alive; ``message_lost``: lost ones;
        ``matched``: writers that were.

        All so far; None where the middleware does not tell.
        """

    def writer_guid(self, handle: int) -> bytes | None:
        """The GUID behind a sample's writer handle; None when it was never matched or is long gone."""

    def close(self) -> None:
        """Delete it; may be called twice."""


@dataclass(frozen=True, slots=True)
class EndpointSpec:
    """A reader or writer to be made.

    Attributes:
        name: fully qualified, of the topic; as it is to stand on the wire when `avoid_ros_namespace_conventions`.
        type: ``pkg/msg/Name``.
        type_hash: RIHS01 text; may be empty.
        node: number of the node it belongs to, one of those announced; 0 means none.
        is_bare: without the prefix that ROS gives its topics, where there is one.
        ignore_local: no samples of writers of this participant.
        has_buffer: messages have, or may have, an unbounded array of bytes.
    """

    name: str
    type: str
    qos: QoSProfile
    type_hash: str = ""
    node: int = 0
    avoid_ros_namespace_conventions: bool = False
    ignore_local: bool = False
    has_buffer: bool = False

    @property
    def channel(self) -> TopicKey:
        """Where it meets others."""
        return TopicKey("bare" if self.avoid_ros_namespace_conventions else "topic", self.name)


# -------------------------------------------------------------------------------------------------------- participants


class Participant(Protocol):
    """One member of a domain: makes endpoints, reports discovery, and says when something arrived.

    `node` is the number of the node that an endpoint belongs to, one of those announced; 0 means none.
    """

    @property
    def guid(self) -> bytes:
        """16 bytes, network order."""

    @property
    def middleware(self) -> str:
        """``DDS`` or what else it is, for people."""

    @property
    def library(self) -> str:
        """The C library that carries it, its version and file; empty where there is none to choose."""

    @property
    def capabilities(self) -> Mapping[str, str]:
        """What depends on that library, for people: each ``"yes"`` or why not."""

    @property
    def services_unavailable_reason(self) -> str | None:
        """Why services of peers on Fast DDS cannot be used; None when they can."""

    def incompatibility_reason(
        self, writer: DiscoveredEndpoint, reader: DiscoveredEndpoint
    ) -> IncompatibilityKind | None:
        """Return why a writer and a reader of one topic and type are not connected; None when they are."""

    def create_writer(self, spec: EndpointSpec) -> Writer:
        """Raises `TransportError` when the middleware refuses."""

    def create_reader(self, spec: EndpointSpec) -> Reader:
        """Raises `TransportError`."""

    def create_client(self, service: ServiceSpec, qos: QoSProfile, *, node: int = 0) -> ServiceClientTransport:
        """Raises `TransportError`."""

    def create_server(self, service: ServiceSpec, qos: QoSProfile, *, node: int = 0) -> ServiceServerTransport:
        """Raises `TransportError`."""

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        """Tell others which nodes we have, by number: all of them, each time. From any thread."""

    def set_discovery_sink(self, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        """Report discovery to `sink`, on the loop's thread, beginning with all that is known already."""

    def report_discovery(self) -> None:
        """Report now what was discovered and not reported yet; on the loop's thread, or where no loop runs."""

    def set_wakeup(self, notify: Callable[[], None] | None) -> None:
        """Call `notify`, from whatever thread, when `take_ready_sinks` has something. For whoever cannot watch
        `fileno`."""

    def fileno(self) -> int | None:
        """A descriptor that is readable while `take_ready_sinks` has something; None: only `set_wakeup` tells."""

    def take_ready_sinks(self) -> list[Sink]:
        """The sinks that have something to do, each once; the caller calls them on the loop's thread."""

    def detach_after_fork(self) -> None:
        """In a forked child: touch nothing of what was inherited, now and later."""

    def close(self) -> None:
        """Delete everything; may be called twice."""


class Transport(Protocol):
    """Something that can join a domain."""

    clocks: ClockFunctions

    def open(self, settings: DomainSettings, enclave: str = "/") -> Participant:
        """Join the domain; settings that the transport does not know have no effect."""
