"""Picture of frames as a PNG file: a row for each level of the tree, each frame above the middle of its children."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from PIL import Image, ImageDraw, ImageFont

from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.errors import printable

if TYPE_CHECKING:
    from pathlib import Path

    from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameArrivals, FrameStatistics

_FONT_SIZE = 16
_SMALL_FONT_SIZE = 12
_PAD = 12
_GAP = 28
_BOX_HEIGHT = 34
_ROW_HEIGHT = 92
_MARGIN = 24
_MAX_CHARS = 60
_MAX_PIXELS = 40_000_000
_INK, _DIM, _LINE = "#1b2733", "#5b6b7a", "#8a99a8"
_MOVING, _STATIC, _ROOT = ("#e8f0fe", "#4a7dbd"), ("#eef7ee", "#5c9a63"), ("#fff4e2", "#c98a2b")


class _FrameBox:
    """Box of a frame in the picture; `x` is the middle of the box, `total` the width of the subtree of the frame."""

    def __init__(self, name: str, frame: FrameArrivals | None, level: int, width: float) -> None:
        self.name, self.frame, self.level, self.width = name, frame, level, width
        self.children: list[_FrameBox] = []
        self.total = width
        self.x = 0.0

    @property
    def y(self) -> float:
        return _MARGIN + self.level * _ROW_HEIGHT + _BOX_HEIGHT / 2


def write_picture(frames: FrameStatistics, names: dict[Any, str], path: Path) -> None:
    """Write a PNG file with the tree of frames. Raises `CommandError` if the picture would be too large."""
    big, small = ImageFont.load_default(_FONT_SIZE), ImageFont.load_default(_SMALL_FONT_SIZE)
    order = _boxes(frames, names, big, small)
    roots = [one for one in order if one.level == 0]
    width = max(300, round(2 * _MARGIN + _row_width(roots)))
    height = 2 * _MARGIN + _BOX_HEIGHT + _ROW_HEIGHT * max((one.level for one in order), default=0)
    if width * height > _MAX_PIXELS:
        raise CommandError(
            f"{len(order)} frames need a picture of {width} x {height} pixels; --format mermaid has no limit"
        )
    picture = Image.new("RGB", (width, height), "white")
    draw = ImageDraw.Draw(picture)
    for one in order:
        for other in one.children:
            start, end = (one.x, one.y + _BOX_HEIGHT / 2), (other.x, other.y - _BOX_HEIGHT / 2)
            draw.line([start, (start[0], end[1] - 24), (end[0], end[1] - 24), end], _LINE, 2)
    for one in order:
        fill, edge = _ROOT if one.frame is None else _STATIC if one.frame.is_static else _MOVING
        half = _text_width(one.name, big) / 2 + _PAD
        top = one.y - _BOX_HEIGHT / 2
        draw.rounded_rectangle((one.x - half, top, one.x + half, top + _BOX_HEIGHT), 6, fill, edge, 2)
        draw.text((one.x, one.y), _label(one.name), _INK, big, anchor="mm")
        if one.frame is not None:
            text = _label(one.frame.summary(names))
            left = one.x - _text_width(text, small) / 2 - 3
            draw.rectangle((left, top - 21, 2 * one.x - left, top - 5), "white")
            draw.text((one.x, top - 13), text, _DIM, small, anchor="mm")
    if not order:
        draw.text((width / 2, height / 2), "no transforms", _INK, big, anchor="mm")
    picture.save(path, "PNG")


def _boxes(frames: FrameStatistics, names: dict[Any, str], big: Any, small: Any) -> list[_FrameBox]:
    """Return the boxes of all frames of some trees, with their positions.

    A parent's box precedes the boxes of its children.
    """
    boxes: dict[str, _FrameBox] = {}
    for name, frame, _ in frames.walk():
        parent = None if frame is None else boxes[frame.parent]
        text = "" if frame is None else frame.summary(names)
        width = max(_text_width(name, big) + 2 * _PAD, _text_width(text, small) + 8)
        boxes[name] = one = _FrameBox(name, frame, 0 if parent is None else parent.level + 1, width)
        if parent is not None:
            parent.children.append(one)
    order = [*boxes.values()]
    for one in reversed(order):
        one.total = max(one.width, _row_width(one.children))
    left = float(_MARGIN)
    for one in order:
        if one.level == 0:
            one.x = left + one.total / 2
            left += one.total + _GAP
        start = one.x - _row_width(one.children) / 2
        for below in one.children:
            below.x = start + below.total / 2
            start += below.total + _GAP
    return order


def _row_width(boxes: list[_FrameBox]) -> float:
    return sum(box.total for box in boxes) + _GAP * max(0, len(boxes) - 1)


def _text_width(text: str, font: Any) -> float:
    return float(font.getlength(_label(text)))


def _label(text: str) -> str:
    return printable(text if len(text) <= _MAX_CHARS else f"{text[: _MAX_CHARS - 3]}...")
