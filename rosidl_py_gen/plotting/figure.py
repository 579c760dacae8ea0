"""Plots with matplotlib: files and windows, with a panel for each topic above a common time axis."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import matplotlib
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from rosidl_py_gen.command_support import CommandError
from rosidl_py_gen.plotting.lines import DrawnLine, TimeAxis

if TYPE_CHECKING:
    from rosidl_py_gen.plotting.lines import PlotPanel

_WIDTH_IN, _PANEL_HEIGHT_IN, _MARGIN_IN, _MAX_HEIGHT_IN = 9.0, 2.4, 0.7, 60.0
_DPI = 120
_MAX_LEGEND_ROWS = 10
_STYLE: Any = {
    "svg.fonttype": "none",  # texts of SVG stay texts, which can be searched
    "svg.hashsalt": "rosidl-py",
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.parse_math": False,
}


def require_format(path: str) -> None:
    """Raise `CommandError` if matplotlib cannot write files with the suffix of a path."""
    known = Figure().canvas.get_supported_filetypes()
    if PurePath(path).suffix[1:].lower() not in known:
        endings = ", ".join(f".{name}" for name in sorted(known, key=lambda name: (name not in ("png", "svg"), name)))
        raise CommandError(f"{path}: the ending selects the format; expected one of {endings}")


def write_figure(panels: Sequence[PlotPanel], axis: TimeAxis, path: str) -> None:
    """Write a plot of the panels to a file, whose suffix selects the format. Raises OSError."""
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=_size(len(panels)), dpi=_DPI, layout="constrained")
        draw(figure, panels, axis)
        figure.savefig(path)


def draw(figure: Any, panels: Sequence[PlotPanel], axis: TimeAxis) -> None:
    """Replace the contents of a matplotlib figure by plots of the panels."""
    figure.clear()
    plots = figure.subplots(len(panels), sharex=True, squeeze=False)[:, 0]
    for panel, plot in zip(panels, plots, strict=True):
        lines = axis.drawn(panel)
        for line in lines:
            _draw_line(plot, line, axis, panel.title)
        plot.set_title(panel.title, loc="left")
        if len(lines) == 1:
            plot.set_ylabel(lines[0].label)
        elif lines:
            columns = -(-len(lines) // _MAX_LEGEND_ROWS)
            plot.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), ncols=columns, fontsize="small", frameon=False)
    if axis.is_wall_clock:
        locator: Any = AutoDateLocator()  # type: ignore[no-untyped-call]
        plots[-1].xaxis.set_major_locator(locator)
        plots[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    if axis.last_s is not None:
        plots[-1].set_xlim(left=axis.left(panels))
    plots[-1].set_xlabel(axis.label)


def _draw_line(plot: Any, line: DrawnLine, axis: TimeAxis, title: str) -> None:
    times = line.times if not axis.is_wall_clock else axis.dates(line.times)
    style = "steps-post" if line.is_steps else "default"
    finite = len(line.values) - int((line.values != line.values).sum())
    marker = "." if finite < 2 else None
    (drawn,) = plot.plot(times, line.values, label=line.label, linewidth=1, drawstyle=style, marker=marker)
    drawn.set_gid(f"{title}.{line.label}")


def _size(count: int) -> tuple[float, float]:
    return _WIDTH_IN, min(_MARGIN_IN + _PANEL_HEIGHT_IN * count, _MAX_HEIGHT_IN)


@contextmanager
def open_window(count: int) -> Iterator[PlotWindow | None]:
    """Open a window for a plot of `count` panels; yields None if no toolkit for windows is installed."""
    with matplotlib.rc_context(_STYLE):
        try:
            from matplotlib import pyplot

            figure = pyplot.figure(figsize=_size(count), layout="constrained")
        except (ImportError, RuntimeError):
            yield None
            return
        if figure.canvas.manager is None or pyplot.get_backend().lower() == "agg":
            pyplot.close(figure)
            yield None
            return
        try:
            yield PlotWindow(pyplot, figure)
        finally:
            pyplot.close(figure)


class PlotWindow:
    """Window of matplotlib with a plot: shown until it is closed (`show`), or redrawn while data arrive (`update`)."""

    def __init__(self, pyplot: Any, figure: Any) -> None:
        self._pyplot, self.figure = pyplot, figure

    @property
    def is_open(self) -> bool:
        return bool(self._pyplot.fignum_exists(self.figure.number))

    def show(self, panels: Sequence[PlotPanel], axis: TimeAxis) -> None:
        """Draw the panels, and show the window until the user closes it."""
        draw(self.figure, panels, axis)
        self._pyplot.show()

    def update(self, panels: Sequence[PlotPanel] | None, axis: TimeAxis) -> None:
        """Draw the panels unless `panels` is None, and handle pending events of the window without waiting."""
        if panels is not None:
            draw(self.figure, panels, axis)
            self._pyplot.show(block=False)
            self.figure.canvas.draw_idle()
        self.figure.canvas.flush_events()
