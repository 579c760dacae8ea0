"""Interface between the runtime and the transports for services: clients, servers, and requests and replies between
them.

Each client's transport numbers its requests. How a peer identifies the origin of a request or reply is up to the
transport. Thread: loop, except for `send`, which may be called from any thread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias

from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, EndpointSpec, Payload, Sink, TopicKey
from rosidl_py_gen.runtime.transport.qos import QoSProfile


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
        is_complete: all discovered endpoints of servers are matched, so only another endpoint changes the availability.
    """

    is_available: bool = False
    request_queue_depth: int = 0
    incompatible_server: IncompatiblePeer | None = None
    is_complete: bool = True

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
