"""Bags that a command has opened: texts for sizes, times and damaged parts, progress, selected topics and times.

Channels of a bag that is written get definitions here, too. A channel is never written with another type's definition,
nor silently without one.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import datetime
from itertools import islice
from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

from rosidl_py_gen.bags import described, mismatch_reason
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from rosidl_py_gen.bags import BagMessage, BagReader, BagTopic, DamagedPart, SourceBag, TopicDefinition

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
        self._line = terminal_output.StatusLine()
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


@contextmanager
def opened_source(path: str, search_path: Sequence[str]) -> Iterator[SourceBag]:
    """Open a bag that is copied and yield its reader, with a progress bar while files are read; skip damaged parts."""
    from rosidl_py_gen.bags import SourceBag

    with ProgressBar("bytes") as show:
        reader = SourceBag(path, search_path=search_path, on_progress=show)
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


_SAMPLES = 20
"""Maximum number of messages per channel that are checked against a definition that was found only by the type's name.
"""


class BagSelection(NamedTuple):
    """Selection of topics and of a time range of a bag: messages with ``start_ns <= log_time < end_ns``."""

    topics: list[str]
    start_ns: int
    end_ns: int

    def is_all(self, reader: BagReader) -> bool:
        """Return True if all messages of the bag are selected."""
        has_all_topics = len(set(self.topics)) == len(reader.topics)
        return has_all_topics and self.start_ns <= reader.start_ns and self.end_ns > reader.end_ns

    def part_of(self, reader: BagReader) -> float:
        """Return the fraction of the bag's duration that is selected, from 0 to 1."""
        return min(1.0, (self.end_ns - self.start_ns) / (reader.end_ns - reader.start_ns + 1))


def select_part(reader: BagReader, topics: Sequence[str], offset_s: float, duration_s: float | None) -> BagSelection:
    """Return the selection that command options describe.

    Raises `CommandError` if the bag lacks a topic, or ends before the offset.
    """
    for name in topics:
        if name not in reader.topics:
            raise CommandError(f"{reader.path} has no topic {name}{did_you_mean(name, reader.topics)}")
    start = start_of(str(reader.path), reader.start_ns, reader.end_ns, offset_s)
    end = reader.end_ns + 1 if duration_s is None else min(start + round(duration_s * NS_PER_S), reader.end_ns + 1)
    return BagSelection([*(topics or reader.topics)], start, end)


def start_of(name: str, start_ns: int, end_ns: int, offset_s: float) -> int:
    """Return the time in ns at an offset from the start of a bag; raises `CommandError` if the bag ends before."""
    if (start := start_ns + round(offset_s * NS_PER_S)) > end_ns:
        raise CommandError(f"{name} is {duration_text(end_ns - start_ns)} long; expected a start offset within it")
    return start


def channels_with_definitions(
    reader: BagReader, topics: Sequence[str], keeps_unknown: bool, hint: str = "select topics with --topics"
) -> dict[tuple[str, ...], BagTopic]:
    """Return the channels to write, by key of the recorded channel, each with its recorded or a local definition.

    Raises `CommandError` if a channel with messages has no matching definition, and `keeps_unknown` is False; its text
    contains `hint`, which says how to leave topics out.
    """
    channels: dict[tuple[str, ...], BagTopic] = {}
    unknown: list[tuple[BagTopic, str]] = []
    guessed: set[str] = set()
    for channel in reader.channels:
        if channel.name not in topics:
            continue
        channels[channel.key] = channel
        if channel.definition or channel.message_encoding != "cdr":
            continue
        try:
            known = reader.definition(channel)
        except RosidlError as error:
            unknown.append((channel, str(error)))
            continue
        if reason := guess_mismatch(reader, channel, known):
            unknown.append((channel, reason))
            continue
        channels[channel.key] = described(channel, known)
        if channels[channel.key].definition:
            guessed.add(f"{channel.type_name} from {known.origin}")
    _require_known(reader, unknown, keeps_unknown, hint)
    if guessed:
        terminal_output.note(f"definitions that the bag does not contain are written: {', '.join(sorted(guessed))}")
    return channels


def guess_mismatch(reader: BagReader, channel: BagTopic, known: TopicDefinition) -> str:
    """Return why a definition found only by the type's name does not fit the first messages of a channel.

    Returns "" if it may fit. Raises `BagError` if the first messages are damaged.
    """
    if known.is_recorded:
        return ""
    messages = (one.data for one in reader.raw_messages(channel.name) if one.channel.key == channel.key)
    return mismatch_reason(channel, known, islice(messages, _SAMPLES))


def _require_known(reader: BagReader, unknown: Sequence[tuple[BagTopic, str]], keeps_unknown: bool, hint: str) -> None:
    missing = [f"{channel.type_name}: {reason}" for channel, reason in unknown if channel.count != 0]
    if missing and not keeps_unknown:
        raise CommandError(
            f"{reader.path}: no definitions of {'; '.join(missing)}. Pass them with --path DIR, {hint}, "
            "or write them without definitions with --without-definitions"
        )
    for channel, reason in unknown:
        terminal_output.note(f"{channel.name} [{channel.type_name}] is written without a definition: {reason}")
