"""Command ``bag merge``: combines several bags into one, by log time."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.terminal_text import pluralize, print_next_step
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.ros_cli import DAMAGED, options, verb

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rosidl_py_gen.bags import BagCopy, BagReader, BagTopic, BagWriter, RawMessage, SourceBag, SqliteWriter

_HINT = "select topics with rosidl-py bag convert --topics"
_MAX_OFFSET_S = 1 << 33
"""Maximum offset of a bag's clock in seconds; the log times of bags end in 2262."""


@click.command("merge")
@click.argument("output", type=click.Path(), metavar="OUT")
@click.argument("bags", nargs=-1, required=True, type=click.Path(), metavar="BAG...")
@click.option(
    "--offset",
    "offsets",
    multiple=True,
    metavar="BAG=SECONDS",
    help="Seconds to add to the times of a bag, which is named as in the arguments; may be negative. May be repeated.",
)
@options.output_storage
@options.compression
@options.split_options
@options.without_definitions
@options.paths
@options.as_json
@verb
def merge(
    output: str,
    bags: Sequence[str],
    offsets: Sequence[str],
    storage: str,
    compression: str,
    split_bytes: int | None,
    split_s: float | None,
    without_definitions: bool,
    paths: Sequence[str],
    as_json: bool,
) -> int:
    """Merge bags into one, with the messages of all of them by log time.

    OUT is a folder, or a file that ends with .mcap. Topics with equal name, definition and QoS become one; others keep
    channels of their own. --offset corrects the clock of a recorder: log and publish times, not stamps in messages.

    \b
    rosidl-py bag merge both.mcap robot laptop
    rosidl-py bag merge both robot.mcap laptop.mcap --offset laptop.mcap=-1.25
    """
    shifts = _offsets_ns(bags, offsets)
    from rosidl_py_gen.ros_cli.bag.convert import new_bag
    from rosidl_py_gen.ros_cli.bag.reading import channels_with_definitions, damaged_rows, opened_source

    with ExitStack() as stack:
        readers = [stack.enter_context(opened_source(bag, paths)) for bag in bags]
        channels = []
        for reader, shift in zip(readers, shifts, strict=True):
            channels.append(channels_with_definitions(reader, [*reader.topics], without_definitions, _HINT))
            if shift and reader.has_attachments():
                terminal_output.note(f"{reader.path}: attachments keep their times; --offset is for messages")
        with new_bag(output, storage, compression, split_bytes, split_s) as writer:
            count, copy = _merge(readers, writer, shifts, channels)
        damaged = [part for reader in readers for part in reader.damaged]
        topics = len({name for reader in readers for name in reader.topics})
        unread_bytes = sum(reader.unread_bytes for reader in readers)
    if as_json:
        terminal_output.document(
            {
                "path": output,
                "bags": len(bags),
                "messages": count,
                "topics": topics,
                "damaged": damaged_rows(damaged),
                "unread_bytes": unread_bytes,
                "not_carried_over": dict(copy.omitted),
            }
        )
    else:
        for line in copy.omission_lines():
            terminal_output.note(line)
        counts = f"{pluralize(count, 'message')} of {pluralize(topics, 'topic')}"
        terminal_output.line(f"{counts} of {pluralize(len(bags), 'bag')} in {output}")
        print_next_step("rosidl-py bag info", quote(output))
    return DAMAGED if damaged else 0


def _offsets_ns(bags: Sequence[str], texts: Sequence[str]) -> list[int]:
    """Return the offset of each bag in integer nanoseconds, as a float could not represent the time exactly."""
    offsets = {Path(bag): 0 for bag in bags}  # the shell may complete drive as drive/
    if len(offsets) < len(bags):
        twice = next(bag for number, bag in enumerate(bags) if Path(bag) in map(Path, bags[:number]))
        raise click.UsageError(f"{twice} is given twice")
    given: set[Path] = set()
    for text in texts:
        bag, _, seconds = text.rpartition("=")
        if Path(bag) not in offsets or not bag:
            hint = did_you_mean(bag, bags)
            raise click.UsageError(f"--offset {text}: expected BAG=SECONDS with a bag of the arguments{hint}")
        try:
            from decimal import Decimal  # slow to import

            number = Decimal(seconds)
            if not abs(number) < _MAX_OFFSET_S:
                raise ValueError
        except (ArithmeticError, ValueError):
            reason = f"expected a number of seconds below {_MAX_OFFSET_S}"
            raise click.UsageError(f"--offset {text}: got {seconds!r}; {reason}") from None
        if Path(bag) in given:
            raise click.UsageError(f"--offset {text}: {bag} has an offset already")
        given.add(Path(bag))
        offsets[Path(bag)] = round(number * NS_PER_S)
    return [offsets[Path(bag)] for bag in bags]


def _merge(
    readers: Sequence[SourceBag],
    writer: BagWriter | SqliteWriter,
    offsets_ns: Sequence[int],
    channels: Sequence[Mapping[tuple[str, ...], BagTopic]],
) -> tuple[int, BagCopy]:
    """Merge the bags; return the number of messages, and the completed copy, which counts what the bag cannot store."""
    from rosidl_py_gen.bags import BagCopy
    from rosidl_py_gen.ros_cli.bag.reading import ProgressBar

    copy = BagCopy(readers, writer)
    targets = copy.begin(channels)
    _note_definitions(target for each in targets for target in each.values())
    items = heapq.merge(*(_in_time(*one) for one in zip(range(len(readers)), readers, offsets_ns, strict=True)))
    total = sum(topic.count or 0 for reader in readers for topic in reader.topics.values())
    known: dict[int, tuple[BagTopic, BagTopic]] = {}
    count = 0
    with ProgressBar("messages") as show:
        for _, number, message in show.each(items, total):
            if message is None:
                continue
            channel = message.channel
            if id(channel) not in known:  # as in `copy_bag`; the tuple retains the identity
                known[id(channel)] = channel, targets[number][channel.channel_key]
            writer.write_raw(message, known[id(channel)][1])
            count += 1
    copy.end()
    return count, copy


def _in_time(number: int, reader: BagReader, offset_ns: int) -> Iterator[tuple[int, int, RawMessage | None]]:
    """Yield the messages of a bag with their corrected log times and the bag's number, which decides the order of equal
    times.

    The first item has no message, so that the bag is not read before its messages are due.
    """
    yield reader.start_ns + offset_ns, number, None
    for message in reader.raw_messages():
        log_time = message.log_time + offset_ns
        if offset_ns:
            publish_time = message.publish_time + offset_ns if message.publish_time else 0  # 0: unknown
            message = message._replace(log_time=log_time, publish_time=publish_time)
        yield log_time, number, message


def _note_definitions(channels: Iterator[BagTopic]) -> None:
    """Print the topics that have several definitions in the merged bag.

    Each message keeps the definition of its bag.
    """
    topics: dict[str, dict[tuple[str, ...], str]] = {}
    for channel in channels:
        topics.setdefault(channel.name, {})[channel.key] = channel.type_name
    for name, types in topics.items():
        if len(types) > 1:
            text = ", ".join(dict.fromkeys(types.values()))
            terminal_output.note(
                f"{name} has messages of {len(types)} definitions, of {text}; each has its own channel"
            )
