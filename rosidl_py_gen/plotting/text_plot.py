"""Plots in the terminal, drawn by plotext: a panel for each topic."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime
from typing import Any

import numpy as np
import plotext

from rosidl_py_gen.errors import printable
from rosidl_py_gen.plotting.lines import DrawnLine, PlotPanel, TimeAxis

_COLORS = ("cyan", "orange", "green", "magenta", "red", "blue")
"""Colours of the lines in a terminal plot, used repeatedly if there are more lines; plotext calls the yellow of
terminals orange."""
_MAX_VALUE = 8e307
"""Maximum absolute value that is drawn; twice the value is still a finite number."""
_MIN_WIDTH, _MIN_ROWS = 20, 4
_FRAME_ROWS = 3
"""Number of text rows of a plot in addition to its canvas, for the frame and the texts of the time axis."""


def text_plot(panels: Sequence[PlotPanel], axis: TimeAxis, width: int, height: int) -> str:
    """Return a plot of the panels as text, with escape sequences of colours; it has about `height` rows."""
    lines = [axis.drawn(panel) for panel in panels]
    filled = [one for some in lines for one in some]
    first = min((float(one.times[0]) for one in filled), default=0.0)
    last = max((float(one.times[-1]) for one in filled), default=1.0)
    if (left := axis.left(panels)) is not None:
        first = left
    last = last if last > first else first + 1.0
    legends = [_legend(some, width) for some in lines]
    rows = (height - sum(map(len, legends))) // max(1, len(panels)) - 1 - _FRAME_ROWS
    scales = [_scale(some, first) for some in lines]
    ticks = [_ticks(low, high, max(_MIN_ROWS, rows)) for low, high in scales]
    margin = max((len(text) for one in ticks for text in one), default=0)
    plots = []
    for panel, some, legend, scale, one in zip(panels, lines, legends, scales, ticks, strict=True):
        texts = [text.rjust(margin) for text in one]
        time_texts = _time_ticks(first, last, axis) if panel is panels[-1] else []
        plot = _draw(some, (first, last), scale, time_texts, texts, width, max(_MIN_ROWS, rows))
        title = plotext.colorize(printable(panel.title)[:width], style="bold")
        plots += [title, plot, *legend]
    return "\n".join(plots)


def plain_text(plot: str) -> str:
    """Return a plot without escape sequences and spaces at the ends of lines."""
    return "\n".join(line.rstrip() for line in plotext.uncolorize(plot).splitlines())


def _draw(
    lines: Sequence[DrawnLine],
    times: tuple[float, float],
    values: tuple[float, float],
    time_texts: Sequence[str],
    value_texts: Sequence[str],
    width: int,
    rows: int,
) -> str:
    figure: Any = plotext  # without types
    figure.clear_figure()
    figure.limit_size(False, False)
    figure.theme("clear")
    figure.plot_size(max(_MIN_WIDTH, width), rows + _FRAME_ROWS)
    # From 0 to 1: plotext multiplies by the number of dots, which overflows for the largest numbers.
    figure.xlim(0, 1)
    figure.ylim(0, 1)
    figure.xticks(np.linspace(0, 1, len(time_texts)).tolist(), time_texts)
    figure.yticks(np.linspace(0, 1, len(value_texts)).tolist(), value_texts)
    for number, line in enumerate(lines):
        x = (line.times - times[0]) / (times[1] - times[0])
        y = (np.clip(line.values, *values) - values[0]) / (values[1] - values[0])
        if line.is_steps:
            x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
        drawn = x >= 0
        color = _COLORS[number % len(_COLORS)]
        figure.plot(x[drawn].tolist(), y[drawn].tolist(), marker="braille", color=color)
    return str(figure.build()).rstrip("\n")


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


def _ticks(low: float, high: float, rows: int) -> list[str]:
    """Return texts for axis values from `low` to `high`; the texts that plotext makes have up to 300 digits."""
    count = max(2, min(5, rows // 3 + 1))
    return [_number(float(value), high - low) for value in np.linspace(low, high, count)]


def _number(value: float, span: float) -> str:
    """Return a number as text with the digits that matter in a range of `span`."""
    digits = 2 - math.floor(math.log10(span)) if 0 < span < math.inf else 2
    if not 0 <= digits + 3 <= 9 or abs(value) >= 1e9:
        return f"{value:.5g}"
    text = f"{value:.{max(0, digits)}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def _time_ticks(first: float, last: float, axis: TimeAxis) -> list[str]:
    """Return texts for both ends and the middle of the time axis.

    The text in the middle contains the name of the axis.
    """
    if axis.is_wall_clock:
        return [_clock_text(first), axis.label, _clock_text(last)]
    left, middle, right = (_number(time, last - first) for time in (first, (first + last) / 2, last))
    return [left, f"{middle} {axis.label}", right]


def _clock_text(seconds: float) -> str:
    try:
        return datetime.fromtimestamp(seconds).strftime("%Y-%m-%d %H:%M:%S")
    except (OverflowError, ValueError, OSError):
        return f"{seconds:.3f}"


def _legend(lines: Sequence[DrawnLine], width: int) -> list[str]:
    rows, used = [""], 0
    for number, line in enumerate(lines):
        name = printable(line.label)[: max(1, width - 4)]
        if used and used + len(name) + 4 > width:
            rows.append("")
            used = 0
        rows[-1] += plotext.colorize("  ━ ", _COLORS[number % len(_COLORS)]) + name
        used += len(name) + 4
    return rows
