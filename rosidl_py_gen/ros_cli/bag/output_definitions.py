"""Channels with the definitions that a bag is to be written with.

Decides that nothing is written with a definition that is not that of its messages, nor silently without one.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import TYPE_CHECKING

from rosidl_py_gen.bags.definition_lookup import described, has_definition, mismatch_reason
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import ToolError, terminal_output

if TYPE_CHECKING:
    from rosidl_py_gen.bags import BagReader, BagTopic

_SAMPLES = 20
"""Of each channel whose definition is a guess, read before."""


def channels_with_definitions(
    reader: BagReader, topics: Sequence[str], keeps_unknown: bool
) -> dict[tuple[str, ...], BagTopic]:
    """What is written for each channel, by its key: with the definition in the bag, or the one that is known here.

    Raises:
        ToolError: there is none, or a wrong one, of channels with messages, and `keeps_unknown` is not said.
    """
    found: dict[tuple[str, ...], BagTopic] = {}
    unknown: list[tuple[BagTopic, str]] = []
    guessed: set[str] = set()
    for channel in reader.channels:
        if channel.name not in topics:
            continue
        found[channel.key] = channel
        if channel.definition or channel.message_encoding != "cdr":
            continue
        try:
            known = reader.definition(channel)
        except RosidlError as error:
            unknown.append((channel, str(error)))
            continue
        if reason := guess_mismatch(reader, channel):
            unknown.append((channel, reason))
            continue
        found[channel.key] = described(channel, known)
        if has_definition(found[channel.key]):
            guessed.add(f"{channel.type_name} from {known.origin}")
    _require_known(reader, unknown, keeps_unknown)
    if guessed:
        terminal_output.note(f"definitions that the bag does not have are written: {', '.join(sorted(guessed))}")
    return found


def guess_mismatch(reader: BagReader, channel: BagTopic) -> str:
    """Why the definition that is guessed for a channel is not that of its first messages; empty when it may be."""
    try:
        known = reader.definition(channel)
    except RosidlError:  # there is none
        return ""
    if known.is_recorded:
        return ""
    found = (one.data for one in reader.raw_messages(channel.name) if one.channel.key == channel.key)
    return mismatch_reason(channel, known, islice(found, _SAMPLES))


def _require_known(reader: BagReader, unknown: Sequence[tuple[BagTopic, str]], keeps_unknown: bool) -> None:
    missing = [f"{channel.type_name}: {reason}" for channel, reason in unknown if channel.count != 0]
    if missing and not keeps_unknown:
        raise ToolError(
            f"{reader.path} would be written without definitions of {'; '.join(missing)}. "
            "--path DIR gives them, --topics leaves topics out, --without-definitions writes them all the same"
        )
    for channel, reason in unknown:
        terminal_output.note(f"{channel.name} [{channel.type_name}] is written without a definition: {reason}")
