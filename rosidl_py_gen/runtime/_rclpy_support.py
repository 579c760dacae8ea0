"""Internal functions of the runtime that the packages in `rosidl_py_gen/ros_compat` (rclpy and its companions) use.

They are not a public interface. These packages may import only public names and this module. They have their own
classes for parameters, descriptors and profiles, so the functions of this module have plain values as parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.runtime.actions.states import MIN_RESULT_RETENTION_NS as MIN_RESULT_RETENTION_NS
from rosidl_py_gen.runtime.actions.states import RCLPY_RULES as RCLPY_RULES
from rosidl_py_gen.runtime.actions.states import GoalTable as GoalTable
from rosidl_py_gen.runtime.names import NameFault as NameFault
from rosidl_py_gen.runtime.names import NameRule as NameRule
from rosidl_py_gen.runtime.names import find_full_name_fault as find_full_name_fault
from rosidl_py_gen.runtime.names import find_name_fault as find_name_fault
from rosidl_py_gen.runtime.names import find_namespace_fault as find_namespace_fault
from rosidl_py_gen.runtime.names import find_node_name_fault as find_node_name_fault
from rosidl_py_gen.runtime.parameters.values import EMPTY_LIST_REASON as EMPTY_LIST_REASON
from rosidl_py_gen.runtime.parameters.values import RELATIVE_TOLERANCE as RELATIVE_TOLERANCE
from rosidl_py_gen.runtime.parameters.values import SEPARATOR as SEPARATOR
from rosidl_py_gen.runtime.parameters.values import UNDECLARED_REASON as UNDECLARED_REASON
from rosidl_py_gen.runtime.parameters.values import float_range_reason as float_range_reason
from rosidl_py_gen.runtime.parameters.values import integer_range_reason as integer_range_reason
from rosidl_py_gen.runtime.parameters.values import list_names as list_names
from rosidl_py_gen.runtime.parameters.values import read_only_reason as read_only_reason
from rosidl_py_gen.runtime.parameters.values import type_reason as type_reason
from rosidl_py_gen.runtime.transport.api import TopicKey

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.graph import Graph, NamesAndTypes
    from rosidl_py_gen.runtime.node.node import Node
    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint
    from rosidl_py_gen.runtime.transport.qos import QoSProfile


def wire_topics_of_node(node: Node, name: str, namespace: str, *, writers: bool) -> NamesAndTypes:
    """Return all topics that a node writes or reads, including topics of services, with their names in the middleware.

    Args:
        node: local node, which has discovered the other node.
        name: name of the other node.
        namespace: namespace of the other node.
        writers: return topics that the other node writes, else topics that it reads.
    """
    return node._of_node(name, namespace, writers=writers, demangle=False)


def start_rosout(node: Node, qos: QoSProfile) -> None:
    """Publish the log records of a node on ``/rosout`` with a QoS profile, unless the command line disables it."""
    node._start_rosout(qos)


@dataclass(frozen=True, slots=True)
class ServiceEndpoints:
    """Client or server of a service, with the GIDs and QoS profiles of its reader and writer.

    On Zenoh a client or server has one endpoint, which is both reader and writer.

    Attributes:
        service_type: ``pkg/srv/Name``, or the DDS type name of the reader if it is not a ROS type.
        service_type_hash: RIHS01 text of the service; empty before Lyrical, which is the first distribution to announce
            it.
    """

    node_name: str
    node_namespace: str
    service_type: str
    service_type_hash: str
    gids: tuple[bytes, ...]
    qos_profiles: tuple[QoSProfile, ...]


def service_endpoints(node: Node, service: str, *, servers: bool, has_one_endpoint: bool) -> list[ServiceEndpoints]:
    """Return the discovered servers or clients of a service.

    Args:
        node: local node, which has discovered the endpoints.
        service: fully qualified name of the service.
        servers: return servers, else clients.
        has_one_endpoint: the middleware has one endpoint for a client or server, like Zenoh, not a reader and a writer.
    """
    graph = node._refreshed_graph()
    requests, replies = TopicKey("request", service), TopicKey("reply", service)
    readers = graph.endpoints_on(requests if servers else replies, writers=False)
    writers = list(graph.endpoints_on(replies if servers else requests, writers=True))
    services = []
    for reader in readers:
        writer = _writer_of_service(graph, reader, writers)
        if writer is not None:
            writers.remove(writer)
        endpoints = [reader] if writer is None or has_one_endpoint else [reader, writer]
        namespace, name = graph.node_of(reader)
        services.append(
            ServiceEndpoints(
                name,
                namespace,
                reader.service_type or reader.type,
                reader.service_hash,
                tuple(endpoint.guid for endpoint in endpoints),
                tuple(endpoint.qos for endpoint in endpoints),
            )
        )
    return services


def _writer_of_service(
    graph: Graph, reader: DiscoveredEndpoint, writers: list[DiscoveredEndpoint]
) -> DiscoveredEndpoint | None:
    """Return the writer that belongs to the same client or server as a reader; None if there is none.

    The writer has the same service identifier; without identifiers, it is the first writer of the reader's node.
    """
    candidates = [writer for writer in writers if writer.participant_guid == reader.participant_guid]
    for writer in candidates:
        if reader.service_id and reader.service_id == writer.service_id:
            return writer
    if reader.service_id:
        return None
    node = graph.node_of(reader)
    return next((writer for writer in candidates if graph.node_of(writer) == node), None)


def tells_publisher_gid() -> bool:
    """Return True if `MessageInfo` has the GID of the publisher in the selected distribution (Lyrical and later)."""
    return Distribution.selected().is_since("lyrical")
