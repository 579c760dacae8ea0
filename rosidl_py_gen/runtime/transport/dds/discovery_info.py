"""The topic `ros_discovery_info`, by which participants of DDS tell their nodes, and when its writers are asked again.

Source: docs/internals/protocol.md 6.2.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.runtime.logs.loggers import internal_logger
from rosidl_py_gen.runtime.transport.api import EndpointSpec
from rosidl_py_gen.runtime.transport.dds import discovery_info_message
from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, EntityLost, NodesAnnounced, TopicKey
from rosidl_py_gen.runtime.transport.qos import DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.runtime.transport.api import Reader
    from rosidl_py_gen.runtime.transport.dds.participant import DdsParticipant
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveryEvent, NodeEntities
    from rosidl_py_gen.runtime.transport.qos import QoSProfile

_CHANNEL = TopicKey("unmangled", "ros_discovery_info")
_PREFIX_BYTES = 12
"""The part of a GUID that all endpoints of a participant share."""
_TYPE = "rmw_dds_common/msg/ParticipantEntitiesInfo"
_WRITER_QOS = DEFAULT.keep_last(1).transient_local()
_READER_QOS = DEFAULT.keep_all().transient_local()
_RETRY_DELAYS_S = (0.05, 0.2, 0.5)
"""A participant's graph message comes with its endpoints, or is lost: Fast DDS sends it as soon as it hears of our
reader, and Cyclone drops what comes from a writer it has not heard of. It would be sent again after 3 s."""


class DiscoveryInfoTopic:
    """The topic on which participants tell their nodes."""

    def __init__(self, participant: DdsParticipant, sink: Callable[[list[DiscoveryEvent]], None]) -> None:
        self._participant = participant
        self._sink = sink
        self._closed = False
        self._unheard_writers: set[bytes] = set()
        """Writers of graph messages of which none had come when they were found."""
        self._heard_writers: set[bytes] = set()
        """Writers of which one came."""
        self._writer = participant.create_writer(_spec(_WRITER_QOS))
        self._reader = self._new_reader()

    def _new_reader(self) -> Reader:
        reader = self._participant.create_reader(_spec(_READER_QOS))
        reader.set_sink(self._on_messages)
        return reader

    def announce(self, nodes: Mapping[int, NodeEntities]) -> None:
        """Write the whole state."""
        self._writer.write(discovery_info_message.encode(self._participant.guid, nodes.values()))

    def read(self) -> None:
        """Take in what has arrived."""
        # A writer of this process may have fetched already.
        if self._reader.fetch() or self._reader.queue.items:
            self._on_messages()

    def forward_events(self, events: list[DiscoveryEvent]) -> None:
        """Give the sink what discovery reports, and note whose messages are to come."""
        self._sink(events)
        for event in events:
            if isinstance(event, EntityLost):
                self._heard_writers.discard(event.guid)
                self._unheard_writers.discard(event.guid)
            elif isinstance(event, DiscoveredEndpoint) and event.is_writer and event.channel == _CHANNEL:
                self._expect_message(event.guid)

    def _expect_message(self, writer: bytes) -> None:
        loop = current_loop()
        is_own = writer[:_PREFIX_BYTES] == self._participant.guid[:_PREFIX_BYTES]
        if loop is not None and not is_own and writer not in self._heard_writers:
            if not self._unheard_writers:
                loop.call_later(_RETRY_DELAYS_S[0], self._recreate_reader, 1)
            self._unheard_writers.add(writer)

    def _recreate_reader(self, times: int) -> None:
        """Give writers that were not heard a new reader: they send to it what they have, and by now Cyclone listens."""
        self._unheard_writers -= self._heard_writers
        if self._closed or not self._unheard_writers:
            return
        old, self._reader = self._reader, self._new_reader()
        old.close()
        if times == len(_RETRY_DELAYS_S):
            self._unheard_writers.clear()
        else:
            asyncio.get_running_loop().call_later(_RETRY_DELAYS_S[times], self._recreate_reader, times + 1)

    def _on_messages(self) -> None:
        items = self._reader.queue.items
        found: list[DiscoveryEvent] = []
        while items:
            data, _, handle, _, _ = items.popleft()
            guid = self._reader.writer_guid(handle)
            if guid is None:
                continue
            self._heard_writers.add(guid)
            prefix = guid[:_PREFIX_BYTES]
            try:
                message = discovery_info_message.decode(data, prefix)
            except DecodeError as err:
                internal_logger().warning(f"ignored a graph message of participant {prefix.hex('.')}: {err}")
                continue
            found.append(NodesAnnounced(message.participant_guid, tuple(message.nodes)))
        self._sink(found)

    def close(self) -> None:
        """Delete the endpoints; may be called twice."""
        self._closed = True
        self._reader.close()
        self._writer.close()


def _spec(qos: QoSProfile) -> EndpointSpec:
    return EndpointSpec(
        _CHANNEL.name, _TYPE, qos, HASHES[_TYPE], avoid_ros_namespace_conventions=True, ignore_local=True
    )
