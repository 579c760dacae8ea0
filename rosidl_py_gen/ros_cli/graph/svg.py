"""SVG picture of a graph: columns of publishers, topics and subscribers; below, clients, services and servers.

The order within columns is changed until few lines cross. A node that publishes and subscribes is in both outer
columns. Layout libraries require graphviz or are not maintained, and three columns need none. Text is monospaced, so
that box widths need no measuring.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.errors import printable

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rosidl_py_gen.ros_cli.graph.text import Edge, Picture

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
