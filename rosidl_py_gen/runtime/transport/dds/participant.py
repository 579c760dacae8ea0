"""What participants of DDS have in common, whatever library they use: how ROS puts nodes and services on top of it.

Decides of which two endpoints a client or a server consists, and which one is made first: a server may answer as soon
as a client's writer is known, so the endpoint on the reply topic is (docs/internals/protocol.md 5.2).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.dds.discovery_info import DiscoveryInfoTopic
from rosidl_py_gen.runtime.transport.dds.names import entity_gid, entity_id, wire_name
from rosidl_py_gen.runtime.transport.dds.services import DdsClient, DdsServer
from rosidl_py_gen.runtime.transport.incompatibility import IncompatibilityKind
from rosidl_py_gen.runtime.transport.qos_matching import check_compatible
from rosidl_py_gen.runtime.transport.service_endpoints import ServicePeers
from rosidl_py_gen.runtime.transport.type_names import wire_type

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.transport.api import EndpointSpec, Reader, Writer
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import FastDdsInterop
    from rosidl_py_gen.runtime.transport.dds.services import ServiceWriter
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, DiscoveryEvent, NodeEntities
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.service_api import ServiceSpec


@dataclass(frozen=True, slots=True)
class DdsEndpoint:
    """A reader or writer to be made, as DDS names things.

    Attributes:
        client_id, service_id: of the client or server that it belongs to; see `entity_id`.
    """

    topic: str
    type: str
    qos: QoSProfile
    type_hash: str = ""
    client_id: str = ""
    service_id: str = ""
    ignore_local: bool = False


class DdsParticipant:
    """The part of a `port.Participant` that is the same for all of DDS."""

    middleware = "DDS"
    guid: bytes

    def __init__(self, fast_dds: FastDdsInterop) -> None:
        self.fast_dds = fast_dds
        self.service_peers = ServicePeers()
        self._entity_numbers = itertools.count(1)
        self._nodes: DiscoveryInfoTopic | None = None

    def create_writer(self, spec: EndpointSpec) -> Writer:
        """See `port.Participant`."""
        return self.make_writer(_dds_endpoint(spec))

    def create_reader(self, spec: EndpointSpec) -> Reader:
        """See `port.Participant`."""
        return self.make_reader(_dds_endpoint(spec))

    def make_writer(self, end: DdsEndpoint) -> ServiceWriter:
        """What sends samples. Raises `TransportError`."""
        raise NotImplementedError

    def make_reader(self, end: DdsEndpoint) -> Reader:
        """What receives samples. Raises `TransportError`."""
        raise NotImplementedError

    # ------------------------------------------------------------------------------------------------- services

    def create_client(self, service: ServiceSpec, qos: QoSProfile, *, node: int = 0) -> DdsClient:
        """See `port.Participant`."""
        own_id = entity_id(self.guid, next(self._entity_numbers))
        request, reply = _halves(service, qos)
        reader = self.make_reader(replace(reply, client_id=own_id))
        writer = self.make_writer(replace(request, client_id=own_id))
        return DdsClient(service, self.service_peers, reader, writer, entity_gid(own_id), self.fast_dds)

    def create_server(self, service: ServiceSpec, qos: QoSProfile, *, node: int = 0) -> DdsServer:
        """See `port.Participant`."""
        own_id = entity_id(self.guid, next(self._entity_numbers))
        request, reply = _halves(service, qos)
        writer = self.make_writer(replace(reply, service_id=own_id))
        reader = self.make_reader(replace(request, service_id=own_id))
        return DdsServer(service, self.service_peers, reader, writer, entity_gid(own_id), self.fast_dds)

    @property
    def services_unavailable_reason(self) -> str | None:
        """See `port.Participant`."""
        return self.fast_dds.refusal

    def incompatibility_reason(
        self, writer: DiscoveredEndpoint, reader: DiscoveredEndpoint
    ) -> IncompatibilityKind | None:
        """See `port.Participant`."""
        return None if check_compatible(writer.qos, reader.qos).matches else IncompatibilityKind.QOS

    # ---------------------------------------------------------------------------------------------------- nodes

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        """See `port.Participant`."""
        if self._nodes is not None:
            self._nodes.announce(nodes)

    def start_discovery_info(
        self, sink: Callable[[list[DiscoveryEvent]], None]
    ) -> Callable[[list[DiscoveryEvent]], None]:
        """Report to `sink` what others tell of their nodes; the sink for all other discovery is returned."""
        if self._nodes is not None:
            self._nodes.close()
        self._nodes = nodes = DiscoveryInfoTopic(self, sink)

        def take(events: list[DiscoveryEvent]) -> None:
            self.service_peers.apply(events)
            nodes.forward_events(events)

        return take

    def read_discovery_info(self) -> None:
        """Report what has arrived already."""
        if self._nodes is not None:
            self._nodes.read()

    def stop_discovery_info(self) -> None:
        """Announce and report nothing any more."""
        if self._nodes is not None:
            self._nodes.close()


def _dds_endpoint(spec: EndpointSpec) -> DdsEndpoint:
    name, type = wire_name(spec.channel), wire_type(spec.type)
    return DdsEndpoint(name, type, spec.qos, spec.type_hash, ignore_local=spec.ignore_local)


def _halves(service: ServiceSpec, qos: QoSProfile) -> tuple[DdsEndpoint, DdsEndpoint]:
    """Of the requests and of the replies."""
    requests, replies = map(wire_name, service.channels)
    asks, answers = (wire_type(f"{service.type}_{half}") for half in ("Request", "Response"))
    return (
        DdsEndpoint(requests, asks, qos, service.request_hash),
        DdsEndpoint(replies, answers, qos, service.response_hash),
    )
