"""Plots as text, of braille characters: a panel for each topic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np

from rosidl_py_gen.errors import printable
from rosidl_py_gen.ros_cli.plotting.lines import DrawnLine, Floats, PlotPanel, TimeAxis

COLORS = ("cyan", "yellow", "green", "magenta", "red", "blue")
"""Styles of rich for the lines, repeated if there are more."""
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], np.uint8)
"""Bits of the dots of a braille character, by row and column."""
_BRAILLE = 0x2800
_MAX_VALUE = 8e307
"""Twice this value is still a finite number."""
_MIN_WIDTH, _MIN_ROWS = 20, 4


class StyledText(NamedTuple):
    """Piece of a line of text with one style of rich; empty for none."""

    text: str
    style: str = ""


def text_plot(panels: Sequence[PlotPanel], axis: TimeAxis, width: int, height: int) -> list[list[StyledText]]:
    """Return rows of text with at most `width` columns, and about `height` rows."""
    lines = [axis.drawn(panel) for panel in panels]
    filled = [one for some in lines for one in some]
    first = min((float(one.times[0]) for one in filled), default=0.0)
    last = max((float(one.times[-1]) for one in filled), default=1.0)
    if (left := axis.left(panels)) is not None:
        first = left
    last = last if last > first else first + 1.0
    legends = [_legend(some, width) for some in lines]
    spare = height - 2 - sum(2 + len(legend) for legend in legends)
    rows = max(_MIN_ROWS, spare // max(1, len(panels)))
    scales = [_scale(some, first) for some in lines]
    margin = max((len(text) for low, high in scales for text in _ticks(low, high, rows).values()), default=0)
    columns = max(_MIN_WIDTH, width - margin - 2)
    text: list[list[StyledText]] = []
    for panel, some, legend, (low, high) in zip(panels, lines, legends, scales, strict=True):
        text.append([StyledText(printable(panel.title)[:width], "bold")])
        ticks = _ticks(low, high, rows)
        grid, owner = _canvas(some, (first, last), (low, high), columns, rows)
        for row in range(rows):
            text.append([StyledText(f"{ticks.get(row, ''):>{margin}} ┤" if row in ticks else " " * margin + " │")])
            text[-1] += _runs(grid[row], owner[row])
        text += legend
    text.append([StyledText(" " * margin + " └" + "─" * columns)])
    text.append([StyledText(" " * (margin + 2) + _time_ticks(first, last, columns, axis))])
    return text


def _scale(lines: Sequence[DrawnLine], first: float) -> tuple[float, float]:
    shown = [one.values[one.times >= first] for one in lines]
    values = np.concatenate(shown) if shown else np.empty(0)
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0
    low, high = np.clip((values.min(), values.max()), -_MAX_VALUE, _MAX_VALUE).tolist()
    if low == high:
        margin = abs(low) * 0.1 or 1.0
        return low - margin, high + margin
    return low, high


def _ticks(low: float, high: float, rows: int) -> dict[int, str]:
    """Return the numbers next to some rows; the first row is the highest value."""
    count = max(2, min(5, rows // 3 + 1))
    places = sorted({round(number * (rows - 1) / (count - 1)) for number in range(count)})
    return {row: _number(high - (high - low) * row / (rows - 1), high - low) for row in places}


def _number(value: float, span: float) -> str:
    """Return a number with the digits that matter in a range of `span`."""
    digits = 2 - math.floor(math.log10(span)) if 0 < span < math.inf else 2
    if not 0 <= digits + 3 <= 9 or abs(value) >= 1e9:
        return f"{value:.5g}"
    text = f"{value:.{max(0, digits)}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def _canvas(
    lines: Sequence[DrawnLine], times: tuple[float, float], values: tuple[float, float], columns: int, rows: int
) -> tuple[np.ndarray[Any, np.dtype[np.uint8]], np.ndarray[Any, np.dtype[np.int16]]]:
    """Return the braille bits of each cell, and the number of the line that it belongs to, -1 for none."""
    grid = np.zeros((rows, columns), np.uint8)
    owner = np.full((rows, columns), -1, np.int16)
    for number, line in enumerate(lines):
        x = (line.times - times[0]) / (times[1] - times[0]) * (2 * columns - 1)
        y = (values[1] - np.clip(line.values, *values)) / (values[1] - values[0]) * (4 * rows - 1)
        if line.is_steps:
            x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
        across, down = _dots(x[x >= 0], y[x >= 0])
        np.bitwise_or.at(grid, (down // 4, across // 2), _DOTS[down % 4, across % 2])
        owner[down // 4, across // 2] = number
    return grid, owner


def _dots(x: Floats, y: Floats) -> tuple[np.ndarray[Any, np.dtype[np.intp]], np.ndarray[Any, np.dtype[np.intp]]]:
    """Return the dots of the points and of the straight lines between them; NaN interrupts a line."""
    known = np.isfinite(y)
    pair = known[:-1] & known[1:]
    starts, ends = np.flatnonzero(pair), np.flatnonzero(pair) + 1
    steps = np.maximum(np.abs(x[ends] - x[starts]), np.abs(y[ends] - y[starts])).astype(np.intp) + 1
    which = np.repeat(np.arange(len(starts)), steps)
    part = (np.arange(len(which)) - np.repeat(np.cumsum(steps) - steps, steps)) / np.repeat(steps, steps)
    start, end = starts[which], ends[which]
    across = np.concatenate((x[known], x[start] + (x[end] - x[start]) * part))
    down = np.concatenate((y[known], y[start] + (y[end] - y[start]) * part))
    return np.rint(across).astype(np.intp), np.rint(down).astype(np.intp)


def _runs(bits: np.ndarray[Any, np.dtype[np.uint8]], owner: np.ndarray[Any, np.dtype[np.int16]]) -> list[StyledText]:
    runs: list[StyledText] = []
    edges = np.flatnonzero(np.diff(owner)) + 1
    for cells, number in zip(np.split(bits, edges), owner[np.append(0, edges)].tolist(), strict=True):
        text = "".join(chr(_BRAILLE + bit) if bit else " " for bit in cells.tolist())
        runs.append(StyledText(text, COLORS[number % len(COLORS)] if number >= 0 else ""))
    return runs


def _time_ticks(first: float, last: float, columns: int, axis: TimeAxis) -> str:
    """Return the texts below the time axis: its ends and middle, and its name."""
    if axis.is_wall_clock:
        texts = [_clock_text(first), axis.label, _clock_text(last)]
    else:
        span = last - first
        texts = [_number(first, span), f"{_number((first + last) / 2, span)} {axis.label}", _number(last, span)]
    free = columns - sum(map(len, texts))
    if free < 2:
        return f"{texts[0]} {texts[2]} {axis.label}"[:columns]
    left = max(1, (columns - len(texts[1])) // 2 - len(texts[0]))
    left = min(left, free - 1)
    return texts[0] + " " * left + texts[1] + " " * (free - left) + texts[2]


def _clock_text(seconds: float) -> str:
    try:
        return datetime.fromtimestamp(seconds).strftime("%Y-%m-%d %H:%M:%S")
    except (OverflowError, ValueError, OSError):
        return f"{seconds:.3f}"


def _legend(lines: Sequence[DrawnLine], width: int) -> list[list[StyledText]]:
    rows: list[list[StyledText]] = [[]]
    used = 0
    for number, line in enumerate(lines):
        name = printable(line.label)[: max(1, width - 4)]
        if used and used + len(name) + 4 > width:
            rows.append([])
            used = 0
        rows[-1] += [StyledText("  ━ ", COLORS[number % len(COLORS)]), StyledText(name)]
        used += len(name) + 4
    return rows
