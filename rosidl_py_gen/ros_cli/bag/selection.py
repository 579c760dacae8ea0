"""Selection of topics and times of a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.bag.display import duration_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.bags import BagReader


class BagSelection(NamedTuple):
    """Topics and times of a bag: ``start_ns <= log_time < end_ns``."""

    topics: list[str]
    start_ns: int
    end_ns: int

    def part_of(self, reader: BagReader) -> float:
        """Return the part of the bag's duration that is selected, from 0 to 1."""
        return min(1.0, (self.end_ns - self.start_ns) / (reader.end_ns - reader.start_ns + 1))


def select_part(reader: BagReader, topics: Sequence[str], offset_s: float, duration_s: float | None) -> BagSelection:
    """Return the selection of options; raises `CommandError` if a topic does not exist, or the bag is too short."""
    for name in topics:
        if name not in reader.topics:
            raise CommandError(f"{reader.path} has no topic {name}{did_you_mean(name, reader.topics)}")
    start = start_of(str(reader.path), reader.start_ns, reader.end_ns, offset_s)
    end = reader.end_ns + 1 if duration_s is None else min(start + round(duration_s * NS_PER_S), reader.end_ns + 1)
    return BagSelection([*(topics or reader.topics)], start, end)


def start_of(name: str, start_ns: int, end_ns: int, offset_s: float) -> int:
    """Return the time at an offset in a bag; raises `CommandError` after its end."""
    if (start := start_ns + round(offset_s * NS_PER_S)) > end_ns:
        raise CommandError(f"{name} is {duration_text(end_ns - start_ns)} long; expected a start offset within it")
    return start
