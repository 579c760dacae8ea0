"""Graph as text, Mermaid and JSON. Names of peers are not trusted, so they are escaped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.terminal_text import json_text
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.graph.model import COUNTERPARTS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.ros_cli.graph.model import Edge, Picture

_ARROWS = {"publishes": "->", "subscribes": "<-", "serves": "<-", "calls": "->"}
_SHAPES = {"topic": ('(["', '"])'), "service": ('{{"', '"}}'), "action": ('[["', '"]]')}


def print_text(picture: Picture) -> None:
    """Print the graph as text."""
    for text, style in lines(picture):
        terminal_output.line(text, style)


def lines(picture: Picture) -> Iterator[tuple[str, str]]:
    """Yield nodes, their topics, services and actions, and the counterparts; each with a style of rich."""
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


def as_json(picture: Picture) -> str:
    """Return a JSON object with the domain, and the topics, services and actions of each node."""
    nodes = []
    for node in picture.nodes:
        entry: dict[str, Any] = {"name": node}
        for role in COUNTERPARTS:
            entry[role] = [_row(picture, edge) for edge in picture.of(node) if edge.role == role]
        nodes.append(entry)
    return json_text({"domain": picture.domain_id, "nodes": nodes}, indent=2) + "\n"


def _row(picture: Picture, edge: Edge) -> dict[str, Any]:
    return {"kind": edge.kind, "name": edge.name, "types": edge.types, "with": picture.counterparts(edge)}


def mermaid(picture: Picture) -> str:
    """Return a flowchart: nodes are boxes, topics round, services hexagons, actions boxes with double sides."""
    nodes = {name: f"n{number}" for number, name in enumerate(sorted({*picture.nodes, *_connected_nodes(picture)}))}
    things = sorted({(edge.kind, edge.name) for edge in picture.edges})
    ids = {thing: f"t{number}" for number, thing in enumerate(things)}
    out = ["flowchart LR"]
    out += [f'  {mark}["{terminal_output.mermaid_label(name)}"]' for name, mark in nodes.items()]
    for (kind, name), mark in ids.items():
        types = sorted(
            {entry for edge in picture.edges if (edge.kind, edge.name) == (kind, name) for entry in edge.types}
        )
        left, right = _SHAPES[kind]
        out.append(f"  {mark}{left}{'<br/>'.join(map(terminal_output.mermaid_label, (name, *types)))}{right}")
    for edge in picture.edges:
        node, thing = nodes[edge.node], ids[edge.kind, edge.name]
        line = "-->" if edge.kind == "topic" else "-.->"
        out.append(f"  {node} {line} {thing}" if edge.role in ("publishes", "calls") else f"  {thing} {line} {node}")
    return "\n".join(out) + "\n"


def _connected_nodes(picture: Picture) -> set[str]:
    return {edge.node for edge in picture.edges}
