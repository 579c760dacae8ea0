"""Discovery of the peers of a context: announcements of its nodes, changes of the graph, and incompatible endpoints.

The context's nodes are announced after every change; several changes in one loop iteration are announced together. The
graph's data is in `graph.py`. How nodes are announced, and which endpoints are incompatible, depends on the transport.

`UnmatchedReasons` searches for the reason why an endpoint has no matched peer, as text for errors of waits that timed
out. A reason is cached until the graph changes, because programs poll with short timeouts. Names and other texts of
peers are made printable and truncated.
"""

from __future__ import annotations

import itertools
import threading
from contextlib import suppress
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.callbacks import RegistrationSet
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.terminal_text import is_logged
from rosidl_py_gen.base.waiters import Waiters
from rosidl_py_gen.errors import ClosedError, printable
from rosidl_py_gen.runtime.graph import (
    DEFAULT_CHECK,
    Graph,
    Mismatch,
    distribution_advice,
    distributions_of,
    type_hashes_differ,
)
from rosidl_py_gen.runtime.logs import get_logger, logger_name, report_failure
from rosidl_py_gen.runtime.names import fully_qualified_node_name
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, EntityLost, NodeEntities
from rosidl_py_gen.runtime.transport.qos import Incompatibility, IncompatibilityKind, find_preset

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from rosidl_py_gen.runtime.loop.loop_binding import LoopBinding
    from rosidl_py_gen.runtime.transport.api import DiscoveryEvent, Participant, TopicKey

_STILL_DELIVERED = "; delivered anyway, because of type_hash_check"
_DEFINITION_ADVICE = (
    ". Use the same definition on both sides, or the definition of the other side: `await node.resolve_type(topic)`, "
    "or `rosidl-py`, which does that automatically"
)
_NODE_NAME_GRACE_PERIOD_S = 1.0
"""Time in seconds that a warning about an endpoint waits for the name of the endpoint's node, which usually arrives
some milliseconds later."""
_OWN_ENDPOINTS_TIMEOUT_S = 0.1
"""Maximum time in seconds that another thread waits for a busy event loop to apply discovery data. After that time,
endpoints of this context may be missing from the graph for a moment.

A longer time would delay programs that read the graph while a callback blocks the loop.
"""


