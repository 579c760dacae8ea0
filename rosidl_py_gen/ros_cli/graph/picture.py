"""What a picture of the graph consists of, before it is drawn."""

from __future__ import annotations

from dataclasses import dataclass

COUNTERPARTS = {"publishes": "subscribes", "subscribes": "publishes", "serves": "calls", "calls": "serves"}


@dataclass(frozen=True, order=True)
class Edge:
    """One node has something to do with a topic, service or action.

    Attributes:
        role: a key of `COUNTERPARTS`.
        kind: topic, service or action.
    """

    node: str
    role: str
    kind: str
    name: str
    types: tuple[str, ...]


@dataclass(frozen=True)
class Picture:
    """What is shown.

    Attributes:
        nodes: those with something to show, and in an unfiltered picture also those without.
        edges: of these nodes and of their counterparts.
        apart: publisher's node, topic and subscriber's node, where nothing passes between the two.
    """

    domain_id: int
    nodes: list[str]
    edges: list[Edge]
    incompatible: frozenset[tuple[str, str, str]] = frozenset()

    def of(self, node: str) -> list[Edge]:
        """What a node has."""
        return [edge for edge in self.edges if edge.node == node]

    def counterparts(self, edge: Edge) -> list[str]:
        """The nodes on the other side that it is connected with."""
        wanted = (COUNTERPARTS[edge.role], edge.kind, edge.name)
        return [
            other.node
            for other in self.edges
            if (other.role, other.kind, other.name) == wanted
            and not set(edge.types).isdisjoint(other.types)
            and not self.incompatible & {(edge.node, edge.name, other.node), (other.node, edge.name, edge.node)}
        ]
