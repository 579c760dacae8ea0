"""Keeps the graph up to date and tells peers about our own nodes.

Decides when our nodes are announced (after every change, several changes of one loop iteration at once), and when
there is a warning that two endpoints do not connect. The state is `state.py`; how nodes are announced, and why two
do not connect, is the transport's business.
"""

from __future__ import annotations

import itertools
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.base.registration import RegistrationSet
from rosidl_py_gen.base.waiters import Waiters
from rosidl_py_gen.runtime.graph.graph import Graph, Mismatch
from rosidl_py_gen.runtime.graph.type_hashes import type_hashes_differ
from rosidl_py_gen.runtime.graph.unmatched import UnmatchedReasons
from rosidl_py_gen.runtime.logs.loggers import get_logger, logger_name
from rosidl_py_gen.runtime.names.validation import fully_qualified_node_name
from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, EntityLost, NodeEntities
from rosidl_py_gen.runtime.transport.incompatibility import Incompatibility, IncompatibilityKind

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding
    from rosidl_py_gen.runtime.transport.api import Participant
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveryEvent, TopicKey

_STILL_DELIVERED = "; they are used all the same, as type_check says"
_CURE = (
    ". Bring both to one, or take that of the other side: `await node.resolve_type(topic)`, or `rosidl-py`, which "
    "looks it up"
)
_NODE_NAME_GRACE_PERIOD_S = 1.0
"""A node's name usually arrives some milliseconds after its endpoints; a warning waits this long for it."""


@dataclass(frozen=True, slots=True)
class _Warning:
    """An incompatibility that is logged when the names of both nodes are known."""

    found: Incompatibility
    is_used: bool
    """Messages arrive and are handed out all the same."""


