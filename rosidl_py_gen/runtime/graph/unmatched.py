"""Why an endpoint is connected with no peer, in words for the errors of waits that ended.

A reason is cached until the graph changes, as programs poll with short time limits. Text of peers is cut and printable.
"""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.names import similar_name
from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.transport.incompatibility import IncompatibilityKind
from rosidl_py_gen.runtime.transport.qos_matching import find_preset

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from rosidl_py_gen.runtime.graph.graph import Graph
    from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, TopicKey
    from rosidl_py_gen.runtime.transport.incompatibility import Incompatibility

_NOT_YET = "was found, but is not connected (yet)"
_MAX_PEERS = 3
"""Number of peers that a text names."""
_MAX_NAME = 200
_VERBS = {(False, "topic"): "publishes", (True, "topic"): "subscribes to"}
_CURES = {
    "DDS": "; check ROS_DOMAIN_ID and the discovery range, or run `rosidl-py doctor`",
    "Zenoh": "; check ROS_DOMAIN_ID and the Zenoh router",
}


class UnmatchedReason(NamedTuple):
    """Text of a reason, empty where there is none.

    Attributes:
        is_known: false when a peer was found and nothing stands against it.
    """

    text: str
    is_known: bool = True


class UnmatchedReasons:
    """The reasons for the endpoints of one context."""

    def __init__(
        self,
        graph: Graph,
        compare: Callable[[DiscoveredEndpoint, DiscoveredEndpoint], Incompatibility | None],
        middleware: str,
    ) -> None:
        """`compare` gets a writer and a reader."""
        self._graph = graph
        self._compare = compare
        self._middleware = middleware
        self._cache: dict[object, UnmatchedReason] = {}
        self._version = -1

    def why(
        self, own: bytes, channel: TopicKey, *, is_writer: bool, matched: Collection[bytes] = (), ending: str = ""
    ) -> UnmatchedReason:
        """Return why an endpoint of ours has no peers but `matched`.

        Args:
            own: GUID of the endpoint.
            ending: what names of this kind have in common, which a similar name is shown without.
        """
        if self._graph.version != self._version:
            self._cache.clear()
            self._version = self._graph.version
        key = own, channel, frozenset(matched), ending
        if key not in self._cache:
            self._cache[key] = self._why(own, channel, is_writer, matched, ending)
        return self._cache[key]

    def _why(
        self, own: bytes, channel: TopicKey, is_writer: bool, matched: Collection[bytes], ending: str
    ) -> UnmatchedReason:
        peers = [one for one in self._graph.endpoints_on(channel, writers=not is_writer) if one.guid not in matched]
        mine = self._graph.endpoints.get(own)
        if not peers:
            return UnmatchedReason("" if matched else self._nobody(channel, is_writer, ending))
        if mine is None:  # not discovered yet
            return UnmatchedReason(self._reason(peers[0], None), is_known=False)
        found = [(peer, self._compare_with(mine, peer)) for peer in peers]
        several = dict.fromkeys(self._reason(peer, reason) for peer, reason in islice(found, _MAX_PEERS))
        more = f"; and {len(peers) - _MAX_PEERS} others" if len(peers) > _MAX_PEERS else ""
        has_policies = any(reason is not None and reason.policies for _, reason in found)
        text = "; ".join(several) + more + (self._preset(mine) if has_policies else "")
        return UnmatchedReason(text, is_known=any(reason is not None for _, reason in found))

    def alone(self) -> str:
        """Return that there is no other participant, and what to check; empty where there is one."""
        if self._graph.has_others():
            return ""
        return f"no other participant was found{_CURES.get(self._middleware, '')}"

    def disagreeing(self, own: bytes, channel: TopicKey) -> str:
        """Return which connected publisher has another definition of the type; empty if none has."""
        mine = self._graph.endpoints.get(own)
        if mine is None:
            return ""
        for writer in self._graph.endpoints_on(channel, writers=True):
            found = self._compare(writer, mine)
            if found is not None and found.kind is IncompatibilityKind.DEFINITION:
                return self._reason(writer, found)
        return ""

    def _compare_with(self, mine: DiscoveredEndpoint, peer: DiscoveredEndpoint) -> Incompatibility | None:
        return self._compare(*((mine, peer) if mine.is_writer else (peer, mine)))

    def _reason(self, peer: DiscoveredEndpoint, found: Incompatibility | None) -> str:
        name = printable(self._graph.describe_node(peer), _MAX_NAME)
        return f"{name} {_NOT_YET}" if found is None else found.reason_of(peer, name)

    def _preset(self, mine: DiscoveredEndpoint) -> str:
        profiles = [peer.qos for peer in self._graph.endpoints_on(mine.channel, writers=not mine.is_writer)]
        name = find_preset(
            mine.qos, publisher=mine.is_writer, peers=profiles, is_service=mine.channel.kind in ("request", "reply")
        )
        return f"; use the preset {name}" if name else "; no preset fits all peers"

    def _nobody(self, channel: TopicKey, is_writer: bool, ending: str) -> str:
        verb = _VERBS.get((is_writer, channel.kind), "serves")
        names = self._graph.names_on(channel.kind, writers=not is_writer)
        name = channel.name.removesuffix(ending)
        hint = similar_name(name, (one.removesuffix(ending) for one in names if one.endswith(ending)))
        if not hint and (alone := self.alone()):
            return alone
        return f"no node {verb} it{printable(hint, 2 * _MAX_NAME)}"
