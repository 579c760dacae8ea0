"""Display of bags: texts for sizes, times and damaged parts, and progress on a terminal."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime
from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.ros_cli.command_support import CommandError
from rosidl_py_gen.ros_cli.terminal_output import StatusLine

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.bags import BagMessage, BagReader, DamagedPart

T = TypeVar("T")

PROGRESS_DELAY_S = 0.5
"""Time in seconds after which a progress bar appears; in shorter commands it would only flicker."""
PROGRESS_INTERVAL_S = 0.5
"""Minimum time between two updates of a progress bar, in seconds."""
_BAR_COLUMNS = 20
_ITEMS_PER_UPDATE = 64
"""Number of items between two checks of a progress bar; a check takes 2 % of the time of a small message."""


def damaged_rows(parts: Iterable[DamagedPart]) -> list[dict[str, Any]]:
    """Return the damaged parts of recordings that were skipped as rows for JSON output."""
    return [{**asdict(part), "file": str(part.file)} for part in parts]


def duration_text(nanoseconds: int) -> str:
    """Return a duration as text in seconds with milliseconds, such as ``1.250 s``."""
    return f"{nanoseconds / NS_PER_S:.3f} s"


def time_text(nanoseconds: int) -> str:
    """Return a time as text: local date and time and seconds since 1970; outside of the calendar only seconds."""
    seconds, rest = sec_nanosec(nanoseconds)
    try:
        date = datetime.fromtimestamp(seconds).astimezone().strftime("%Y-%m-%d %H:%M:%S")
    except (OverflowError, ValueError, OSError):
        return f"{seconds}.{rest:09d}"
    return f"{date}.{rest // 1_000_000:03d} ({seconds}.{rest:09d})"


def size_text(count: float) -> str:
    """Return a number of bytes as text in binary units, such as ``1.5 MiB``, as rosbag2 displays sizes."""
    for unit in ("B", "KiB", "MiB", "GiB"):
        if count < 1024:
            return f"{count:.0f} B" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1024
    return f"{count:.1f} TiB"


class ProgressBar:
    """Progress bar of a command with rate and remaining time, on standard error if that is a terminal.

    Call the bar with the number of completed units and of all units (None or 0: unknown). The bar appears after 0.5 s.
    """

    def __init__(self, unit: Literal["messages", "bytes"]) -> None:
        self._unit = unit
        self._line = StatusLine()
        self._start_s = monotonic()
        self._next_s = self._start_s + PROGRESS_DELAY_S if self._line.is_possible else inf

    def __call__(self, done: float, total: float | None = None) -> None:
        """Display that `done` of `total` units are completed, at most twice per second."""
        now_s = monotonic()
        if now_s < self._next_s:
            return
        self._next_s = now_s + PROGRESS_INTERVAL_S
        bar = f"{progress_bar(done / total)}  " if total else ""
        self._line.show(f"{bar}{progress_text(done, total or None, now_s - self._start_s, self._unit)}")

    def each(self, items: Iterable[T], total: float | None = None) -> Iterator[T]:
        """Yield each of `items`, and display on the progress bar how many of `total` items were yielded."""
        for number, item in enumerate(items):
            if not number % _ITEMS_PER_UPDATE:
                self(number, total)
            yield item

    def __enter__(self) -> ProgressBar:
        self._line.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._line.__exit__()


def progress_bar(fraction: float) -> str:
    """Return a bar of 20 characters, as text, of which a `fraction` from 0 to 1 is filled."""
    count = round(_BAR_COLUMNS * min(1.0, fraction))
    return "━" * count + "─" * (_BAR_COLUMNS - count)


def progress_text(done: float, total: float | None, elapsed_s: float, unit: str) -> str:
    """Return a text with the completed units and the rate and, if `total` is known, the remaining time."""
    rate = done / elapsed_s if elapsed_s > 0 else 0.0
    in_bytes = unit == "bytes"
    count, speed = (size_text(done), f"{size_text(rate)}/s") if in_bytes else (f"{done:.0f}", f"{rate:.0f} {unit}/s")
    if total is None:
        return f"{count}{'' if in_bytes else f' {unit}'}, {speed}"
    left_s = round(max(0.0, total - done) / rate) if rate else 0
    left = f"{left_s // 3600}:{left_s // 60 % 60:02}:{left_s % 60:02}" if rate else "?"
    whole = size_text(total) if in_bytes else f"{total:.0f} {unit}"
    return f"{min(100, 100 * done / total):3.0f} % of {whole}, {speed}, {left} left"


@contextmanager
def opened_bag(path: str, *, search_path: Sequence[str] = (), skip_damaged: bool = True) -> Iterator[BagReader]:
    """Open a bag and yield its reader, with a progress bar while files are decompressed or read completely."""
    from rosidl_py_gen.bags import BagReader

    with ProgressBar("bytes") as show:
        reader = BagReader(path, search_path=search_path, skip_damaged=skip_damaged, on_progress=show)
    with reader:
        yield reader


def messages_of_type(path: str, type_name: str) -> Iterator[BagMessage]:
    """Yield the messages of a type in a bag; raises `CommandError` if it has no topic of the type."""
    from rosidl_py_gen.bags import BagReader

    with BagReader(path) as reader:
        topics = [name for name, topic in reader.topics.items() if topic.type_name == type_name]
        if not topics:
            raise CommandError(f"{path} has no topic of {type_name}")
        yield from reader.messages(topics)
