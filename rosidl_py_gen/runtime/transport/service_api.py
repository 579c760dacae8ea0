"""The part of the contract of `port.py` that is about services: the two ends of one, and what goes through them.

A request has a number, which its client's port gives; how the other side knows whose a request or a response is, is the
business of who carries it. Calls are made on the loop's thread, but for `send`, which may come from any.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

from rosidl_py_gen.runtime.transport.discovery_events import TopicKey

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.errors import DecodeError
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint
    from rosidl_py_gen.runtime.transport.samples import Payload, Sink


@dataclass(frozen=True, slots=True)
class ServiceSpec:
    """A service as its clients and servers announce it.

    Attributes:
        name: fully qualified.
        type: ``pkg/srv/Name``.
        type_hash: RIHS01 text of the service; may be empty, as those of its messages.
        is_bare: without the prefixes that ROS gives its names, where there are some.
        counts: whether an endpoint at the other side may be talked to, and is not one of another definition.
    """

    name: str
    type: str
    type_hash: str
    request_hash: str
    response_hash: str
    avoid_ros_namespace_conventions: bool = False
    is_compatible: Callable[[DiscoveredEndpoint], bool] = lambda _: True

    @property
    def channels(self) -> tuple[TopicKey, TopicKey]:
        """Where requests and replies meet."""
        if self.avoid_ros_namespace_conventions:
            return TopicKey("bare", f"{self.name}Request"), TopicKey("bare", f"{self.name}Reply")
        return TopicKey("request", self.name), TopicKey("reply", self.name)


class NoReply(NamedTuple):
    """In the place of a response: nobody will answer; the reason is read behind "the server of /add"."""

    reason: str = "went away before it answered"


class IncompatiblePeer(NamedTuple):
    """The endpoint of a peer that cannot be talked to, and why."""

    guid: bytes
    reason: str


@dataclass(frozen=True, slots=True)
class ServerAvailability:
    """The servers that a client has.

    Attributes:
        is_available: one is connected, both ways.
        keeps: how many requests of ours the server that keeps fewest keeps; 0 when all keep all.
        refused: one of them, where there are none but such that cannot be talked to.
    """

    is_available: bool = False
    request_queue_depth: int = 0
    incompatible_server: IncompatiblePeer | None = None

    def __bool__(self) -> bool:
        return self.is_available


Reply: TypeAlias = "tuple[int, Payload | NoReply, bytes | None]"
"""The number of the request, the response, and the GUID of who sent it, where that is known. A plain tuple, as one is
made for each."""
RequestId: TypeAlias = "Any"
"""Whom a response goes to; only the port that gave it knows what it is."""
Request: TypeAlias = "tuple[RequestId, Payload | IncompatiblePeer | DecodeError, bytes | None, int, int]"
"""Whom the response goes to, the request, the GUID of who sent it, where that is known, and when it was sent and
when it came, ns since the epoch; in place of a request who cannot be served, or what is wrong with the bytes."""


class ServiceClientTransport(Protocol):
    """The end of a service that asks."""

    @property
    def gid(self) -> bytes:
        """16 bytes by which ROS names it."""

    @property
    def endpoints(self) -> tuple[bytes, bytes]:
        """By which the graph knows it: the GUID of what reads, and of what writes."""

    def send(self, data: bytes, timeout_s: float | None = None) -> int | None:
        """Send a request to all servers that are connected. Never blocks.

        Args:
            timeout_s: how long the response is waited for at most, if that is known.

        Returns:
            The number of the request, counted from 1; None when it has to be tried again later.
        """

    def cancel(self, number: int) -> None:
        """Nobody waits for the response any more; it may have come. On the loop's thread."""

    def take(self) -> Reply | None:
        """The next reply that arrived; None when there is none. Several servers may answer one request."""

    def report_lost_requests(self) -> None:
        """Servers have left: add to the replies which requests nobody will answer, behind all that arrived before."""

    def servers(self) -> ServerAvailability:
        """Who is there; costs nothing while nothing changes."""

    def server_endpoints(self) -> frozenset[bytes]:
        """The GUIDs of all endpoints of servers, connected or not; the same object until they change."""

    def connected(self) -> list[bytes]:
        """The GUIDs of what is connected and sends replies."""

    def all_acknowledged(self) -> bool:
        """See `Writer`, for requests."""

    def set_sink(self, sink: Sink | None) -> None:
        """Call `sink` on the loop's thread whenever there is something to take."""

    def close(self) -> None:
        """Delete it; may be called twice."""


class ServiceServerTransport(Protocol):
    """The end of a service that answers."""

    @property
    def gid(self) -> bytes:
        """16 bytes by which ROS names it."""

    @property
    def endpoints(self) -> tuple[bytes, bytes]:
        """The GUIDs of its two endpoints, as those of a `ServiceClientTransport`."""

    def take(self) -> Request | None:
        """The next request that arrived; None when there is none."""

    def send(self, to: RequestId, data: bytes) -> bool:
        """Send a response; False when it has to be tried again later, also because clients may lose it now."""

    def release(self) -> None:
        """Send from now on as fast as possible, as the server closes."""

    def can_reach_client(self, to: RequestId) -> bool:
        """Whether a response would arrive, as far as that can be told."""

    def request_origin(self, to: RequestId) -> tuple[bytes, int]:
        """The client of a request, 16 bytes, and its number, as introspection shows them."""

    def all_acknowledged(self) -> bool:
        """See `Writer`, for responses."""

    def connected(self) -> list[bytes]:
        """The GUIDs of what is connected and sends requests."""

    def set_sink(self, sink: Sink | None) -> None:
        """Call `sink` on the loop's thread whenever there is something to take."""

    def close(self) -> None:
        """Delete it; may be called twice."""
