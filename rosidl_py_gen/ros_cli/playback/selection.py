"""What of a recording is played: topics, events of services, and the topics and events that an action consists of.

Decides that what is named is all there is: with ``--topics``, ``--services``, ``--actions`` or ``--regex``, nothing
else is played, and what is excluded is not, whoever names it. Patterns match whole names, as for ``ros2 bag play``.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.ros_cli import ToolError, terminal_output
from rosidl_py_gen.ros_cli.bag.selection import BagSelection, duration_text, time_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rosidl_py_gen.ros_cli.name_lookup import TopicOwner
    from rosidl_py_gen.ros_cli.playback.command import PlayOptions
    from rosidl_py_gen.ros_cli.playback.recording import Recording


def played(recording: Recording, options: PlayOptions) -> list[str]:
    """The topics that are played, sorted.

    Raises:
        ToolError: one that was named is not there, a pattern is none, or nothing is left.
    """
    owners = recording.owners
    given = {"topic": options.topics, "service": options.services, "action": options.actions}
    excluded = {
        "topic": options.exclude_topics,
        "service": options.exclude_services,
        "action": options.exclude_actions,
    }
    named = {kind: _known(recording, owners.values(), kind, names, "") for kind, names in given.items()}
    without = {kind: _known(recording, owners.values(), kind, names, "exclude-") for kind, names in excluded.items()}
    regex, exclude = _pattern("--regex", options.regex), _pattern("--exclude-regex", options.exclude_regex)
    is_choice = any(given.values()) or regex is not None
    found = []
    for topic in recording.topics:
        kind, name, _ = owners[topic]
        chosen = not is_choice or name in named[kind] or topic in named["topic"] or _matches(regex, topic, name)
        left_out = name in without[kind] or topic in without["topic"] or _matches(exclude, topic, name)
        if chosen and not left_out:
            found.append(topic)
    if options.has_clock and "/clock" in found:
        terminal_output.note("/clock of the bag is left out, as this publishes its own")
        found.remove("/clock")
    if recording.topics and not found:
        raise ToolError(
            f"{recording.name}: nothing is left to play; there are {', '.join(recording.topics)[:300]}, and --regex "
            "and --exclude-regex match whole names"
        )
    return found


def _known(
    recording: Recording, owners: Iterable[TopicOwner], kind: str, names: Sequence[str], prefix: str
) -> set[str]:
    """Full names. What is to be played has to be there; what is excluded and is not there is only said."""
    owners = list(owners)
    there = {one.name for one in owners if one.kind == kind} | (set(recording.topics) if kind == "topic" else set())
    full = {name if name.startswith("/") else f"/{name}" for name in names}
    for name in sorted(full - there):
        reason = f"{recording.name} has no {kind} {name}{did_you_mean(name, there)}"
        other = next((one.kind for one in owners if one.name == name), "")
        if other:
            reason += f"; it is a{'n' if other == 'action' else ''} {other}: --{prefix}{other}s {name}"
        if not prefix:
            raise ToolError(reason)
        terminal_output.note(f"--{prefix}{kind}s: {reason}")
    return full & there


def _pattern(option: str, text: str | None) -> re.Pattern[str] | None:
    try:
        return re.compile(text) if text else None
    except re.error as error:
        raise ToolError(f'{option}: "{text}" is no regular expression: {error}') from None


def _matches(pattern: re.Pattern[str] | None, *names: str) -> bool:
    return pattern is not None and any(pattern.fullmatch(name) for name in names)


def part_of(recording: Recording, topics: Sequence[str], options: PlayOptions) -> BagSelection:
    """Which messages of these topics are played.

    The end is the later one of what ``--playback-duration`` and ``--playback-until-…`` say, and includes its own
    nanosecond, as in rosbag2; that of ``--duration`` does not, as for the other commands.

    Raises:
        ToolError: nothing is left of it.
    """
    start = recording.start_ns + round(options.offset_s * NS_PER_S)
    if start > recording.end_ns:
        length = duration_text(recording.end_ns - recording.start_ns)
        raise ToolError(f"{recording.name} is {length} long; nothing is left of it")
    ends = []
    if options.playback_s is not None:
        ends.append(start + round(options.playback_s * NS_PER_S) + 1 if options.playback_s else start)
    if options.until_ns is not None:
        ends.append(options.until_ns + 1)
    end = min(max(ends, default=recording.end_ns + 1), recording.end_ns + 1)
    if options.duration_s is not None:
        end = min(end, start + round(options.duration_s * NS_PER_S))
    if end < start:
        raise ToolError(
            f"{recording.name}: it is to be played until {time_text(end - 1)}, and begins at {time_text(start)}"
        )
    return BagSelection(list(topics), start, end)
