"""Edge and Picture: contents of a drawn graph."""

from __future__ import annotations

from dataclasses import dataclass

COUNTERPARTS = {"publishes": "subscribes", "subscribes": "publishes", "serves": "calls", "calls": "serves"}


@dataclass(frozen=True, order=True)
class Edge:
    """Relation of a node to a topic, service or action.

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
    """Graph to draw.

    Attributes:
        nodes: nodes with edges; without filters also those without.
        edges: edges of these nodes and of their counterparts.
        incompatible: publisher's node, topic and subscriber's node of pairs that do not match.
    """

    domain_id: int
    nodes: list[str]
    edges: list[Edge]
    incompatible: frozenset[tuple[str, str, str]] = frozenset()

    def of(self, node: str) -> list[Edge]:
        """Return the edges of a node."""
        return [edge for edge in self.edges if edge.node == node]

    def counterparts(self, edge: Edge) -> list[str]:
        """Return the nodes at the other side of an edge."""
        counterpart = (COUNTERPARTS[edge.role], edge.kind, edge.name)
        return [
            other.node
            for other in self.edges
            if (other.role, other.kind, other.name) == counterpart
            and not set(edge.types).isdisjoint(other.types)
            and not self.incompatible & {(edge.node, edge.name, other.node), (other.node, edge.name, edge.node)}
        ]
