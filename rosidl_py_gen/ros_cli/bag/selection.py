"""Selection of topics and times of a bag, and definitions of the channels of a bag that is written.

A channel is never written with another type's definition, nor silently without one.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.bags.definition_lookup import described, has_definition, mismatch_reason
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.bag.display import duration_text
from rosidl_py_gen.ros_cli.command_support import CommandError

if TYPE_CHECKING:
    from rosidl_py_gen.bags import BagReader, BagTopic
    from rosidl_py_gen.bags.definition_lookup import TopicDefinition

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
        if has_definition(channels[channel.key]):
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
