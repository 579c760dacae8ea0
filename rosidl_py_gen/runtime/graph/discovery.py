"""Keeps the graph up to date and tells peers about our own nodes.

Decides when `ros_discovery_info` is written (after every change, several changes of one loop iteration at once), and
when a quality-of-service mismatch is worth a warning. The state is `state.py`, the bytes are `message.py`.
"""

from __future__ import annotations

import itertools
import threading
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import DecodeError
from rosidl_py_gen.msgs.hashes import HASHES
from rosidl_py_gen.runtime.graph import message as graph_message
from rosidl_py_gen.runtime.graph.state import Graph, NodeEntities
from rosidl_py_gen.runtime.logs.loggers import get_logger, internal_logger, logger_name
from rosidl_py_gen.runtime.loop.waiters import Waiters
from rosidl_py_gen.runtime.names.dds import (
    DISCOVERY_TOPIC,
    DISCOVERY_TYPE,
    demangle_service,
    demangle_topic,
    endpoint_user_data,
)
from rosidl_py_gen.runtime.names.validation import fully_qualified_node_name
from rosidl_py_gen.runtime.transport.interface import Lost
from rosidl_py_gen.runtime.transport.matching import check_compatible
from rosidl_py_gen.runtime.transport.qos import DEFAULT

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.graph.state import Endpoint
    from rosidl_py_gen.runtime.loop.bridge import Bridge
    from rosidl_py_gen.runtime.transport.interface import DiscoveryEvent, Participant, Reader

_TYPE_HASH = HASHES["rmw_dds_common/msg/ParticipantEntitiesInfo"]
_USER_DATA = endpoint_user_data(_TYPE_HASH)
_WRITER_QOS = DEFAULT.keep_last(1).transient_local()
_READER_QOS = DEFAULT.keep_all().transient_local()
_SILENCES_S = (0.05, 0.2, 0.5)
"""A participant's graph message comes with its endpoints, or is lost: Fast DDS sends it as soon as it hears of our
reader, and Cyclone drops what comes from a writer it has not heard of. It would be sent again after 3 s."""
_NAME_PATIENCE_S = 1.0
"""A node's name usually arrives some milliseconds after its endpoints; a warning waits this long for it."""