class Discovery:
    """Graph of the peers of one context, and the announcement of the context's own nodes to peers."""

    def __init__(self, participant: Participant, loop_binding: LoopBinding, announce_delay_s: float = 0.0) -> None:
        """Create the graph of a context; `announce_delay_s` is the argument of `Context`."""
        self._participant = participant
        self._loop_binding = loop_binding
        self._index = participant.endpoint_index
        self.graph = Graph(self._index, participant.guid)
        self._nodes: dict[int, NodeEntities] = {}
        self._node_numbers = itertools.count(1)
        self.changes = Waiters()
        """Tasks that wait for a change of the graph."""
        self.on_change: RegistrationSet[Callable[[Collection[TopicKey]], None]] = RegistrationSet()
        """Function that is called with the topics of discovered or lost endpoints, on the loop's thread if a loop runs.
        """
        self.announce_delay_s = announce_delay_s
        self._announcement_is_scheduled = False
        # Held from a change of own nodes until it is announced, so that no older state is announced after it.
        self._lock = threading.RLock()
        self._closed = False
        self._reported: set[tuple[object, ...]] = set()
        """Incompatibilities that were reported already, as GUIDs of two endpoints, or as name of a service and GUIDs of
        the participants."""
        self._warned: dict[TopicKey, int] = {}
        """Number of warnings about incompatible endpoints, by the topic of the context's own endpoint."""
        self._deferred: list[tuple[Callable[[], None], tuple[DiscoveredEndpoint, ...]]] = []
        """Functions to call as soon as the names of the nodes of certain endpoints are known."""
        self.on_incompatible_endpoint: Callable[[str, str], None] | None = None
        """Function that the user passed as `Context.on_incompatible_endpoint`."""
        self.type_hash_checks: dict[bytes, str] = {}
        """Setting of the type hash check for each of the context's own endpoints that does not have the default
        setting."""
        self.on_other_definition: dict[bytes, Callable[[DiscoveredEndpoint], object]] = {}
        """Functions of the context's own readers, which are called with each writer that has another definition of the
        type."""
        self.unmatched = UnmatchedReasons(self.graph, self.incompatibility, participant.middleware)
        participant.set_discovery_sink(self._on_events)

    def add_node(self, name: str, namespace: str) -> int:
        """Announce a node of the context to peers, and return the number of the node."""
        with self._lock:
            number = next(self._node_numbers)
            self._nodes[number] = NodeEntities(namespace, name, frozenset(), frozenset())
            self.publish()
        return number

    def remove_node(self, number: int) -> None:
        """Withdraw a node of the context from peers, if it is announced."""
        with self._lock:
            if self._nodes.pop(number, None) is not None:
                if self._loop_binding.in_loop_thread():
                    self._index.set_nodes(self._participant.guid, self._nodes.values())
                self._publish_or_schedule()

    def endpoints_of(self, number: int) -> frozenset[bytes]:
        """Return the GUIDs of a node's endpoints."""
        node = self._nodes[number]
        return node.reader_gids | node.writer_gids

    def change_endpoints(
        self, number: int, *, reader: bytes = b"", writer: bytes = b"", remove: tuple[bytes, ...] = ()
    ) -> None:
        """Add or remove GUIDs of endpoints of a node of this context."""
        with self._lock:
            node = self._nodes.get(number)
            if node is None:
                return
            removed = {*remove, b""}
            for guid in remove:
                self.type_hash_checks.pop(guid, None)
                self.on_other_definition.pop(guid, None)
            readers, writers = (node.reader_gids | {reader}) - removed, (node.writer_gids | {writer}) - removed
            self._nodes[number] = NodeEntities(node.namespace, node.name, readers, writers)
            self._publish_or_schedule()

    def _publish_or_schedule(self) -> None:
        loop = self._loop_binding.loop
        if not self._loop_binding.in_loop_thread():
            self.publish()
        elif not self._announcement_is_scheduled and loop is not None:
            self._announcement_is_scheduled = True
            loop.call_later(self.announce_delay_s, self._publish_scheduled)

    def _publish_scheduled(self) -> None:
        # Deleting the participant already tells peers that its nodes are gone; announcing first would delay shutdown
        # until they acknowledge.
        if self._announcement_is_scheduled and not self._closed:
            self.publish()

    def publish(self) -> None:
        """Announce all nodes of the context to peers now."""
        with self._lock:
            self._announcement_is_scheduled = False
            try:
                self._participant.announce(self._nodes)
            except ClosedError:
                if not self._closed:  # another thread closes the context, which peers notice without this announcement
                    raise
            self._index.set_nodes(self._participant.guid, self._nodes.values())
        self._changed()

    def refresh(self) -> None:
        """Apply received discovery data to the graph, so that a caller can read it.

        Outside the thread of a running loop, data is applied only if endpoints of the context itself are missing.
        Thread: any.
        """
        loop = self._loop_binding.loop
        if loop is None or not loop.is_running() or self._loop_binding.in_loop_thread():
            self._participant.report_discovery()
        elif not self._has_own_endpoints():
            # Only the thread of the loop may apply discovery data. Without the wait, an endpoint that this thread has
            # just created would be missing; in rmw, own endpoints are in the graph at once.
            is_applied = threading.Event()

            def apply() -> None:
                try:
                    self._participant.report_discovery()
                finally:
                    is_applied.set()

            self._loop_binding.call_soon(apply)
            is_applied.wait(_OWN_ENDPOINTS_TIMEOUT_S)

    def _has_own_endpoints(self) -> bool:
        nodes = list(self._nodes.values())
        return all(self.graph.endpoints.keys() >= node.reader_gids | node.writer_gids for node in nodes)

    def _on_events(self, events: list[DiscoveryEvent]) -> None:
        """Report incompatible endpoints and topics with changes.

        The transport has already applied the events to its index.
        """
        topics = self._index.take_changed_topics()
        for event in events:
            if isinstance(event, EntityLost):
                self._reported = {report for report in self._reported if event.guid not in report}
            elif isinstance(event, DiscoveredEndpoint):
                self._check_endpoint(event)
        for function in self.on_change:
            function(topics)
        self._changed()

    def _changed(self) -> None:
        if self._loop_binding.is_running and not self._loop_binding.in_loop_thread():
            self._loop_binding.call_soon(self._changed)
            return
        self.changes.wake()
        if self._deferred:
            self._call_deferred(final=False)

    def incompatibility(self, writer: DiscoveredEndpoint, reader: DiscoveredEndpoint) -> Incompatibility | None:
        """Return the incompatibility of a writer and a reader of one topic; None if they match."""
        if writer.type != reader.type:
            return Incompatibility(IncompatibilityKind.TYPE, writer, reader)
        kind = self._participant.incompatibility_reason(writer, reader)
        if kind is None and type_hashes_differ(writer, reader.type_hash, reader.service_hash):
            kind = IncompatibilityKind.DEFINITION
        return None if kind is None else Incompatibility(kind, writer, reader)

    def mismatches(self, topic_key: TopicKey) -> Iterator[Mismatch]:
        """Yield all incompatible pairs of discovered endpoints on a topic."""
        info = self.graph.endpoint_info
        for writer in self.graph.endpoints_on(topic_key, writers=True):
            for reader in self.graph.endpoints_on(topic_key, writers=False):
                if result := self.incompatibility(writer, reader):
                    yield Mismatch(info(writer), info(reader), result.mismatch_kind, result.reason)

    def _check_endpoint(self, new: DiscoveredEndpoint) -> None:
        """Report a new or changed endpoint that is incompatible with an endpoint of opposite direction, if one of both
        is the context's own.

        Each pair is reported once, after all received events were applied, because a function of the user may read the
        graph, and when the names of the nodes are known. With ``type_hash_check="off"``, a different definition is not
        reported.
        """
        for other in self.graph.endpoints_on(new.topic_key, writers=not new.is_writer):
            writer, reader = (new, other) if new.is_writer else (other, new)
            own = [endpoint for endpoint in (writer, reader) if endpoint.participant_guid == self._participant.guid]
            if not own or (writer.guid, reader.guid) in self._reported:
                continue
            result = self.incompatibility(writer, reader)
            if result is None:
                continue
            self._reported.add((writer.guid, reader.guid))
            modes = {endpoint.guid: self.type_hash_checks.get(endpoint.guid, DEFAULT_CHECK) for endpoint in own}
            is_definition = result.kind is IncompatibilityKind.DEFINITION
            if is_definition and reader.guid in self.on_other_definition:
                self.on_other_definition[reader.guid](writer)
            if (is_definition and {*modes.values()} == {"off"}) or not self._is_first_report(writer, reader):
                continue
            # The reader decides what is delivered, so the writer is the peer if both are own endpoints.
            pair = (writer, reader) if reader in own else (reader, writer)
            distros = distributions_of(*pair) if is_definition else ()
            mode = modes.get(reader.guid, DEFAULT_CHECK)
            is_delivered = is_definition and (mode == "off" or (mode == "warn" and not distros))
            self._defer(partial(self._warn, result, is_delivered, distros), writer, reader)

    def call_when_named(self, function: Callable[[], None], *endpoints: DiscoveredEndpoint) -> None:
        """Call a function as soon as the names of the nodes of endpoints are known.

        With a running loop, the function is called after a second at the latest; without one, at `close`. Thread: any.
        """
        if all(map(self.graph.has_named_node, endpoints)):
            function()
        else:
            self._defer(function, *endpoints)

    def _defer(self, function: Callable[[], None], *endpoints: DiscoveredEndpoint) -> None:
        self._deferred.append((function, endpoints))
        loop = self._loop_binding.loop
        if loop is None:
            return

        def start_grace_period() -> None:
            loop.call_later(_NODE_NAME_GRACE_PERIOD_S, self._call_deferred)

        self._loop_binding.call_soon(start_grace_period)

    def _call_deferred(self, *, final: bool = True) -> None:
        pending = []
        for _ in range(len(self._deferred)):  # other threads may append, and call the functions, too
            with suppress(IndexError):
                pending.append(self._deferred.pop(0))
        for function, endpoints in pending:
            if final or all(map(self.graph.has_named_node, endpoints)):
                function()
            else:
                self._deferred.append((function, endpoints))

    def _is_first_report(self, writer: DiscoveredEndpoint, reader: DiscoveredEndpoint) -> bool:
        """Return False if an incompatibility on the other topic of a service was reported already for the same two
        participants.
        """
        kind, name = writer.topic_key
        if kind not in ("request", "reply"):
            return True
        key = name, *sorted((writer.participant_guid, reader.participant_guid))
        is_first = key not in self._reported
        self._reported.add(key)
        return is_first

    def _warn(self, incompatibility: Incompatibility, is_delivered: bool, distros: tuple[str, ...]) -> None:
        """Log a warning about two incompatible endpoints.

        Args:
            is_delivered: messages are delivered in spite of the incompatibility.
            distros: distributions that have the definition of the peer.
        """
        if self._closed:
            return
        writer, reader = incompatibility.writer, incompatibility.reader
        own = writer if writer.participant_guid == self._participant.guid else reader
        effect = "messages that may be decoded wrongly" if is_delivered else "no messages"
        if self._may_be_misread(incompatibility):
            effect = "messages that the other side may misread"
        names = f"from {self.graph.describe_node(writer)} to {self.graph.describe_node(reader)}"
        text = f"{effect} on {own.topic_key.name} {names}: {incompatibility.reason}"
        if incompatibility.kind is IncompatibilityKind.DEFINITION:
            advice = _DEFINITION_ADVICE
            if distros:
                peer = writer if reader.participant_guid == self._participant.guid else reader
                start = f". The definition of {self.graph.describe_node(peer)} belongs to ROS 2 {', '.join(distros)}"
                advice = f"{start}: {distribution_advice(distros, own.service_type or own.type)}"
            text += _STILL_DELIVERED if is_delivered else advice
        if self.on_incompatible_endpoint is not None:
            try:
                self.on_incompatible_endpoint(text, own.topic_key.name)
            except Exception:
                report_failure("Context.on_incompatible_endpoint")
            return
        self._warned[own.topic_key] = count = self._warned.get(own.topic_key, 0) + 1
        if not is_logged(count):
            return
        if not is_logged(count - 1):  # occurrences before this one were skipped
            text = f"{count} incompatible endpoints so far, of which few are logged; {text}"
        namespace, node_name = self.graph.node_of(own)
        get_logger(logger_name(fully_qualified_node_name(node_name, namespace))).warning(text)

    def _may_be_misread(self, incompatibility: Incompatibility) -> bool:
        """Return True for a publisher of this context whose messages are delivered to a subscription with another
        definition of the type.
        """
        writer, reader = incompatibility.writer, incompatibility.reader
        return (
            incompatibility.kind is IncompatibilityKind.DEFINITION
            and reader.participant_guid != self._participant.guid
            and reader.topic_key.kind in ("topic", "reply")
            and self._participant.incompatibility_reason(writer, reader) is None
        )

    def close(self) -> None:
        """Stop announcing nodes, and wake up tasks that wait for a change of the graph."""
        self._closed = True
        self._call_deferred()
        self._changed()