class Discovery:
    """The graph side of one context."""

    def __init__(self, participant: Participant, bridge: LoopBinding, announce_delay_s: float = 0.0) -> None:
        """`announce_delay_s`: see `Context`."""
        self._participant = participant
        self._bridge = bridge
        self.graph = Graph(participant.guid)
        self._nodes: dict[int, NodeEntities] = {}
        self._node_numbers = itertools.count(1)
        self.changes = Waiters()
        """Who waits for the graph to change."""
        self.on_endpoint_lost: RegistrationSet[Callable[[], None]] = RegistrationSet()
        """Called when participants or endpoints have left the graph, on the loop's thread or where no loop runs."""
        self._announce_delay_s = announce_delay_s
        self._dirty = False
        self._lock = threading.RLock()
        """Held from a change of our own nodes until it is written, so that no older state is written after it."""
        self._closed = False
        self._reported_pairs: set[tuple[bytes, bytes]] = set()
        self._warned_services: set[tuple[str, bytes, bytes]] = set()
        self._mismatches: list[_Warning] = []
        self.on_incompatible_endpoint: Callable[[str, str], None] | None = None
        """See `Context`."""
        self.type_hash_checks: dict[bytes, str] = {}
        """Of our endpoints, what becomes of messages of another definition, where that is not "error"."""
        self.unmatched = UnmatchedReasons(self.graph, self.incompatibility, participant.middleware)
        participant.set_discovery_sink(self._on_events)

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

    def change_endpoints(
        self, number: int, *, reader: bytes = b"", writer: bytes = b"", remove: tuple[bytes, ...] = ()
    ) -> None:
        """Add or remove endpoint GUIDs of a node."""
        with self._lock:
            node = self._nodes.get(number)
            if node is None:
                return
            gone = {*remove, b""}
            for guid in remove:
                self.type_hash_checks.pop(guid, None)
            readers, writers = (node.reader_gids | {reader}) - gone, (node.writer_gids | {writer}) - gone
            self._nodes[number] = NodeEntities(node.namespace, node.name, readers, writers)
            if self._bridge.in_loop_thread():
                self._publish_soon()
            else:
                self.publish()

    def _publish_soon(self) -> None:
        loop = self._bridge.loop
        if not self._dirty and loop is not None:
            self._dirty = True
            loop.call_later(self._announce_delay_s, self._publish_if_dirty)

    def _publish_if_dirty(self) -> None:
        # A participant that leaves says all there is to say: DDS would hold up the end until this were acknowledged.
        if self._dirty and not self._closed:
            self.publish()

    def publish(self) -> None:
        """Announce the whole state now."""
        with self._lock:
            self._dirty = False
            self._participant.announce(self._nodes)
            self.graph.set_nodes(self._participant.guid, self._nodes.values())
        self._changed()

    # ------------------------------------------------------------------------------------------------------ input

    def refresh(self) -> None:
        """Take in what has arrived but was not reported yet; does nothing outside the thread of a running loop."""
        loop = self._bridge.loop
        if loop is None or not loop.is_running() or self._bridge.in_loop_thread():
            self._participant.report_discovery()

    def _on_events(self, events: list[DiscoveryEvent]) -> None:
        someone_left = False
        for event in events:
            if isinstance(event, EntityLost):
                someone_left = True
                self._reported_pairs = {pair for pair in self._reported_pairs if event.guid not in pair}
                self._warned_services = {one for one in self._warned_services if event.guid not in one}
            appeared = self.graph.apply(event)
            if appeared is not None:
                self._check_new_endpoint(appeared)
        if someone_left:
            for tell in self.on_endpoint_lost:
                tell()
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

    def incompatibility(self, writer: DiscoveredEndpoint, reader: DiscoveredEndpoint) -> Incompatibility | None:
        """Return in what a writer and a reader of one channel differ; None when they do not."""
        kind = (
            IncompatibilityKind.TYPE
            if writer.type != reader.type
            else self._participant.incompatibility_reason(writer, reader)
        )
        if kind is None and type_hashes_differ(writer, reader.type_hash, reader.service_hash):
            kind = IncompatibilityKind.DEFINITION
        return None if kind is None else Incompatibility(kind, writer, reader)

    def mismatches(self, channel: TopicKey) -> Iterator[Mismatch]:
        """Who does not understand whom on a channel, as far as both are known."""
        info = self.graph.endpoint_info
        for writer in self.graph.endpoints_on(channel, writers=True):
            for reader in self.graph.endpoints_on(channel, writers=False):
                if found := self.incompatibility(writer, reader):
                    yield Mismatch(info(writer), info(reader), found.mismatch_kind, found.reason)

    def _check_new_endpoint(self, new: DiscoveredEndpoint) -> None:
        """Look for endpoints that `new` should talk to but cannot; one side must be ours."""
        mine = self._participant.guid
        for other in self.graph.endpoints_on(new.channel, writers=not new.is_writer):
            writer, reader = (new, other) if new.is_writer else (other, new)
            ours = [one for one in (writer, reader) if one.participant_guid == mine]
            if not ours or (writer.guid, reader.guid) in self._reported_pairs:
                continue
            found = self.incompatibility(writer, reader)
            if found is None or not self._is_first_report(writer, reader):
                continue
            self._reported_pairs.add((writer.guid, reader.guid))
            modes = {self.type_hash_checks.get(one.guid, "error") for one in ours}
            is_definition = found.kind is IncompatibilityKind.DEFINITION
            if is_definition and modes == {"off"}:
                continue
            self._mismatches.append(_Warning(found, is_definition and reader in ours and "error" not in modes))
            loop = self._bridge.loop
            if loop is not None:
                loop.call_later(_NODE_NAME_GRACE_PERIOD_S, self._warn_mismatches)

    def _is_first_report(self, writer: DiscoveredEndpoint, reader: DiscoveredEndpoint) -> bool:
        """Whether it is the first half of a service between two participants; the other says the same."""
        kind, name = writer.channel
        if kind not in ("request", "reply"):
            return True
        one, two = sorted((writer.participant_guid, reader.participant_guid))
        known = (name, one, two) in self._warned_services
        self._warned_services.add((name, one, two))
        return not known

    def _warn_mismatches(self, *, final: bool = True) -> None:
        waiting, self._mismatches = self._mismatches, []
        for warning in waiting:
            found = warning.found
            writer, reader = found.writer, found.reader
            if not final and not (self.graph.has_named_node(writer) and self.graph.has_named_node(reader)):
                self._mismatches.append(warning)
                continue
            own = writer if writer.participant_guid == self._participant.guid else reader
            what = "messages that may be read wrong" if warning.is_used else "no messages"
            names = f"from {self.graph.describe_node(writer)} to {self.graph.describe_node(reader)}"
            text = f"{what} on {own.channel.name} {names}: {found.reason}"
            if found.kind is IncompatibilityKind.DEFINITION:
                text += _STILL_DELIVERED if warning.is_used else _CURE
            if self.on_incompatible_endpoint is not None:
                self.on_incompatible_endpoint(text, own.channel.name)
                continue
            namespace, node_name = self.graph.node_of(own)
            get_logger(logger_name(fully_qualified_node_name(node_name, namespace))).warning(text)

    def close(self) -> None:
        """Announce nothing more and release whoever waits."""
        self._closed = True
        self._mismatches.clear()
        self._changed()
