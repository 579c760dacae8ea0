"""Why an endpoint is connected with no peer, in words for the errors of waits that ended.

A reason is cached until the graph changes, as programs poll with short time limits. Text of peers is cut and printable.
"""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, Protocol

from rosidl_py_gen.base.names import similar_name
from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.transport.matching import check_compatible, describe_policies, find_preset

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from rosidl_py_gen.runtime.graph.state import Graph
    from rosidl_py_gen.runtime.transport.discovered import Channel, EndpointFound

NOT_YET = "was found, but is not connected (yet)"
"""End of the reason where none is known."""
_MAX_PEERS = 3
"""Number of peers that a text names."""
_MAX_NAME, _MAX_TYPE = 200, 300
_VERBS = {(False, "topic"): "publishes", (True, "topic"): "subscribes to"}
_CURES = {
    "DDS": "; check ROS_DOMAIN_ID and the discovery range, or run `rosidl-py doctor`",
    "Zenoh": "; check ROS_DOMAIN_ID and the Zenoh router",
}


class Comparer(Protocol):
    """Function that compares a writer and a reader: `Discovery.apart`."""

    def __call__(self, writer: EndpointFound, reader: EndpointFound) -> tuple[str, str]: ...


class UnmatchedReasons:
    """The reasons for the endpoints of one context."""

    def __init__(self, graph: Graph, compare: Comparer, middleware: str) -> None:
        self._graph = graph
        self._compare = compare
        self._middleware = middleware
        self._cache: dict[object, str] = {}
        self._version = -1

    def why(
        self, own: bytes, channel: Channel, *, is_writer: bool, matched: Collection[bytes] = (), ending: str = ""
    ) -> str:
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

    def _why(self, own: bytes, channel: Channel, is_writer: bool, matched: Collection[bytes], ending: str) -> str:
        peers = [one for one in self._graph.on(channel, writers=not is_writer) if one.guid not in matched]
        mine = self._graph.endpoints.get(own)
        if not peers:
            return "" if matched else self._nobody(channel, is_writer, ending)
        if mine is None:  # not discovered yet
            return f"{self._named(peers[0])} {NOT_YET}"
        several: dict[str, None] = dict.fromkeys(islice(self._reasons(mine, peers), _MAX_PEERS))
        more = f"; and {len(peers) - _MAX_PEERS} others" if len(peers) > _MAX_PEERS else ""
        return "; ".join(several) + more + self._preset(mine, peers)

    def alone(self) -> str:
        """Return that there is no other participant, and what to check; empty where there is one."""
        if self._graph.has_others():
            return ""
        return f"no other participant was found{_CURES.get(self._middleware, '')}"

    def disagreeing(self, own: bytes, channel: Channel) -> str:
        """Return which connected publisher has another definition of the type; empty if none has."""
        mine = self._graph.endpoints.get(own)
        if mine is None:
            return ""
        for writer in self._graph.on(channel, writers=True):
            if self._compare(writer, mine)[0] == "definition":
                return self._reason(mine, writer)
        return ""

    def _reasons(self, mine: EndpointFound, peers: list[EndpointFound]) -> Iterator[str]:
        for peer in peers:
            yield self._reason(mine, peer)

    def _reason(self, mine: EndpointFound, peer: EndpointFound) -> str:
        kind, reason = self._compare(*((mine, peer) if mine.is_writer else (peer, mine)))
        who = self._named(peer)
        if kind == "type":
            return f"{who} has another type, {printable(peer.service_type or peer.type, _MAX_TYPE)}"
        if kind == "definition":
            theirs, ours = (printable(one.type_hash or one.service_hash, _MAX_NAME) for one in (peer, mine))
            of = "its type" if mine.channel.kind != "topic" else printable(mine.type, _MAX_TYPE)
            return f"{who} has another definition of {of}, {theirs}; here it is {ours}"
        if kind == "qos":
            verb = "requests" if mine.is_writer else "offers"
            found = describe_policies(theirs=peer.qos, ours=mine.qos, policies=self._policies(mine, peer))
            return f"{who} {verb} incompatible QoS: {found}" if found else f"{who} does not match: {reason}"
        return f"{who} {NOT_YET}"

    def _policies(self, mine: EndpointFound, peer: EndpointFound) -> tuple[str, ...]:
        offer, request = (mine, peer) if mine.is_writer else (peer, mine)
        return tuple(one.name.lower() for one in check_compatible(offer.qos, request.qos).policies)

    def _preset(self, mine: EndpointFound, peers: list[EndpointFound]) -> str:
        if self._middleware == "Zenoh" or not any(self._policies(mine, peer) for peer in peers):
            return ""
        profiles = [peer.qos for peer in self._graph.on(mine.channel, writers=not mine.is_writer)]
        name = find_preset(
            mine.qos, publisher=mine.is_writer, peers=profiles, is_service=mine.channel.kind in ("request", "reply")
        )
        return f"; use the preset {name}" if name else "; no preset fits all peers"

    def _nobody(self, channel: Channel, is_writer: bool, ending: str) -> str:
        verb = _VERBS.get((is_writer, channel.kind), "serves")
        names = self._graph.names_on(channel.kind, writers=not is_writer)
        name = channel.name.removesuffix(ending)
        hint = similar_name(name, (one.removesuffix(ending) for one in names if one.endswith(ending)))
        if not hint and (alone := self.alone()):
            return alone
        return f"no node {verb} it{printable(hint, 2 * _MAX_NAME)}"

    def _named(self, peer: EndpointFound) -> str:
        return printable(self._graph.describe_node(peer), _MAX_NAME)
