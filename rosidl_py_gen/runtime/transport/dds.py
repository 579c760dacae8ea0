"""What participants of DDS have in common, whatever library they use: how ROS puts nodes and services on top of it.

Decides how nodes are announced, by the topic `ros_discovery_info`, and when its writers are asked again; of which two
endpoints a client or a server consists, and which one is made first: a server may answer as soon as a client's writer
is known, so the endpoint on the reply topic is (protocol.md 5.2).
"""

from __future__ import annotations

import asyncio
import itertools
from typing import TYPE_CHECKING, Protocol

from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.runtime.logs.loggers import internal_logger
from rosidl_py_gen.runtime.names.dds import (
    DISCOVERY_TOPIC,
    DISCOVERY_TYPE,
    entity_gid,
    entity_id,
    reply_name,
    request_name,
    type_name,
)
from rosidl_py_gen.runtime.transport import nodes_message
from rosidl_py_gen.runtime.transport.interface import EndpointFound, Lost, NodesFound, ServiceEndpoints
from rosidl_py_gen.runtime.transport.matching import check_compatible
from rosidl_py_gen.runtime.transport.qos import DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.transport.interface import DiscoveryEvent, NodeEntities, Reader, Service, Writer
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

FAST_DDS_VENDOR = b"\x01\x0f"
"""First bytes of every GUID that Fast DDS makes (RTPS vendor id)."""

_PREFIX_BYTES = 12
"""The part of a GUID that all endpoints of a participant share."""
_READER_BIT = 0x04
"""In the last byte of a GUID: it is a reader's."""
_TYPE_HASH = HASHES["rmw_dds_common/msg/ParticipantEntitiesInfo"]
_WRITER_QOS = DEFAULT.keep_last(1).transient_local()
_READER_QOS = DEFAULT.keep_all().transient_local()
_SILENCES_S = (0.05, 0.2, 0.5)
"""A participant's graph message comes with its endpoints, or is lost: Fast DDS sends it as soon as it hears of our
reader, and Cyclone drops what comes from a writer it has not heard of. It would be sent again after 3 s."""


class _Host(Protocol):
    """What the topic of nodes needs of its participant."""

    guid: bytes

    def create_writer(self, topic: str, type: str, qos: QoSProfile, type_hash: str = "") -> Writer:
        """See `transport.Participant`."""

    def create_reader(
        self, topic: str, type: str, qos: QoSProfile, type_hash: str = "", *, ignore_local: bool = False
    ) -> Reader:
        """See `transport.Participant`."""


