"""``bag convert``: a bag, or a part of it, written again."""

from __future__ import annotations

from collections.abc import Sequence
from time import monotonic

from rosidl_py_gen.mcap import BagReader, BagWriter, SqliteWriter
from rosidl_py_gen.tools import ToolError, printing
from rosidl_py_gen.tools.bag.part import part_of, progress

_PROGRESS_S = 0.25


def run(
    path: str,
    output: str,
    storage: str,
    topics: Sequence[str],
    offset_s: float,
    duration_s: float | None,
    compression: str,
    split_bytes: int | None,
    split_s: float | None,
    as_json: bool,
) -> int:
    """Returns the exit code."""
    with BagReader(path) as reader:
        part = part_of(reader, topics, offset_s, duration_s)
        if storage == "mcap":
            inside = "" if compression == "none" else compression
            writer: BagWriter | SqliteWriter = BagWriter(
                output, compression=inside, split_bytes=split_bytes, split_s=split_s
            )
        elif split_bytes or split_s:
            raise ToolError("only MCAP bags are split: leave out --max-bag-size and --max-bag-duration")
        else:
            writer = SqliteWriter(output)
        with writer:
            count = _copy(reader, writer, *part)
    if as_json:
        printing.document({"path": output, "messages": count, "topics": len(part.topics)})
    else:
        printing.line(f"{count} messages of {len(part.topics)} topics in {output}")
    return 0


def _copy(reader: BagReader, writer: BagWriter | SqliteWriter, topics: Sequence[str], start: int, end: int) -> int:
    for name in topics:
        writer.add_topic(name, reader.topics[name])
    total = sum(reader.topics[name].count or 0 for name in topics)
    count, shown = 0, monotonic()
    with progress() as show:
        for item in reader.messages(topics, start_ns=start, end_ns=end, raw=True):
            writer.write(*item)
            count += 1
            if monotonic() > shown + _PROGRESS_S:
                shown = monotonic()
                show(f"{count} of {total} messages")
    return count