# ------------------------------------------------------------------------------------------- reasons of missing matches

_MAX_PEERS = 3
"""Maximum number of peers that an error text about unmatched endpoints names."""
_MAX_NAME_CHARS = 200
_VERBS = {(False, "topic"): "publishes", (True, "topic"): "subscribes to"}
_PARTICIPANT_ADVICE = {
    "DDS": "; check ROS_DOMAIN_ID and the discovery range, or run `rosidl-py doctor`",
    "Zenoh": "; check ROS_DOMAIN_ID and the Zenoh router",
}


class UnmatchedReason(NamedTuple):
    """Reason why an endpoint has no matched peer.

    Attributes:
        text: reason for people; empty if there is none.
        is_known: False if all peers that were found are compatible, or not compared yet.
    """

    text: str
    is_known: bool = True


class UnmatchedReasons:
    """Finder of the reasons why endpoints of one context have no matched peers."""

    def __init__(
        self,
        graph: Graph,
        compare: Callable[[DiscoveredEndpoint, DiscoveredEndpoint], Incompatibility | None],
        middleware: str,
    ) -> None:
        """Create the finder; `compare` is called with a writer and a reader and returns None if they are compatible."""
        self._graph = graph
        self._compare = compare
        self._middleware = middleware
        self._cache: dict[object, UnmatchedReason] = {}
        self._version = -1

    def why(
        self, guid: bytes, topic_key: TopicKey, *, is_writer: bool, matched: Collection[bytes] = (), ending: str = ""
    ) -> UnmatchedReason:
        """Return the reason why an endpoint of this context has no matched peers other than `matched`.

        Args:
            guid: GUID of the endpoint.
            is_writer: True if the endpoint is a writer.
            ending: ending that all names of this kind of topic have; omitted in the hint about a similar name.
        """
        if self._graph.version != self._version:
            self._cache.clear()
            self._version = self._graph.version
        key = guid, topic_key, frozenset(matched), ending
        if key not in self._cache:
            self._cache[key] = self._find_reason(guid, topic_key, is_writer, matched, ending)
        return self._cache[key]

    def _find_reason(
        self, guid: bytes, topic_key: TopicKey, is_writer: bool, matched: Collection[bytes], ending: str
    ) -> UnmatchedReason:
        peers = [
            peer for peer in self._graph.endpoints_on(topic_key, writers=not is_writer) if peer.guid not in matched
        ]
        own = self._graph.endpoints.get(guid)
        if not peers:
            return UnmatchedReason("" if matched else self._no_peer_text(topic_key, is_writer, ending))
        if own is None:  # not discovered yet
            return UnmatchedReason(self._peer_text(peers[0], None), is_known=False)
        results = [(peer, self._compare(*((own, peer) if is_writer else (peer, own)))) for peer in peers]
        texts = dict.fromkeys(self._peer_text(peer, result) for peer, result in islice(results, _MAX_PEERS))
        more = f"; and {len(peers) - _MAX_PEERS} others" if len(peers) > _MAX_PEERS else ""
        has_policies = any(result is not None and result.policies for _, result in results)
        text = "; ".join(texts) + more + (self._preset_hint(own) if has_policies else "")
        return UnmatchedReason(text, is_known=any(result is not None for _, result in results))

    def alone(self) -> str:
        """Return a text with advice if no other participant was found; empty if there is another participant."""
        if self._graph.has_others():
            return ""
        return f"no other participant was found{_PARTICIPANT_ADVICE.get(self._middleware, '')}"

    def disagreeing(self, guid: bytes, topic_key: TopicKey) -> str:
        """Return a text about a publisher that has another type definition than a subscription of this context.

        The result is empty if there is none.
        """
        own = self._graph.endpoints.get(guid)
        for writer in self._graph.endpoints_on(topic_key, writers=True):
            result = None if own is None else self._compare(writer, own)
            if result is not None and result.kind is IncompatibilityKind.DEFINITION:
                return self._peer_text(writer, result)
        return ""

    def _peer_text(self, peer: DiscoveredEndpoint, result: Incompatibility | None) -> str:
        name = printable(self._graph.describe_node(peer), _MAX_NAME_CHARS)
        return f"{name} was found, but is not connected (yet)" if result is None else result.reason_of(peer, name)

    def _preset_hint(self, own: DiscoveredEndpoint) -> str:
        profiles = [peer.qos for peer in self._graph.endpoints_on(own.topic_key, writers=not own.is_writer)]
        name = find_preset(
            own.qos, publisher=own.is_writer, peers=profiles, is_service=own.topic_key.kind in ("request", "reply")
        )
        return f"; use the preset {name}" if name else "; no preset fits all peers"

    def _no_peer_text(self, topic_key: TopicKey, is_writer: bool, ending: str) -> str:
        verb = _VERBS.get((is_writer, topic_key.kind), "serves")
        names = self._graph.names_on(topic_key.kind, writers=not is_writer)
        name = topic_key.name.removesuffix(ending)
        candidates = (known.removesuffix(ending) for known in names if known.endswith(ending))
        hint = did_you_mean(name, candidates, in_namespaces=True)
        if not hint and (alone := self.alone()):
            return alone
        return f"no node {verb} it{printable(hint, 2 * _MAX_NAME_CHARS)}"
