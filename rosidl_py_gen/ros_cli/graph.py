"""Command ``graph``: connections of nodes through topics, services and actions, as text, Mermaid, SVG or JSON.

An action is one item, instead of its two topics and three services. Topics and services that every node has are
omitted. Names of peers are escaped.

The SVG picture has columns of publishers, topics and subscribers; below, clients, services and servers. The order
within columns is changed until few lines cross. A node that publishes and subscribes is in both outer columns. Layout
libraries require graphviz or are not maintained, and three columns need none. Text is monospaced, so that box widths
need no measuring.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import product
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.terminal_text import json_text, pluralize
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.errors import printable
from rosidl_py_gen.ros_cli import options

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import Node

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


_CHAR_WIDTH = 7.25
_SMALL_CHAR_WIDTH = 6.05
_ROW_HEIGHT = 40
_ROW_GAP = 12
_PADDING = 10
_MARGIN = 24
_COLUMN_GAP = 110
_HEADING_HEIGHT = 26
_MAX_CHARS = 60
_SWEEPS = 6
_STYLE = (
    "text{font:12px monospace;fill:#1b2733}.type{font-size:10px;fill:#5b6b7a}.head{font-size:11px;fill:#7a8794}"
    "rect{stroke-width:1}.node{fill:#e8f0fe;stroke:#4a7dbd}.topic{fill:#eef7ee;stroke:#5c9a63}"
    ".service{fill:#fff4e2;stroke:#c98a2b}.action{fill:#fdecef;stroke:#c0566d}"
    "path{fill:none;stroke:#8a99a8;stroke-width:1.2}.arrow{fill:#8a99a8;stroke:none}"
)
_ARROW = (
    '<defs><marker id="arrow" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
    '<path class="arrow" d="M0 1L8 4L0 7z"/></marker></defs>'
)


@dataclass
class _NodeBox:
    """Box of a node, topic, service or action in the picture; `y` is the vertical middle of the box."""

    name: str
    kind: str
    types: str = ""
    x: float = 0
    y: float = 0
    width: float = 0


def svg_picture(picture: Picture) -> str:
    """Return the SVG file of a graph as text."""
    layouts = [
        _ColumnLayout(
            [edge for edge in picture.edges if edge.kind == "topic"], ("publishers", "topics", "subscribers")
        ),
        _ColumnLayout(
            [edge for edge in picture.edges if edge.kind != "topic"], ("clients", "services, actions", "servers")
        ),
    ]
    connected = {edge.node for edge in picture.edges}
    unconnected = [name for name in picture.nodes if name not in connected]
    elements: list[str] = []
    y = float(_MARGIN)
    width = 300.0
    for layout in layouts:
        if layout.edges:
            layout.place(y)
            elements += layout.draw()
            y, width = layout.bottom + _MARGIN, max(width, layout.right)
    for text in [f"no connections: {', '.join(unconnected)}"] if unconnected else [] if connected else ["no nodes"]:
        elements.append(f'<text x="{_MARGIN}" y="{y + 12:.0f}" class="head">{_escaped(text, 400)}</text>')
        y, width = y + _MARGIN, max(width, min(len(text), 400) * _CHAR_WIDTH)
    size = f"{width + 2 * _MARGIN:.0f}", f"{y + _MARGIN:.0f}"
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]}" height="{size[1]}" '
        f'viewBox="0 0 {size[0]} {size[1]}"><style>{_STYLE}</style>{_ARROW}'
        f'<rect width="100%" height="100%" fill="#fff"/>'
    )
    return "\n".join([head, *elements, "</svg>"]) + "\n"


class _ColumnLayout:
    def __init__(self, edges: list[Edge], headings: tuple[str, str, str]) -> None:
        self.edges = edges
        self.bottom = self.right = 0.0
        self._headings = headings
        into = ("publishes", "calls")
        middle: dict[tuple[str, str], _NodeBox] = {}
        sides: tuple[dict[str, _NodeBox], dict[str, _NodeBox]] = ({}, {})
        self._lines: list[tuple[_NodeBox, _NodeBox]] = []
        for edge in edges:
            box = middle.setdefault((edge.kind, edge.name), _NodeBox(edge.name, edge.kind, ", ".join(edge.types)))
            is_left = edge.role in into
            node = sides[not is_left].setdefault(edge.node, _NodeBox(edge.node, "node"))
            self._lines.append((node, box) if is_left else (box, node))
        self._columns = [list(sides[0].values()), list(middle.values()), list(sides[1].values())]

    def place(self, top: float) -> None:
        self._reduce_crossings()
        tallest = max(map(len, self._columns)) * (_ROW_HEIGHT + _ROW_GAP)
        x = float(_MARGIN)
        for column in self._columns:
            width = max([len(self._headings[0]) * _CHAR_WIDTH, *(_width(box) for box in column)])
            y = top + _HEADING_HEIGHT + (tallest - len(column) * (_ROW_HEIGHT + _ROW_GAP)) / 2
            for number, box in enumerate(column):
                box.x, box.y, box.width = x, y + number * (_ROW_HEIGHT + _ROW_GAP) + _ROW_HEIGHT / 2, width
            x += width + _COLUMN_GAP
        self._top, self.bottom, self.right = top, top + _HEADING_HEIGHT + tallest, x - _COLUMN_GAP

    def _reduce_crossings(self) -> None:
        """Move each box to the mean position of its neighbours, sweeping over the columns in both directions."""
        neighbours: dict[int, list[_NodeBox]] = {}
        for left, right in self._lines:
            neighbours.setdefault(id(left), []).append(right)
            neighbours.setdefault(id(right), []).append(left)
        self._spread()
        for sweep in range(_SWEEPS):
            for column in self._columns if sweep % 2 else reversed(self._columns):
                column.sort(key=lambda box: _mean([other.y for other in neighbours[id(box)]]))
                self._spread()

    def _spread(self) -> None:
        for column in self._columns:
            for number, box in enumerate(column):
                box.y = (number + 0.5) / len(column)

    def draw(self) -> Iterator[str]:
        for left, right in self._lines:
            start, end = left.x + left.width, right.x
            bend = (end - start) / 2
            yield (
                f'<path d="M{start:.1f} {left.y:.1f}C{start + bend:.1f} {left.y:.1f} {end - bend:.1f} {right.y:.1f} '
                f'{end:.1f} {right.y:.1f}" marker-end="url(#arrow)"/>'
            )
        for head, column in zip(self._headings, self._columns, strict=True):
            if column:
                yield f'<text x="{column[0].x:.1f}" y="{self._top + 12:.1f}" class="head">{head}</text>'
            for box in column:
                yield from _draw(box)


def _width(box: _NodeBox) -> float:
    name, types = min(len(box.name), _MAX_CHARS), min(len(box.types), _MAX_CHARS)
    return max(name * _CHAR_WIDTH, types * _SMALL_CHAR_WIDTH) + 2 * _PADDING


def _mean(places: Sequence[float]) -> float:
    return sum(places) / len(places)


def _draw(box: _NodeBox) -> Iterator[str]:
    round_ = _ROW_HEIGHT / 2 if box.kind == "topic" else 4
    text_y = box.y - 3 if box.types else box.y + 4
    full = f"{box.name} {box.types}".rstrip()
    yield f"<g><title>{_escaped(full, 1000)}</title>"
    yield (
        f'<rect class="{box.kind}" x="{box.x:.1f}" y="{box.y - _ROW_HEIGHT / 2:.1f}" width="{box.width:.1f}" '
        f'height="{_ROW_HEIGHT}" rx="{round_:.0f}"/>'
    )
    middle = box.x + box.width / 2
    yield f'<text x="{middle:.1f}" y="{text_y:.1f}" text-anchor="middle">{_escaped(box.name)}</text>'
    if box.types:
        y = box.y + 13
        yield f'<text class="type" x="{middle:.1f}" y="{y:.1f}" text-anchor="middle">{_escaped(box.types)}</text>'
    yield "</g>"


def _escaped(text: str, max_chars: int = _MAX_CHARS) -> str:
    from html import escape

    return escape(printable(text if len(text) <= max_chars else f"{text[: max_chars - 3]}..."))


_ACTION, _GOAL = "/_action/", "/_action/send_goal"
_EVERY_TOPIC = ("/rosout", "/parameter_events")
_EVERY_PACKAGE = ("rcl_interfaces/srv/", "type_description_interfaces/srv/")


@click.command("graph")
@options.output_format_options("svg")
@click.option(
    "--node",
    "nodes",
    multiple=True,
    metavar="NAME",
    shell_complete=options.completion("nodes"),
    help="Show only these nodes and their connections; * matches any text. May be repeated.",
)
@click.option(
    "--topic",
    "topics",
    multiple=True,
    metavar="NAME",
    shell_complete=options.completion("topics"),
    help="Show only these topics, services or actions; as --node.",
)
@click.option("-a", "--all", "everything", is_flag=True, help="Also show hidden names, and what every node has.")
@options.node_verb
async def graph(
    command_node: CommandNode,
    kind: str | None,
    as_json: bool,
    output: str | None,
    nodes: tuple[str, ...],
    topics: tuple[str, ...],
    everything: bool,
) -> None:
    """Show which nodes are connected through which topics, services and actions.

    Parameter services, /rosout and /parameter_events, which every node has, are omitted.

    \b
    rosidl-py graph
    rosidl-py graph -o graph.svg
    rosidl-py graph --node '/camera*' --format mermaid
    """
    import asyncio

    kind = options.output_format("svg", kind, as_json, output)
    await command_node.wait_for_node_names()
    picture = _filtered(_picture(command_node, everything), nodes, topics)

    draw = {
        "svg": lambda: svg_picture(picture),
        "mermaid": lambda: mermaid_text(picture),
        "json": lambda: json_text(graph_document(picture), indent=2),
    }
    await asyncio.to_thread(terminal_output.drawing, kind, output, text_lines(picture), draw)
    if output is not None:
        terminal_output.note(f"wrote {output}: {pluralize(len(picture.nodes), 'node')}")


def _picture(command_node: CommandNode, everything: bool) -> Picture:

    node = command_node.node
    edges: set[Edge] = set()
    names = []
    for info in node.get_nodes():
        full = info.fully_qualified_name
        if full != node.fully_qualified_name and (everything or not info.name.startswith("_")):
            names.append(full)
            edges.update(_edges_of(node, info.name, info.namespace, full, everything))
    edges.update(_edges_without_node(node, everything))
    unlisted = {edge.node for edge in edges} - set(names)
    return Picture(
        command_node.context.domain_id, sorted({*names, *unlisted}), sorted(edges), _unmatched_nodes(node, edges)
    )


def _unmatched_nodes(node: Node, edges: Iterable[Edge]) -> frozenset[tuple[str, str, str]]:
    """Return tuples (publisher's node, topic, subscriber's node) of nodes with endpoints on the same topic none of
    which match.
    """
    match: dict[tuple[str, str, str], bool] = {}
    for topic in {edge.name for edge in edges if edge.kind == "topic"}:
        incompatible = {
            (one.writer.endpoint_gid, one.reader.endpoint_gid) for one in node.incompatible_endpoints_of_topic(topic)
        }
        for writer, reader in product(
            node.get_publishers_info_by_topic(topic), node.get_subscriptions_info_by_topic(topic)
        ):
            pair = writer.node_text, topic, reader.node_text
            match[pair] = match.get(pair, False) or (writer.endpoint_gid, reader.endpoint_gid) not in incompatible
    return frozenset(pair for pair, are_connected in match.items() if not are_connected)


def _edges_of(node: Node, name: str, namespace: str, full: str, everything: bool) -> Iterator[Edge]:

    topics = {
        "publishes": node.get_publisher_names_and_types_by_node,
        "subscribes": node.get_subscriber_names_and_types_by_node,
    }
    services = {
        "serves": node.get_service_names_and_types_by_node,
        "calls": node.get_client_names_and_types_by_node,
    }
    for role, names_of in topics.items():
        for topic, types in names_of(name, namespace):
            if _is_topic(topic, everything):
                yield Edge(full, role, "topic", topic, tuple(types))
    for role, names_of in services.items():
        for service, types in names_of(name, namespace):
            if service.endswith(_GOAL):
                actions = tuple(one.removesuffix("_SendGoal") for one in types)
                yield Edge(full, role, "action", service.removesuffix(_GOAL), actions)
            elif _ACTION not in service and (everything or _is_own(service, types)):
                yield Edge(full, role, "service", service, tuple(types))


def _edges_without_node(node: Node, everything: bool) -> Iterator[Edge]:
    """Yield an edge of the graph for each endpoint that belongs to no node, or whose node name has not arrived yet."""
    for topic, _ in node.get_topic_names_and_types():
        if _is_topic(topic, everything):
            for role, infos in (
                ("publishes", node.get_publishers_info_by_topic(topic)),
                ("subscribes", node.get_subscriptions_info_by_topic(topic)),
            ):
                for info in infos:
                    if not info.has_node_name:
                        yield Edge(info.node_text, role, "topic", topic, (info.topic_type,))


def _is_topic(topic: str, everything: bool) -> bool:
    return _ACTION not in topic and (everything or not (topic in _EVERY_TOPIC or "/_" in topic))


def _is_own(service: str, types: Iterable[str]) -> bool:
    return "/_" not in service and not any(one.startswith(_EVERY_PACKAGE) for one in types)


def _filtered(picture: Picture, nodes: tuple[str, ...], topics: tuple[str, ...]) -> Picture:
    if not nodes and not topics:
        return picture
    selected_nodes = _matching(nodes, picture.nodes, "node")
    selected_names = _matching(topics, sorted({edge.name for edge in picture.edges}), "topic, service or action")
    names = {
        (edge.kind, edge.name)
        for edge in picture.edges
        if (not nodes or edge.node in selected_nodes) and (not topics or edge.name in selected_names)
    }
    edges = [edge for edge in picture.edges if (edge.kind, edge.name) in names]
    selected = selected_nodes if nodes else {edge.node for edge in edges}
    return replace(picture, nodes=sorted(selected), edges=edges)


def _matching(patterns: tuple[str, ...], names: list[str], subject: str) -> set[str]:
    edges: set[str] = set()
    for text in patterns:
        pattern = text if text.startswith(("/", "*", "(")) else f"/{text}"
        matches = [name for name in names if fnmatchcase(name, pattern)]
        if not matches:
            hint = did_you_mean(pattern, names) or f"; {len(names)} are known"
            raise CommandError(f"no {subject} {pattern}{hint}")
        edges.update(matches)
    return edges
