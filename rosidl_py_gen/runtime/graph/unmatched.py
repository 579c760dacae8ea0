"""Search for the reason why an endpoint has no matched peer, as text for errors of waits that timed out.

A reason is cached until the graph changes, because programs poll with short timeouts. Names and other texts of peers
are made printable and truncated.
"""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.names import similar_name
from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.transport.matching import IncompatibilityKind, find_preset

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from rosidl_py_gen.runtime.graph.graph import Graph
    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, TopicKey
    from rosidl_py_gen.runtime.transport.matching import Incompatibility

_MAX_PEERS = 3
"""Maximum number of peers that an error text about unmatched endpoints names."""
_MAX_NAME_CHARS = 200
_VERBS = {(False, "topic"): "publishes", (True, "topic"): "subscribes to"}
_ADVICES = {
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
        return f"no other participant was found{_ADVICES.get(self._middleware, '')}"

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
        hint = similar_name(name, (known.removesuffix(ending) for known in names if known.endswith(ending)))
        if not hint and (alone := self.alone()):
            return alone
        return f"no node {verb} it{printable(hint, 2 * _MAX_NAME_CHARS)}"
