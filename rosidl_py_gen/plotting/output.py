"""Output of a plot: a file, a window, or the terminal."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.resources import install_command, require_modules
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import terminal_output

if TYPE_CHECKING:
    from rosidl_py_gen.plotting.figure import PlotWindow
    from rosidl_py_gen.plotting.lines import PlotPanel, TimeAxis

_MAX_ROWS = 40


def require_output(out: str | None, in_terminal: bool) -> None:
    """Raise an error if the plot cannot be output: the extra ``plot`` is missing, or the suffix of `out` is unknown."""
    if out is not None:
        require_modules("matplotlib")
        from rosidl_py_gen.plotting.figure import require_format

        require_format(out)
    elif in_terminal or not _has_display() or importlib.util.find_spec("matplotlib") is None:
        require_modules("plotext")


def show_plot(panels: Sequence[PlotPanel], axis: TimeAxis, out: str | None, in_terminal: bool) -> None:
    """Output a plot: write the file `out`, show a window until the user closes it, or print the plot."""
    axis.begin(panels)
    if out is not None:
        from rosidl_py_gen.plotting.figure import write_figure

        write_figure(panels, axis, out)
        terminal_output.line(f"{count_text(panels)} in {out}")
        return
    with plot_window(len(panels), in_terminal) as window:
        if window is not None:
            window.show(panels, axis)
            return
    print_plot(panels, axis)


def count_text(panels: Sequence[PlotPanel]) -> str:
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
        terminal_output.note(f"a window needs matplotlib: {install_command('plot')}")
        yield None
        return
    from rosidl_py_gen.plotting.figure import open_window

    with open_window(count) as window:
        if window is None:
            terminal_output.note("matplotlib cannot open a window: no display, or no toolkit such as tkinter or PyQt6")
        yield window


def print_plot(panels: Sequence[PlotPanel], axis: TimeAxis) -> None:
    """Print a plot as text, with colours if standard output is a terminal."""
    plot = _text(panels, axis)
    if terminal_output.is_terminal():
        from rich.console import Console

        Console(highlight=False).print(rich_text(plot))
        return
    from rosidl_py_gen.plotting.text_plot import plain_text

    terminal_output.lines(plain_text(plot).splitlines())


@contextmanager
def live_plot() -> Iterator[Callable[[Sequence[PlotPanel], TimeAxis], None]]:
    """Yield a function that replaces the drawn plot; the function does nothing unless output is a terminal."""
    if not terminal_output.is_terminal():
        yield lambda panels, axis: None
        return
    from rich.console import Console
    from rich.live import Live

    with Live(console=Console(highlight=False), auto_refresh=False, transient=True) as live:
        yield lambda panels, axis: live.update(rich_text(_text(panels, axis)), refresh=True)


def _text(panels: Sequence[PlotPanel], axis: TimeAxis) -> str:
    require_modules("plotext")
    from rosidl_py_gen.plotting.text_plot import text_plot

    size = shutil.get_terminal_size()
    rows = min(size.lines - 2, _MAX_ROWS) if sys.stdout.isatty() else size.lines * len(panels)
    return text_plot(panels, axis, max(20, size.columns), rows)


def rich_text(plot: str) -> Any:
    """Convert a plot of `text_plot` to a text of rich, which adapts the colours to the terminal."""
    from rich.text import Text

    return Text.from_ansi(plot, no_wrap=True)
