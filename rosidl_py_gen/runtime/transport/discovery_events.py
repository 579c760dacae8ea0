"""What a transport reports of who is there: participants, their nodes, and endpoints by where they meet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.transport.qos import QoSProfile


@dataclass(frozen=True, slots=True)
class ParticipantDiscovered:
    """A participant was discovered (own ones included).

    Attributes:
        enclave: None when it does not say that it is a ROS participant.
    """

    guid: bytes
    enclave: str | None


@dataclass(frozen=True, slots=True)
class NodeEntities:
    """One node of a participant, and the GUIDs of its endpoints."""

    namespace: str
    name: str
    reader_gids: frozenset[bytes]
    writer_gids: frozenset[bytes]


@dataclass(frozen=True, slots=True)
class NodesAnnounced:
    """A participant, of that GUID, told which nodes it has: all of them, each time."""

    guid: bytes
    nodes: tuple[NodeEntities, ...]


class TopicKey(NamedTuple):
    """Where readers and writers meet: a topic, the requests or the replies of a service, or what ROS has no name for.

    Attributes:
        name: fully qualified, of the topic or the service; of a bare one as it is on the wire.
    """

    kind: Literal["topic", "request", "reply", "bare"]
    name: str


@dataclass(frozen=True, slots=True)
class DiscoveredEndpoint:
    """A reader or writer was discovered (own ones included), or its data changed.

    Attributes:
        guid: 16 bytes in network order, as ROS shows it.
        participant_guid: of the participant it belongs to.
        type: of the message, ``pkg/msg/Name`` or ``pkg/srv/Name_Request``; as it is on the wire where that is no name
            of ROS.
        type_hash: RIHS01 text of the message; empty when the endpoint does not tell.
        service_id: of a service, what both endpoints of one client or server have in common; may be empty.
        service_hash: RIHS01 text of the service, where that is told in place of those of its messages.
        wire_name: what the middleware calls the topic.
        wire_type: what it calls the type.
    """

    guid: bytes
    participant_guid: bytes
    is_writer: bool
    channel: TopicKey
    type: str
    qos: QoSProfile
    type_hash: str = ""
    service_id: str = ""
    service_hash: str = ""
    wire_name: str = ""
    wire_type: str = ""

    @property
    def service_type(self) -> str | None:
        """``pkg/srv/Name`` of ``pkg/srv/Name_Request``; None when it is no half of a service."""
        name, _, half = self.type.rpartition("_")
        return name if half in ("Request", "Response") and "/" in name else None


@dataclass(frozen=True, slots=True)
class EntityLost:
    """A participant or an endpoint disappeared."""

    guid: bytes


DiscoveryEvent: TypeAlias = "ParticipantDiscovered | NodesAnnounced | DiscoveredEndpoint | EntityLost"
