"""Commands ``bag convert`` and ``bag reindex``, which repairs metadata and indexes of a bag.

``bag merge`` and ``bag migrate`` create and fill their bags with functions of ``convert``, too.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.terminal_text import pluralize, print_next_step
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.ros_cli import DAMAGED, options, verb

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from rosidl_py_gen.bags import BagCopy, BagTopic, BagWriter, RawMessage, SourceBag, SqliteWriter
    from rosidl_py_gen.ros_cli.bag.reading import BagSelection


@click.command("convert", cls=options.MultiValueCommand)
@options.bag_path
@click.argument("output", type=click.Path())
@options.output_storage
@options.bag_selection
@options.compression
@options.split_options
@options.without_definitions
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
    """Copy a bag: SQLite as MCAP or the reverse, a selection, or a complete bag of one whose recorder was killed.

    OUTPUT is a folder, or a file that ends with .mcap. Definitions that the bag does not contain, as in Humble,
    are read from the folders of --path.

    \b
    rosidl-py bag convert old_bag new_bag
    rosidl-py bag convert humble_bag new_bag --path ~/ws/src
    rosidl-py bag convert my_bag short.mcap --topics /imu --start-offset 10 --duration 5
    """
    from rosidl_py_gen.ros_cli.bag.reading import channels_with_definitions, damaged_rows, opened_source, select_part

    with opened_source(path, paths) as reader:
        part = select_part(reader, topics, offset_s, duration_s)
        channels = channels_with_definitions(reader, part.topics, without_definitions)
        with new_bag(output, storage, compression, split_bytes, split_s) as writer:
            count, copy = copy_bag(reader, writer, part, channels)
    if as_json:
        terminal_output.document(
            {
                "path": output,
                "messages": count,
                "topics": len(part.topics),
                "damaged": damaged_rows(reader.damaged),
                "unread_bytes": reader.unread_bytes,
                "not_carried_over": dict(copy.omitted),
            }
        )
    else:
        for line in copy.omission_lines():
            terminal_output.note(line)
        terminal_output.line(f"{pluralize(count, 'message')} of {pluralize(len(part.topics), 'topic')} in {output}")
        print_next_step("rosidl-py bag info", quote(output))
    return DAMAGED if reader.damaged else 0


def create_bag(output: str, storage: str, compression: str, **options: Any) -> BagWriter | SqliteWriter:
    """Create a bag and return its writer.

    `compression` is for chunks of MCAP files, `options` are arguments of the writer.
    """
    from rosidl_py_gen.bags import BagWriter, SqliteWriter

    if storage == "sqlite3":
        return SqliteWriter(output, **options)
    return BagWriter(output, compression="" if compression == "none" else compression, **options)


@contextmanager
def new_bag(
    output: str, storage: str, compression: str, split_bytes: int | None, split_s: float | None
) -> Iterator[BagWriter | SqliteWriter]:
    """Create a bag and yield its writer; remove the bag if the block fails, as an incomplete bag looks complete."""
    writer = create_bag(output, storage, compression, split_bytes=split_bytes, split_s=split_s)
    try:
        with writer:
            yield writer
    except BaseException:
        if writer.path.is_dir():
            shutil.rmtree(writer.path, ignore_errors=True)
        else:
            writer.path.unlink(missing_ok=True)
        raise


def copy_bag(
    reader: SourceBag,
    writer: BagWriter | SqliteWriter,
    selection: BagSelection,
    channels: Mapping[tuple[str, ...], BagTopic],
    converter_of: Callable[[BagTopic], Callable[[RawMessage], RawMessage] | None] = lambda _: None,
) -> tuple[int, BagCopy]:
    """Copy the selected messages of a bag, and everything else that the new bag can store.

    Args:
        channels: channels of the new bag, by the key of the recorded channel.
        converter_of: returns the function that converts messages of a recorded channel; None to copy them unchanged.

    Returns:
        Number of copied messages, and the completed copy, which counts what the new bag cannot store.
    """
    from rosidl_py_gen.bags import BagCopy
    from rosidl_py_gen.ros_cli.bag.reading import ProgressBar

    copy = BagCopy([reader], writer)
    (targets,) = copy.begin([channels])
    total = sum(channel.count or 0 for channel in channels.values())
    expected = total * selection.part_of(reader)
    count = 0
    known: dict[int, tuple[BagTopic, BagTopic, Callable[[RawMessage], RawMessage] | None]] = {}
    if selection.is_all(reader):
        items = reader.raw_messages()  # also reads chunks without messages
    else:
        items = reader.raw_messages(selection.topics, start_ns=selection.start_ns, end_ns=selection.end_ns)
    with ProgressBar("messages") as show:
        for item in show.each(items, expected):
            channel = item.channel
            key = id(channel)  # comparing definitions for each message takes long; the tuple retains the channel
            if key not in known:
                known[key] = channel, targets[channel.channel_key], converter_of(channel)
            _, target, convert = known[key]
            writer.write_raw(item if convert is None else convert(item), target)
            count += 1
    copy.end()
    return count, copy


@click.command("reindex")
@options.bag_path
@options.as_json
@verb
def reindex(path: str, as_json: bool) -> int:
    """Recreate the metadata.yaml of a bag folder, and repair files without an index, as after a crash.

    A repaired file is rewritten; the old file is renamed to FILE.unindexed. Stop the recorder first.

    \b
    rosidl-py bag reindex my_bag
    rosidl-py bag reindex my_bag/my_bag_3.mcap
    """
    from rosidl_py_gen.bags import reindex as repair
    from rosidl_py_gen.ros_cli.bag.reading import ProgressBar, damaged_rows

    with ProgressBar("bytes") as show:
        result = repair(Path(path), show)
    if as_json:
        terminal_output.document(
            {
                "path": str(result.path),
                "files": result.files,
                "messages": result.messages,
                "topics": result.topics,
                "without_index": list(result.unindexed_files),
                "kept": None if len(result.repaired) != 1 else str(result.repaired[0].backup),
                "repaired": [{"file": str(one.path), "kept": str(one.backup)} for one in result.repaired],
                "damaged": damaged_rows(result.damaged),
                "unread_bytes": result.unread_bytes,
                "not_carried_over": dict(result.omitted),
            }
        )
        return DAMAGED if result.damaged else 0
    for one in result.repaired:
        reason = "had no index and is" if one.path.name in result.unindexed_files else "is"
        terminal_output.note(f"{one.path.name} {reason} rewritten; the old file is renamed to {one.backup}")
    for line in result.omission_lines():
        terminal_output.note(line)
    counts = f"{pluralize(result.messages, 'message')} of {pluralize(result.topics, 'topic')}"
    terminal_output.line(f"{counts} in {pluralize(result.files, 'file')}: {result.path}")
    print_next_step("rosidl-py bag info", quote(str(result.path)))
    return DAMAGED if result.damaged else 0
