"""The servers of one client: which have answered, and so are connected with the reader of its replies; which are there.

Decides when all have answered: each since the last of them appeared, which may have been made anew. A server is gone
when the graph has neither what it reads nor what it writes any more: at once when it was closed, with the end of its
lease when it was killed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.graph.state import Graph


class Answering:
    """The servers of one client. A server is known by its participant: what it reads and writes has that in common."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._readers: set[bytes] = set()
        self._servers: frozenset[bytes] = frozenset()
        self._heard: set[bytes] = set()

    def reach(self, readers: set[bytes]) -> None:
        """These are all that requests go to, or will a moment later."""
        if not readers <= self._readers:
            self._heard.clear()
        self._readers = readers
        self._servers = frozenset(map(self._participant, readers))
        self._heard &= self._servers

    def heard(self, writer: bytes) -> None:
        """A reply came from that writer."""
        self._heard.add(self._participant(writer))

    def all_have(self) -> bool:
        """Whether all have answered; never, when one participant has several, whose answers cannot be told apart."""
        return bool(self._readers) and self._heard == self._servers and len(self._servers) == len(self._readers)

    def _participant(self, guid: bytes) -> bytes:
        return self._graph.participant_of(guid) or guid


class Presence:
    """The endpoints of all servers of one service."""

    def __init__(self, graph: Graph, request_topic: str, reply_topic: str) -> None:
        self._graph = graph
        self._request_topic = request_topic
        self._reply_topic = reply_topic
        self._version = -1
        self._guids: frozenset[bytes] = frozenset()

    def now(self) -> frozenset[bytes]:
        """Their GUIDs; the same object until the graph changes, so that any number of requests can keep it."""
        graph = self._graph
        if graph.version != self._version:
            self._version = graph.version
            readers = graph.on_topic(self._request_topic, writers=False)
            writers = graph.on_topic(self._reply_topic, writers=True)
            self._guids = frozenset(one.guid for one in (*readers, *writers))
        return self._guids