class NodeTopic:
    """The topic on which participants tell their nodes."""

    def __init__(self, participant: _Host, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        self._participant = participant
        self._sink = sink
        self._closed = False
        self._silent: set[bytes] = set()
        """Writers of graph messages of which none had come when they were found."""
        self._told: set[bytes] = set()
        """Writers of which one came."""
        self._writer = participant.create_writer(DISCOVERY_TOPIC, DISCOVERY_TYPE, _WRITER_QOS, _TYPE_HASH)
        self._reader = self._new_reader()

    def _new_reader(self) -> Reader:
        reader = self._participant.create_reader(
            DISCOVERY_TOPIC, DISCOVERY_TYPE, _READER_QOS, _TYPE_HASH, ignore_local=True
        )
        reader.set_sink(self._on_messages)
        return reader

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        """Write the whole state."""
        self._writer.write(nodes_message.encode(self._participant.guid, nodes.values()))

    def read(self) -> None:
        """Take in what has arrived."""
        # A writer of this process may have fetched already.
        if self._reader.fetch() or self._reader.queue.items:
            self._on_messages()

    def pass_on(self, events: list[DiscoveryEvent]) -> None:
        """Give the sink what discovery reports, and note whose messages are to come."""
        self._sink(events)
        for event in events:
            if isinstance(event, Lost):
                self._told.discard(event.guid)
                self._silent.discard(event.guid)
            elif isinstance(event, EndpointFound) and event.is_writer and event.topic == DISCOVERY_TOPIC:
                self._expect_message(event.guid)

    def _expect_message(self, writer: bytes) -> None:
        loop = running_loop()
        is_own = writer[:_PREFIX_BYTES] == self._participant.guid[:_PREFIX_BYTES]
        if loop is not None and not is_own and writer not in self._told:
            if not self._silent:
                loop.call_later(_SILENCES_S[0], self._ask_again, 1)
            self._silent.add(writer)

    def _ask_again(self, times: int) -> None:
        """Give writers that were not heard a new reader: they send to it what they have, and by now Cyclone listens."""
        self._silent -= self._told
        if self._closed or not self._silent:
            return
        old, self._reader = self._reader, self._new_reader()
        old.close()
        if times == len(_SILENCES_S):
            self._silent.clear()
        else:
            asyncio.get_running_loop().call_later(_SILENCES_S[times], self._ask_again, times + 1)

    def _on_messages(self) -> None:
        items = self._reader.queue.items
        found: list[DiscoveryEvent] = []
        while items:
            data, _, handle, _ = items.popleft()
            guid = self._reader.writer_guid(handle)
            if guid is None:
                continue
            self._told.add(guid)
            prefix = guid[:_PREFIX_BYTES]
            try:
                message = nodes_message.decode(data, prefix)
            except DecodeError as err:
                internal_logger().warning(f"ignored a graph message of participant {prefix.hex('.')}: {err}")
                continue
            found.append(NodesFound(message.participant_guid, tuple(message.nodes)))
        self._sink(found)

    def close(self) -> None:
        """Delete the endpoints; may be called twice."""
        self._closed = True
        self._reader.close()
        self._writer.close()


class DdsParticipant:
    """The part of a `transport.Participant` that is the same for all of DDS."""

    middleware = "DDS"
    ends_requests = False
    guid: bytes

    def __init__(self) -> None:
        self._entity_numbers = itertools.count(1)
        self._nodes: NodeTopic | None = None

    def create_writer(
        self,
        topic: str,
        type: str,
        qos: QoSProfile,
        type_hash: str = "",
        *,
        node: int = 0,
        client_id: str = "",
        service_id: str = "",
    ) -> Writer:
        """See `transport.Participant`; the ids are those of a client or server that it belongs to."""
        raise NotImplementedError

    def create_reader(
        self,
        topic: str,
        type: str,
        qos: QoSProfile,
        type_hash: str = "",
        *,
        node: int = 0,
        client_id: str = "",
        service_id: str = "",
        ignore_local: bool = False,
        has_buffer: bool = False,
    ) -> Reader:
        """See `create_writer`."""
        raise NotImplementedError

    # ------------------------------------------------------------------------------------------------- services

    def create_client(self, service: Service, qos: QoSProfile, *, node: int = 0) -> ServiceEndpoints:
        """See `transport.Participant`."""
        own_id = entity_id(self.guid, next(self._entity_numbers))
        request, reply = _halves(service, qos)
        reader = self.create_reader(*reply, node=node, client_id=own_id)
        writer = self.create_writer(*request, node=node, client_id=own_id)
        return ServiceEndpoints(reader, writer, entity_gid(own_id))

    def create_server(self, service: Service, qos: QoSProfile, *, node: int = 0) -> ServiceEndpoints:
        """See `transport.Participant`."""
        own_id = entity_id(self.guid, next(self._entity_numbers))
        request, reply = _halves(service, qos)
        writer = self.create_writer(*reply, node=node, service_id=own_id)
        reader = self.create_reader(*request, node=node, service_id=own_id)
        return ServiceEndpoints(reader, writer, entity_gid(own_id))

    def identifies(self, guid: bytes) -> bool:
        """See `transport.Participant`; Fast DDS does (protocol.md 5.3)."""
        return guid.startswith(FAST_DDS_VENDOR)

    def counts_requests(self, guid: bytes) -> bool:
        """See `transport.Participant`; Fast DDS does."""
        return guid.startswith(FAST_DDS_VENDOR)

    def mismatch(self, writer: EndpointFound, reader: EndpointFound) -> str:
        """See `transport.Participant`."""
        result = check_compatible(writer.qos, reader.qos)
        return "" if result.matches else f"their quality of service is incompatible. {result.reason}"

    # ---------------------------------------------------------------------------------------------------- nodes

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        """See `transport.Participant`."""
        if self._nodes is not None:
            self._nodes.announce(nodes)

    def listen_for_nodes(self, sink: Callable[[list[DiscoveryEvent]], None]) -> Callable[[list[DiscoveryEvent]], None]:
        """Report to `sink` what others tell of their nodes; the sink for all other discovery is returned."""
        if self._nodes is not None:
            self._nodes.close()
        self._nodes = NodeTopic(self, sink)
        return self._nodes.pass_on

    def read_nodes(self) -> None:
        """Report what has arrived already."""
        if self._nodes is not None:
            self._nodes.read()

    def forget_nodes(self) -> None:
        """Announce and report nothing any more."""
        if self._nodes is not None:
            self._nodes.close()


def reaches(client: bytes, matched: Callable[[], list[bytes]]) -> bool:
    """Whether a reply writer reaches a client: its GUID is of its reply reader, or of its request writer, which says
    nothing (protocol.md 5.3).
    """
    return not client[15] & _READER_BIT or client in matched()


_Half = tuple[str, str, "QoSProfile", str]


def _halves(service: Service, qos: QoSProfile) -> tuple[_Half, _Half]:
    """Topic, type, profile and hash of the requests and of the replies."""
    prefix = not qos.avoid_ros_namespace_conventions
    request = type_name(f"{service.type}_Request")
    response = type_name(f"{service.type}_Response")
    return (
        (request_name(service.name, prefix=prefix), request, qos, service.request_hash),
        (reply_name(service.name, prefix=prefix), response, qos, service.response_hash),
    )


def running_loop() -> asyncio.AbstractEventLoop | None:
    """The loop that this thread runs just now."""
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None
