"""Contents of a drawn graph, and the graph as text, Mermaid and JSON. Names of peers are escaped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.ros_cli import terminal_output

if TYPE_CHECKING:
    from collections.abc import Iterator


COUNTERPARTS = {"publishes": "subscribes", "subscribes": "publishes", "serves": "calls", "calls": "serves"}


@dataclass(frozen=True, order=True)
class Edge:
    """Relation of a node to a topic, service or action (`kind`); `role` is a key of `COUNTERPARTS`."""

    node: str
    role: str
    kind: str
    name: str
    types: tuple[str, ...]


@dataclass(frozen=True)
class Picture:
    """Contents of a drawn graph.

    Attributes:
        nodes: nodes with edges; if no filter is used, also nodes without edges.
        edges: edges of these nodes and of their counterparts.
        incompatible: publisher's node, topic and subscriber's node of pairs that do not match.
    """

    domain_id: int
    nodes: list[str]
    edges: list[Edge]
    incompatible: frozenset[tuple[str, str, str]] = frozenset()

    def of(self, node: str) -> list[Edge]:
        """Return the edges of one node in the drawn graph."""
        return [edge for edge in self.edges if edge.node == node]

    def counterparts(self, edge: Edge) -> list[str]:
        """Return the nodes at the other side of an edge, such as the subscribers of a published topic."""
        counterpart = (COUNTERPARTS[edge.role], edge.kind, edge.name)
        return [
            other.node
            for other in self.edges
            if (other.role, other.kind, other.name) == counterpart
            and not set(edge.types).isdisjoint(other.types)
            and not self.incompatible & {(edge.node, edge.name, other.node), (other.node, edge.name, edge.node)}
        ]


_ARROWS = {"publishes": "->", "subscribes": "<-", "serves": "<-", "calls": "->"}
_SHAPES = {"topic": ('(["', '"])'), "service": ('{{"', '"}}'), "action": ('[["', '"]]')}


def text_lines(picture: Picture) -> Iterator[tuple[str, str]]:
    """Yield the lines of the graph as text, each with a style of rich: nodes, their topics, and the counterparts."""
    if not picture.nodes:
        yield f"no nodes in domain {picture.domain_id}", ""
    for node in picture.nodes:
        yield node, "bold"
        edges = picture.of(node)
        for role in COUNTERPARTS:
            for kind in _SHAPES:
                selected = [edge for edge in edges if (edge.role, edge.kind) == (role, kind)]
                if selected:
                    yield f"  {role}{'' if kind == 'topic' else f' {kind}'}", "cyan"
                for edge in selected:
                    yield f"    {edge.name} [{', '.join(edge.types)}]", ""
                    others = ", ".join(picture.counterparts(edge)) or "no peer"
                    yield f"      {_ARROWS[role]} {others}", "dim"


def graph_document(picture: Picture) -> dict[str, Any]:
    """Return the graph as a value for JSON output: the domain, and the topics, services and actions of each node."""
    nodes = []
    for node in picture.nodes:
        entry: dict[str, Any] = {"name": node}
        for role in COUNTERPARTS:
            entry[role] = [_row(picture, edge) for edge in picture.of(node) if edge.role == role]
        nodes.append(entry)
    return {"domain": picture.domain_id, "nodes": nodes}


def _row(picture: Picture, edge: Edge) -> dict[str, Any]:
    return {"kind": edge.kind, "name": edge.name, "types": edge.types, "with": picture.counterparts(edge)}


def mermaid_text(picture: Picture) -> str:
    """Return a Mermaid flowchart: nodes are boxes, topics round, services hexagons, actions double boxes."""
    nodes = {
        name: f"n{number}"
        for number, name in enumerate(sorted({*picture.nodes, *(edge.node for edge in picture.edges)}))
    }
    things = sorted({(edge.kind, edge.name) for edge in picture.edges})
    ids = {thing: f"t{number}" for number, thing in enumerate(things)}
    out = ["flowchart LR"]
    out += [f'  {mark}["{terminal_output.mermaid_label(name)}"]' for name, mark in nodes.items()]
    for (kind, name), mark in ids.items():
        types = sorted({one for edge in picture.edges if (edge.kind, edge.name) == (kind, name) for one in edge.types})
        left, right = _SHAPES[kind]
        out.append(f"  {mark}{left}{'<br/>'.join(map(terminal_output.mermaid_label, (name, *types)))}{right}")
    for edge in picture.edges:
        node, thing = nodes[edge.node], ids[edge.kind, edge.name]
        line = "-->" if edge.kind == "topic" else "-.->"
        out.append(f"  {node} {line} {thing}" if edge.role in ("publishes", "calls") else f"  {thing} {line} {node}")
    return "\n".join(out) + "\n"
