"""Discovery events of a transport: participants, their nodes, and endpoints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeAlias

from rosidl_py_gen.runtime.transport.qos import QoSProfile

GUID_PREFIX_BYTES = 12
"""Length of the part of a GUID that all endpoints of a DDS participant share."""


@dataclass(frozen=True, slots=True)
class ParticipantDiscovered:
    """A participant was discovered (own ones included).

    Attributes:
        enclave: None if the participant does not announce that it is a ROS participant.
    """

    guid: bytes
    enclave: str | None


@dataclass(frozen=True, slots=True)
class NodeEntities:
    """Node of a participant, and the GIDs of its endpoints."""

    namespace: str
    name: str
    reader_gids: frozenset[bytes]
    writer_gids: frozenset[bytes]


@dataclass(frozen=True, slots=True)
class NodesAnnounced:
    """The participant with that GUID announced all its nodes.

    Attributes:
        is_humble: the announcement has the layout of Humble and earlier; None if it does not tell.
    """

    guid: bytes
    nodes: tuple[NodeEntities, ...]
    is_humble: bool | None = None


class TopicKey(NamedTuple):
    """Topic on which readers and writers match.

    Attributes:
        kind: topic of ROS, requests or replies of a service, or a topic without the naming conventions of ROS.
        name: fully qualified name of the topic or service; the name on the wire if the kind is ``unmangled``.
    """

    kind: Literal["topic", "request", "reply", "unmangled"]
    name: str

    @classmethod
    def of_topic(cls, name: str, qos: QoSProfile) -> TopicKey:
        """Return the key of a topic whose endpoint has that profile."""
        return cls("unmangled" if qos.avoid_ros_namespace_conventions else "topic", name)


@dataclass(frozen=True, slots=True)
class DiscoveredEndpoint:
    """A reader or writer was discovered (own ones included), or its data changed.

    Attributes:
        guid: 16 bytes in network order, as ROS shows it.
        participant_guid: GUID of the endpoint's participant.
        type: of the message, ``pkg/msg/Name`` or ``pkg/srv/Name_Request``; the name on the wire if that is not one of
            ROS.
        type_hash: RIHS01 text of the message; empty if not announced.
        service_id: identifier that both endpoints of one client or server share; may be empty.
        service_hash: RIHS01 text of the service, if announced: instead of those of its messages (Zenoh), or with them.
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
        """``pkg/srv/Name`` if the type is a request or response of a service; else None."""
        name, _, section = self.type.rpartition("_")
        return name if section in ("Request", "Response") and "/" in name else None


@dataclass(frozen=True, slots=True)
class EntityLost:
    """A participant or an endpoint disappeared."""

    guid: bytes


DiscoveryEvent: TypeAlias = "ParticipantDiscovered | NodesAnnounced | DiscoveredEndpoint | EntityLost"
