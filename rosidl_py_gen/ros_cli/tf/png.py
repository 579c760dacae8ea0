"""Frames as a PNG picture, by Pillow: a row for each level, every frame above the middle of those below it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from PIL import Image, ImageDraw, ImageFont

from rosidl_py_gen.errors import printable
from rosidl_py_gen.ros_cli import ToolError
from rosidl_py_gen.ros_cli.tf.text import facts

if TYPE_CHECKING:
    from pathlib import Path

    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameArrivals, FrameStatistics

_SIZE, _SMALL = 16, 12
_PAD, _GAP, _BOX, _ROW, _MARGIN = 12, 28, 34, 92, 24
_MOST_CHARS, _MOST_PIXELS = 60, 40_000_000
_INK, _DIM, _LINE = "#1b2733", "#5b6b7a", "#8a99a8"
_MOVING, _STATIC, _ROOT = ("#e8f0fe", "#4a7dbd"), ("#eef7ee", "#5c9a63"), ("#fff4e2", "#c98a2b")


class _Place:
    """A frame in the picture: the middle of its box, and how wide everything below it is."""

    def __init__(self, name: str, frame: FrameArrivals | None, level: int, width: float) -> None:
        self.name, self.frame, self.level, self.width = name, frame, level, width
        self.below: list[_Place] = []
        self.total = width
        self.x = 0.0

    @property
    def y(self) -> float:
        return _MARGIN + self.level * _ROW + _BOX / 2


def write(frames: FrameStatistics, names: dict[Any, str], path: Path) -> None:
    """Raises `ToolError`: it would be too large. `OSError`."""
    big, small = ImageFont.load_default(_SIZE), ImageFont.load_default(_SMALL)
    order = _places(frames, names, big, small)
    roots = [one for one in order if one.level == 0]
    width = max(300, round(2 * _MARGIN + sum(one.total for one in roots) + _GAP * max(0, len(roots) - 1)))
    height = 2 * _MARGIN + _BOX + _ROW * max((one.level for one in order), default=0)
    if width * height > _MOST_PIXELS:
        raise ToolError(
            f"{len(order)} frames need a picture of {width} x {height} pixels; --format mermaid has no limit"
        )
    picture = Image.new("RGB", (width, height), "white")
    draw = ImageDraw.Draw(picture)
    for one in order:
        for other in one.below:
            start, end = (one.x, one.y + _BOX / 2), (other.x, other.y - _BOX / 2)
            draw.line([start, (start[0], end[1] - 24), (end[0], end[1] - 24), end], _LINE, 2)
    for one in order:
        fill, edge = _ROOT if one.frame is None else _STATIC if one.frame.is_static else _MOVING
        half = _text_width(one.name, big) / 2 + _PAD
        draw.rounded_rectangle((one.x - half, one.y - _BOX / 2, one.x + half, one.y + _BOX / 2), 6, fill, edge, 2)
        draw.text((one.x, one.y), _shown(one.name), _INK, big, anchor="mm")
        if one.frame is not None:
            told = _shown(facts(one.frame, names))
            left = one.x - _text_width(told, small) / 2 - 3
            draw.rectangle((left, one.y - _BOX / 2 - 21, 2 * one.x - left, one.y - _BOX / 2 - 5), "white")
            draw.text((one.x, one.y - _BOX / 2 - 13), told, _DIM, small, anchor="mm")
    if not order:
        draw.text((width / 2, height / 2), "no transforms", _INK, big, anchor="mm")
    picture.save(path, "PNG")


def _places(frames: FrameStatistics, names: dict[Any, str], big: Any, small: Any) -> list[_Place]:
    """All frames that a root leads to, parents first."""
    children = frames.children()
    order: list[_Place] = []
    todo: list[tuple[str, FrameArrivals | None, _Place | None]] = [
        (root, None, None) for root in reversed(frames.roots())
    ]
    while todo:
        name, frame, parent = todo.pop()
        told = "" if frame is None else facts(frame, names)
        width = max(_text_width(name, big) + 2 * _PAD, _text_width(told, small) + 8)
        one = _Place(name, frame, 0 if parent is None else parent.level + 1, width)
        order.append(one)
        if parent is not None:
            parent.below.append(one)
        todo += [(below.name, below, one) for below in reversed(children.get(name, []))]
    for one in reversed(order):
        one.total = max(one.width, sum(below.total for below in one.below) + _GAP * max(0, len(one.below) - 1))
    left = float(_MARGIN)
    for one in order:
        if one.level == 0:
            one.x = left + one.total / 2
            left += one.total + _GAP
        start = one.x - (sum(below.total for below in one.below) + _GAP * max(0, len(one.below) - 1)) / 2
        for below in one.below:
            below.x = start + below.total / 2
            start += below.total + _GAP
    return order


def _text_width(text: str, font: Any) -> float:
    return float(font.getlength(_shown(text)))


def _shown(text: str) -> str:
    return printable(text if len(text) <= _MOST_CHARS else f"{text[: _MOST_CHARS - 3]}...")