class Discovery:
    """The graph side of one context."""

    def __init__(self, participant: Participant, bridge: Bridge) -> None:
        self._participant = participant
        self._bridge = bridge
        self.graph = Graph()
        self._nodes: dict[int, NodeEntities] = {}
        self._node_numbers = itertools.count(1)
        self.changes = Waiters()
        """Who waits for the graph to change."""
        self.together_s = 0.0
        """How long changes of our own nodes wait for others before peers are told; 0 is one iteration of the loop."""
        self._dirty = False
        self._lock = threading.RLock()
        """Held from a change of our own nodes until it is written, so that no older state is written after it."""
        self._closed = False
        self._warned: set[tuple[bytes, bytes]] = set()
        self._mismatches: list[tuple[Endpoint, Endpoint, str]] = []
        self._silent: set[bytes] = set()
        """Writers of graph messages of which none had come when they were found."""
        self._told: set[bytes] = set()
        """Writers of which one came."""
        self._writer = participant.create_writer(DISCOVERY_TOPIC, DISCOVERY_TYPE, _WRITER_QOS, _USER_DATA)
        self._reader = self._new_reader()
        participant.set_discovery_sink(self._on_events)

    def _new_reader(self) -> Reader:
        reader = self._participant.create_reader(
            DISCOVERY_TOPIC, DISCOVERY_TYPE, _READER_QOS, _USER_DATA, ignore_local=True
        )
        reader.set_sink(self._on_messages)
        return reader

    # ------------------------------------------------------------------------------------------------- own nodes

    def add_node(self, name: str, namespace: str) -> int:
        """Announce a node; returns its number."""
        number = next(self._node_numbers)
        with self._lock:
            self._nodes[number] = NodeEntities(namespace, name, frozenset(), frozenset())
            self.publish()
        return number

    def remove_node(self, number: int) -> None:
        """Withdraw a node."""
        with self._lock:
            if self._nodes.pop(number, None) is None:
                return
            if self._bridge.in_loop_thread():
                self.graph.set_nodes(self._participant.guid, self._nodes.values())
                self._publish_soon()
            else:
                self.publish()

    def endpoints_of(self, number: int) -> frozenset[bytes]:
        """GUIDs of a node's endpoints."""
        node = self._nodes[number]
        return node.reader_gids | node.writer_gids

    def change_endpoints(self, number: int, *, add: tuple[bytes, ...] = (), remove: tuple[bytes, ...] = ()) -> None:
        """Add or remove endpoint GUIDs of a node; whether one is a reader is told by its last byte."""
        with self._lock:
            node = self._nodes.get(number)
            if node is None:
                return
            kinds = {0x04: node.reader_gids, 0x03: node.writer_gids}
            for kind, gids in kinds.items():
                added = {guid for guid in add if guid[15] == kind}
                kinds[kind] = (gids | added) - frozenset(remove)
            self._nodes[number] = NodeEntities(node.namespace, node.name, kinds[0x04], kinds[0x03])
            if self._bridge.in_loop_thread():
                self._publish_soon()
            else:
                self.publish()

    def _publish_soon(self) -> None:
        loop = self._bridge.loop
        if not self._dirty and loop is not None:
            self._dirty = True
            loop.call_later(self.together_s, self._publish_if_dirty)

    def _publish_if_dirty(self) -> None:
        # A participant that leaves says all there is to say: DDS would hold up the end until this were acknowledged.
        if self._dirty and not self._closed:
            self.publish()

    def publish(self) -> None:
        """Write the whole state now."""
        with self._lock:
            self._dirty = False
            nodes = list(self._nodes.values())
            self._writer.write(graph_message.encode(self._participant.guid, nodes))
            self.graph.set_nodes(self._participant.guid, nodes)
        self._changed()

    # ------------------------------------------------------------------------------------------------------ input

    def refresh(self) -> None:
        """Take in what has arrived but was not reported yet; does nothing outside the thread of a running loop."""
        loop = self._bridge.loop
        if loop is None or not loop.is_running() or self._bridge.in_loop_thread():
            self._participant.report_discovery()
            # A writer of this process may have fetched already.
            if self._reader.fetch() or self._reader.queue.items:
                self._on_messages()

    def _on_events(self, events: list[DiscoveryEvent]) -> None:
        for event in events:
            if isinstance(event, Lost):
                self._told.discard(event.guid)
                self._silent.discard(event.guid)
                self._warned = {pair for pair in self._warned if event.guid not in pair}
            appeared = self.graph.apply(event)
            if appeared is not None:
                self._compare(appeared)
                if appeared.info.is_writer and appeared.info.topic == DISCOVERY_TOPIC:
                    self._expect_message(appeared.info.guid)
        self._changed()

    def _expect_message(self, writer: bytes) -> None:
        loop = self._bridge.loop
        is_own = writer[:12] == self._participant.guid[:12]
        if loop is not None and self._bridge.in_loop_thread() and not is_own and writer not in self._told:
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
        loop = self._bridge.loop
        if times == len(_SILENCES_S) or loop is None:
            self._silent.clear()
        else:
            loop.call_later(_SILENCES_S[times], self._ask_again, times + 1)

    def _on_messages(self) -> None:
        items = self._reader.queue.items
        while items:
            data, _, handle, _ = items.popleft()
            guid = self._reader.writer_guid(handle)
            if guid is None:
                continue
            self._told.add(guid)
            try:
                message = graph_message.decode(data, guid[:12])
            except DecodeError as err:
                internal_logger().warning(f"ignored a graph message of participant {guid[:12].hex('.')}: {err}")
                continue
            self.graph.set_nodes(message.participant_guid, message.nodes)
        self._changed()

    # ---------------------------------------------------------------------------------------------------- waiting

    def _changed(self) -> None:
        if self._bridge.is_running and not self._bridge.in_loop_thread():
            self._bridge.call_soon(self._changed)
            return
        self.changes.wake()
        if self._mismatches:
            self._warn_mismatches(final=False)

    # ------------------------------------------------------------------------------------------------ mismatches

    def _compare(self, new: Endpoint) -> None:
        """Look for endpoints that `new` should talk to but cannot; one side must be ours."""
        mine = self._participant.guid[:12]
        for other in self.graph.on_topic(new.info.topic, writers=not new.info.is_writer):
            if mine not in (new.info.guid[:12], other.info.guid[:12]) or new.info.type != other.info.type:
                continue
            writer, reader = (new, other) if new.info.is_writer else (other, new)
            result = check_compatible(writer.info.qos, reader.info.qos)
            pair = (writer.info.guid, reader.info.guid)
            if not result.matches and pair not in self._warned:
                self._warned.add(pair)
                self._mismatches.append((writer, reader, result.reason))
                loop = self._bridge.loop
                if loop is not None:
                    loop.call_later(_NAME_PATIENCE_S, self._warn_mismatches)

    def _warn_mismatches(self, *, final: bool = True) -> None:
        waiting, self._mismatches = self._mismatches, []
        for writer, reader, reason in waiting:
            words = [self.graph.describe_node(writer.info), self.graph.describe_node(reader.info)]
            if not final and any(not text.startswith("node") for text in words):
                self._mismatches.append((writer, reader, reason))
                continue
            own = writer if writer.info.guid[:12] == self._participant.guid[:12] else reader
            name = demangle_topic(own.info.topic) or demangle_service(own.info.topic) or own.info.topic
            namespace, node_name = self.graph.node_of(own.info)
            get_logger(logger_name(fully_qualified_node_name(node_name, namespace))).warning(
                f"no messages on {name} from {words[0]} to {words[1]}: "
                f"their quality of service is incompatible. {reason}"
            )

    def close(self) -> None:
        """Delete the graph endpoints and release whoever waits."""
        self._closed = True
        self._mismatches.clear()
        self._changed()
        self._reader.close()
        self._writer.close()
