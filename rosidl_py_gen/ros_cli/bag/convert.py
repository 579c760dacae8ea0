"""``bag convert``: a bag, or a part of it, written again.

What the copy says its messages are is decided in described.py.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.ros_cli import DAMAGED, options, terminal_output, verb

if TYPE_CHECKING:
    from rosidl_py_gen.bags import BagReader, BagTopic, BagWriter, SqliteWriter
    from rosidl_py_gen.ros_cli.bag.selection import BagSelection


_PROGRESS_S = 0.25


@click.command("convert", cls=options.MultiValueCommand)
@options.bag_path
@click.argument("output", type=click.Path())
@click.option(
    "-s", "--storage", type=click.Choice(["mcap", "sqlite3"]), default="mcap", show_default=True, help="Of the output."
)
@options.bag_selection
@options.compression
@options.split_options
@click.option(
    "--without-definitions",
    is_flag=True,
    help="Also copy topics whose types are known nowhere; nobody can read them without these.",
)
@options.paths
@options.as_json
@verb
def convert(
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
    paths: Sequence[str],
    without_definitions: bool,
) -> int:
    """Write a bag again: SQLite as MCAP or the reverse, a part of it, a whole one of one whose recorder was killed.

    OUTPUT is a folder, or a file that ends with .mcap. Types that the bag has no definition of, as those of Humble,
    are looked for in the folders of --path.

    \b
    rosidl-py bag convert old_bag new_bag
    rosidl-py bag convert humble_bag new_bag --path ~/ws/src
    rosidl-py bag convert my_bag short.mcap --topics /imu --start-offset 10 --duration 5
    """
    from rosidl_py_gen.bags import BagReader, BagWriter, SqliteWriter
    from rosidl_py_gen.ros_cli.bag.output_definitions import channels_with_definitions
    from rosidl_py_gen.ros_cli.bag.selection import damaged_rows, select_part

    with BagReader(path, search_path=paths, skip_damaged=True) as reader:
        part = select_part(reader, topics, offset_s, duration_s)
        channels = channels_with_definitions(reader, part.topics, without_definitions)
        if storage == "mcap":
            inside = "" if compression == "none" else compression
            writer: BagWriter | SqliteWriter = BagWriter(
                output, compression=inside, split_bytes=split_bytes, split_s=split_s
            )
        else:
            writer = SqliteWriter(output, split_bytes=split_bytes, split_s=split_s)
        try:
            with writer:
                count = _copy(reader, writer, part, channels)
        except BaseException:
            remove(Path(output))  # part of a bag would look like all of it
            raise
    if as_json:
        damaged = damaged_rows(reader.damaged)
        terminal_output.document({"path": output, "messages": count, "topics": len(part.topics), "damaged": damaged})
    else:
        terminal_output.line(f"{count} messages of {len(part.topics)} topics in {output}")
    return DAMAGED if reader.damaged else 0


def remove(path: Path) -> None:
    """Take back a bag that was begun."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _copy(
    reader: BagReader, writer: BagWriter | SqliteWriter, part: BagSelection, channels: dict[tuple[str, ...], BagTopic]
) -> int:
    from rosidl_py_gen.bags import RawMessage
    from rosidl_py_gen.ros_cli.bag.selection import progress

    for channel in channels.values():
        writer.add_raw_topic(channel)
    total = sum(channel.count or 0 for channel in channels.values())
    count, shown = 0, monotonic()
    written: dict[int, tuple[BagTopic, BagTopic]] = {}  # by identity: comparing definitions takes long
    with progress() as show:
        for item in reader.raw_messages(part.topics, start_ns=part.start_ns, end_ns=part.end_ns):
            known = written.get(id(item.channel))
            if known is None:
                known = written[id(item.channel)] = item.channel, channels[item.channel.key]
            writer.write_raw(RawMessage(known[1], *item[1:]))
            count += 1
            if monotonic() > shown + _PROGRESS_S:
                shown = monotonic()
                show(f"{count} of {total} messages")
    return count
