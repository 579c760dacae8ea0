"""Display of bags: texts for sizes, times and damaged parts, and progress on a terminal."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.ros_cli import terminal_output

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from rich.console import Console

    from rosidl_py_gen.bags import DamagedPart


def damaged_rows(parts: Iterable[DamagedPart]) -> list[dict[str, Any]]:
    """Return skipped parts of recordings for JSON output."""
    return [{**asdict(part), "file": str(part.file)} for part in parts]


def duration_text(nanoseconds: int) -> str:
    """Return seconds with milliseconds."""
    return f"{nanoseconds / NS_PER_S:.3f} s"


def time_text(nanoseconds: int) -> str:
    """Return local date and time and seconds since 1970; only the latter for dates outside of the calendar."""
    seconds, rest = sec_nanosec(nanoseconds)
    try:
        date = datetime.fromtimestamp(seconds).astimezone().strftime("%Y-%m-%d %H:%M:%S")
    except (OverflowError, ValueError, OSError):
        return f"{seconds}.{rest:09d}"
    return f"{date}.{rest // 1_000_000:03d} ({seconds}.{rest:09d})"


def size_text(count: float) -> str:
    """Return bytes in binary units, as rosbag2 displays them."""
    for unit in ("B", "KiB", "MiB", "GiB"):
        if count < 1024:
            return f"{count:.0f} B" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1024
    return f"{count:.1f} TiB"


@contextmanager
def progress_bar(total: int, what: str = "messages") -> Iterator[Callable[[float], None]]:
    """Display a progress bar on a terminal; yields a function that sets how many of `total` are done."""
    if not terminal_output.is_terminal() or not total:
        yield lambda done: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = BarColumn(), MofNCompleteColumn(), what, TimeRemainingColumn()
    with Progress(*columns, console=_console(), transient=True) as bar:
        task = bar.add_task("", total=total)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Display a status line on a terminal; yields a function that sets its text."""
    if not terminal_output.is_terminal():
        yield lambda text: None
        return
    from rich.live import Live
    from rich.text import Text

    with Live(Text(), console=_console(), auto_refresh=False, transient=True) as live:
        yield lambda text: live.update(Text(text, overflow="ellipsis", no_wrap=True), refresh=True)


def _console() -> Console:
    """Return a console for standard error with a visible cursor, which a signal could not restore."""
    from rich import console

    class Steady(console.Console):
        def show_cursor(self, show: bool = True) -> bool:
            return False

    return Steady(stderr=True)
