"""Common part of DDS participants, without calls of the DDS library: topics, services and nodes of ROS.

A client or server consists of two endpoints. That of the reply topic is created first: a server may reply as soon as it
knows the client's request writer (docs/internals/protocol.md 5.2).
"""

from __future__ import annotations

import itertools
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.dds.discovery_info import DiscoveryInfoTopic
from rosidl_py_gen.runtime.transport.dds.names import entity_gid, entity_id
from rosidl_py_gen.runtime.transport.dds.services import DdsClient, DdsServer, ServiceWriter
from rosidl_py_gen.runtime.transport.matching import IncompatibilityKind, check_compatible
from rosidl_py_gen.runtime.transport.service_endpoints import ServicePeers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from rosidl_py_gen.runtime.transport.api import EndpointSpec, Reader, Writer
    from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.interop import FastDdsInterop
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, DiscoveryEvent, NodeEntities
    from rosidl_py_gen.runtime.transport.qos import QoSProfile
    from rosidl_py_gen.runtime.transport.service_api import ServiceSpec


class DdsParticipant:
    """Part of a `Participant` that is the same with every DDS library."""

    middleware = "DDS"
    guid: bytes

    def __init__(self, fast_dds: FastDdsInterop, ros_distro: str) -> None:
        self.fast_dds = fast_dds
        self._ros_distro = ros_distro
        self.service_peers = ServicePeers()
        self._entity_numbers = itertools.count(1)
        self._discovery_info: DiscoveryInfoTopic | None = None

    def create_writer(self, spec: EndpointSpec) -> ServiceWriter:
        raise NotImplementedError

    def create_reader(self, spec: EndpointSpec) -> Reader:
        raise NotImplementedError

    def create_client(self, service: ServiceSpec, qos: QoSProfile, *, node: int = 0) -> DdsClient:
        own_id = entity_id(self.guid, next(self._entity_numbers))
        request, reply = service.endpoints(qos)
        reader = self.create_reader(replace(reply, client_id=own_id))
        with _closed_on_failure(reader):
            writer = self.create_writer(replace(request, client_id=own_id))
        return DdsClient(self, service, reader, writer, entity_gid(own_id))

    def create_server(self, service: ServiceSpec, qos: QoSProfile, *, node: int = 0) -> DdsServer:
        own_id = entity_id(self.guid, next(self._entity_numbers))
        request, reply = service.endpoints(qos)
        writer = self.create_writer(replace(reply, service_id=own_id))
        with _closed_on_failure(writer):
            reader = self.create_reader(replace(request, service_id=own_id))
        return DdsServer(self, service, reader, writer, entity_gid(own_id))

    def service_refusal(self, service: ServiceSpec) -> str | None:
        """Return why servers of one service on Fast DDS cannot be used; None if they can."""
        return self.fast_dds.refusal

    @property
    def services_unavailable_reason(self) -> str | None:
        return self.fast_dds.refusal

    def incompatibility_reason(
        self, writer: DiscoveredEndpoint, reader: DiscoveredEndpoint
    ) -> IncompatibilityKind | None:
        return None if check_compatible(writer.qos, reader.qos).matches else IncompatibilityKind.QOS

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        if self._discovery_info is not None:
            self._discovery_info.announce(nodes)

    def start_discovery_info(
        self, sink: Callable[[list[DiscoveryEvent]], None]
    ) -> Callable[[list[DiscoveryEvent]], None]:
        """Report nodes of peers to `sink`; return the sink for all other discovery events."""
        self.stop_discovery_info()
        self._discovery_info = discovery_info = DiscoveryInfoTopic(self, sink, self._ros_distro)

        def on_events(events: list[DiscoveryEvent]) -> None:
            self.service_peers.apply(events)
            discovery_info.forward_events(events)

        return on_events

    def read_discovery_info(self) -> None:
        """Report the announcements that were received already."""
        if self._discovery_info is not None:
            self._discovery_info.read()

    def stop_discovery_info(self) -> None:
        """Stop announcing and reporting nodes."""
        if self._discovery_info is not None:
            self._discovery_info.close()


@contextmanager
def _closed_on_failure(endpoint: Reader | Writer) -> Iterator[None]:
    """Close an endpoint if the other one of its pair cannot be created, because permissions may allow only one."""
    try:
        yield
    except BaseException:
        endpoint.close()
        raise
