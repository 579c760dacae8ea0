"""The graph as text for people, as Mermaid and as JSON. Names of peers are not trusted: what these read is escaped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.output import json_text
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.graph.picture import COUNTERPARTS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.ros_cli.graph.picture import Edge, Picture

_ARROWS = {"publishes": "->", "subscribes": "<-", "serves": "<-", "calls": "->"}
_SHAPES = {"topic": ('(["', '"])'), "service": ('{{"', '"}}'), "action": ('[["', '"]]')}


def print_text(picture: Picture) -> None:
    """Print what `lines` gives."""
    for text, style in lines(picture):
        terminal_output.line(text, style)


def lines(picture: Picture) -> Iterator[tuple[str, str]]:
    """The nodes, below them what they have, and below that who is on the other side; each with a style of rich."""
    if not picture.nodes:
        yield f"no nodes in domain {picture.domain_id}", ""
    for node in picture.nodes:
        yield node, "bold"
        mine = picture.of(node)
        for role in COUNTERPARTS:
            for kind in _SHAPES:
                these = [edge for edge in mine if (edge.role, edge.kind) == (role, kind)]
                if these:
                    yield f"  {role}{'' if kind == 'topic' else f' {kind}'}", "cyan"
                for edge in these:
                    yield f"    {edge.name} [{', '.join(edge.types)}]", ""
                    others = ", ".join(picture.counterparts(edge)) or "nobody"
                    yield f"      {_ARROWS[role]} {others}", "dim"


def as_json(picture: Picture) -> str:
    """One object: the domain, and for each node its topics, services and actions."""
    nodes = []
    for node in picture.nodes:
        one: dict[str, Any] = {"name": node}
        for role in COUNTERPARTS:
            one[role] = [_row(picture, edge) for edge in picture.of(node) if edge.role == role]
        nodes.append(one)
    return json_text({"domain": picture.domain_id, "nodes": nodes}, indent=2) + "\n"


def _row(picture: Picture, edge: Edge) -> dict[str, Any]:
    return {"kind": edge.kind, "name": edge.name, "types": edge.types, "with": picture.counterparts(edge)}


# ------------------------------------------------------------------------------------------------------------- Mermaid


def mermaid(picture: Picture) -> str:
    """A flowchart from left to right: nodes are boxes, topics round, services hexagons, actions have double sides."""
    nodes = {name: f"n{number}" for number, name in enumerate(sorted({*picture.nodes, *_having(picture)}))}
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


def _having(picture: Picture) -> set[str]:
    return {edge.node for edge in picture.edges}
