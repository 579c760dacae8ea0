"""Output of a plot: a file, a window, or the terminal."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import terminal_output

if TYPE_CHECKING:
    from rosidl_py_gen.plotting.figure import PlotWindow
    from rosidl_py_gen.plotting.lines import PlotPanel, TimeAxis, TopicLines

_MAX_ROWS = 40
_WINDOW_INTERVAL_S = 0.05
"""Time between two checks for events of the plot window, in seconds; if longer, the window seems to hang."""
_DRAW_INTERVAL_S = 0.25
"""Minimum time between two drawings of a live plot, in seconds."""


class Plot:
    """Plot of fields of topics over time: written to a file, shown in a window, or printed in the terminal.

    Args:
        out: path of the file; None to show or print the plot.
        in_terminal: print the plot, even if windows can be opened.
        is_wall_clock: local date and time on the time axis, instead of seconds since the first message.
        by_stamp: times of ``header.stamp``, instead of the times that are passed with the messages.
        last_s: length of the drawn time before the last point, in seconds; None to draw all.

    Raises:
        RosidlError: the extra ``plot`` is missing, or matplotlib cannot write files with the suffix of `out`.
    """

    def __init__(
        self,
        out: str | None,
        in_terminal: bool,
        *,
        is_wall_clock: bool = False,
        by_stamp: bool = False,
        last_s: float | None = None,
    ) -> None:
        _require_output(out, in_terminal)
        from rosidl_py_gen.plotting.lines import TimeAxis

        self._out, self._in_terminal = out, in_terminal
        self._axis = TimeAxis(is_wall_clock=is_wall_clock, by_stamp=by_stamp, last_s=last_s)
        self.panels: list[PlotPanel] = []

    @property
    def count(self) -> int:
        """Number of messages that the lines of all panels were made of."""
        return sum(panel.count for panel in self.panels)

    def add_topic(self, topic: str, fields: Sequence[str], prefix: str = "") -> TopicLines:
        """Add an empty panel for fields of a topic, and return the lines, to which messages can be added.

        `prefix` is a text before the name of the topic in the title of the panel.
        """
        from rosidl_py_gen.plotting.lines import PlotPanel, TopicLines

        self.panels.append(PlotPanel(prefix + topic))
        return TopicLines(self.panels[-1], topic, fields, by_stamp=self._axis.by_stamp, last_s=self._axis.last_s)

    def show(self, *, own_starts: bool = False) -> None:
        """Output the plot: write the file, show a window until the user closes it, or print the plot.

        With `own_starts` the time of each panel starts at 0.
        """
        self._axis.own_starts = own_starts
        self._axis.begin(self.panels)
        if self._out is not None:
            self._write(self.panels, self._out)
            return
        with plot_window(len(self.panels), self._in_terminal) as window:
            if window is not None:
                window.show(self.panels, self._axis)
                return
        _print_plot(self.panels, self._axis)

    def _write(self, panels: Sequence[PlotPanel], out: str) -> None:
        from rosidl_py_gen.plotting.figure import write_figure

        write_figure(panels, self._axis, out)
        terminal_output.line(f"{_count_text(panels)} in {out}")

    @contextmanager
    def live(self) -> Iterator[LivePlot]:
        """Yield the plot as one that is redrawn while messages arrive, in a window or in the terminal.

        A plot that is written to a file is not drawn.
        """
        window: PlotWindow | None = None
        draw: Callable[[Sequence[PlotPanel], TimeAxis], None] = lambda panels, axis: None  # noqa: E731
        with ExitStack() as stack:
            if self._out is None:
                window = stack.enter_context(plot_window(len(self.panels), self._in_terminal))
                if window is None:
                    draw = stack.enter_context(_terminal_plot())
            yield LivePlot(self, window, draw)

    def end(self, live: LivePlot) -> None:
        """Write the plot to its file, or print it a last time if it has no window.

        Topics without messages are noted.
        """
        filled = [panel for panel in self.panels if panel.count]
        for panel in self.panels:
            if not panel.count:
                terminal_output.note(f"no messages arrived on {panel.title}")
        if not filled:
            return
        self._axis.begin(filled)
        if self._out is not None:
            self._write(filled, self._out)
        elif live.has_window:
            terminal_output.line(_count_text(filled))
        else:
            _print_plot(filled, self._axis)


class LivePlot:
    """Plot that is redrawn while messages arrive.

    Attributes:
        has_window: True if the plot is drawn in a window.
        interval_s: time between two calls of `update`, in seconds.
    """

    def __init__(
        self, plot: Plot, window: PlotWindow | None, draw: Callable[[Sequence[PlotPanel], TimeAxis], None]
    ) -> None:
        self._plot, self._window, self._draw = plot, window, draw
        self._drawn, self._next_s = 0, 0.0
        self.has_window = window is not None
        self.interval_s = _WINDOW_INTERVAL_S if self.has_window else _DRAW_INTERVAL_S

    @property
    def is_open(self) -> bool:
        """True until the user closes the window of the plot."""
        return self._window is None or self._window.is_open

    def update(self, now_s: float) -> None:
        """Redraw the plot if it has new messages and was drawn long enough ago, and handle events of its window."""
        plot, axis = self._plot, self._plot._axis
        is_due = (count := plot.count) > self._drawn and now_s >= self._next_s
        if is_due:
            axis.begin(plot.panels)
            self._drawn, self._next_s = count, now_s + _DRAW_INTERVAL_S
        if self._window is not None:
            self._window.update(plot.panels if is_due else None, axis)
        elif is_due:
            self._draw(plot.panels, axis)


def _require_output(out: str | None, in_terminal: bool) -> None:
    if out is not None:
        Extra.require_modules("matplotlib")
        from rosidl_py_gen.plotting.figure import require_format

        require_format(out)
    elif in_terminal or not _has_display() or importlib.util.find_spec("matplotlib") is None:
        Extra.require_modules("plotext")


def _count_text(panels: Sequence[PlotPanel]) -> str:
    """Return a text with the numbers of messages and topics in a plot, such as ``9 messages of /imu``."""
    count, topics = sum(panel.count for panel in panels), len(panels)
    messages = pluralize(count, "message")
    return f"{messages} of {topics} topics" if topics > 1 else f"{messages} of {panels[0].title}"


def _has_display() -> bool:
    """Return True if a window can be opened on this machine."""
    if sys.platform in ("darwin", "win32"):
        return "SSH_CONNECTION" not in os.environ
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@contextmanager
def plot_window(count: int, in_terminal: bool) -> Iterator[PlotWindow | None]:
    """Open a window for a plot of `count` panels; yields None if the plot must be drawn in the terminal instead."""
    if in_terminal or not _has_display():
        yield None
        return
    if importlib.util.find_spec("matplotlib") is None:
        terminal_output.note(f"a window needs matplotlib: {Extra('plot').install_command()}")
        yield None
        return
    from rosidl_py_gen.plotting.figure import open_window

    with open_window(count) as window:
        if window is None:
            terminal_output.note("matplotlib cannot open a window: no display, or no toolkit such as tkinter or PyQt6")
        yield window


def _print_plot(panels: Sequence[PlotPanel], axis: TimeAxis) -> None:
    """Print a plot as text, with colours if standard output is a terminal."""
    plot = _text(panels, axis)
    if terminal_output.is_terminal():
        from rich.console import Console

        Console(highlight=False).print(rich_text(plot))
        return
    from rosidl_py_gen.plotting.text_plot import plain_text

    terminal_output.lines(plain_text(plot).splitlines())


@contextmanager
def _terminal_plot() -> Iterator[Callable[[Sequence[PlotPanel], TimeAxis], None]]:
    """Yield a function that replaces the drawn plot; the function does nothing unless output is a terminal."""
    if not terminal_output.is_terminal():
        yield lambda panels, axis: None
        return
    from rich.console import Console
    from rich.live import Live

    with Live(console=Console(highlight=False), auto_refresh=False, transient=True) as live:
        yield lambda panels, axis: live.update(rich_text(_text(panels, axis)), refresh=True)


def _text(panels: Sequence[PlotPanel], axis: TimeAxis) -> str:
    Extra.require_modules("plotext")
    from rosidl_py_gen.plotting.text_plot import text_plot

    size = shutil.get_terminal_size()
    rows = min(size.lines - 2, _MAX_ROWS) if sys.stdout.isatty() else size.lines * len(panels)
    return text_plot(panels, axis, max(20, size.columns), rows)


def rich_text(plot: str) -> Any:
    """Convert a plot of `text_plot` to a text of rich, which adapts the colours to the terminal."""
    from rich.text import Text

    return Text.from_ansi(plot, no_wrap=True)
