"""Recording of one or several bags that are played together, and the selection of their topics and messages.

With ``--topics``, ``--services``, ``--actions`` or ``--regex`` only the named topics, service events and topics of
actions are played. Exclusion precedes inclusion. Patterns match whole names, as for ``ros2 bag play``.
"""

from __future__ import annotations

from contextlib import ExitStack
from heapq import heappop, heappush, merge
from operator import attrgetter
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.bag.display import opened_bag, time_text
from rosidl_py_gen.ros_cli.bag.selection import BagSelection, start_of
from rosidl_py_gen.ros_cli.command_support import CommandError
from rosidl_py_gen.ros_cli.name_lookup import topic_owner
from rosidl_py_gen.ros_cli.options import compile_pattern

if TYPE_CHECKING:
    import re
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.bags import BagReader, BagTopic, RawMessage
    from rosidl_py_gen.ros_cli.playback.command import PlayOptions


_KINDS = {".db3": "sqlite3", ".mcap": "mcap"}


class Recording:
    """Bags that are played together; a context manager.

    Raises `CommandError` if a bag has another storage format than the requested `storage`.
    """

    def __init__(self, places: Sequence[str], paths: Sequence[str], storage: str | None = None) -> None:
        with ExitStack() as stack:
            self._readers = [stack.enter_context(opened_bag(place, search_path=paths)) for place in places]
            for reader in self._readers:
                _require_storage(reader, storage)
            self._open = stack.pop_all()
        self.name = ", ".join(str(reader.path) for reader in self._readers)
        """Paths of the bags, joined for texts to the user."""
        self.channels: list[tuple[BagReader, BagTopic]] = [
            (reader, channel) for reader in self._readers for channel in reader.channels
        ]
        """Recorded channels of all bags, each with the reader of its bag."""
        self.owners = {channel.name: topic_owner(channel.name, channel.type_name) for _, channel in self.channels}
        """Owner of each recorded topic by the topic's name: a service, an action or the topic itself."""
        self.topics = sorted(self.owners)
        filled = [reader for reader in self._readers if reader.end_ns]
        self.start_ns = min((reader.start_ns for reader in filled), default=0)
        """Log time of the first message in all bags, in nanoseconds; 0 without messages."""
        self.end_ns = max((reader.end_ns for reader in filled), default=0)
        """Log time of the last message in all bags, in nanoseconds; 0 without messages."""

    def messages(self, topics: Sequence[str], start_ns: int, end_ns: int) -> Iterator[RawMessage]:
        """Yield the messages of topics with ``start_ns <= log_time < end_ns`` from all bags, by log time."""
        each = [
            reader.raw_messages([name for name in topics if name in reader.topics], start_ns=start_ns, end_ns=end_ns)
            for reader in self._readers
        ]
        return each[0] if len(each) == 1 else merge(*each, key=attrgetter("log_time"))

    @property
    def is_damaged(self) -> bool:
        """True if damaged parts of the bags were skipped so far."""
        return any(reader.damaged for reader in self._readers)

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()


def _require_storage(reader: BagReader, storage: str | None) -> None:
    for file in reader.files:
        actual = _KINDS.get(file.suffix if file.suffix in _KINDS else file.with_suffix("").suffix, "")
        if storage is not None and actual != storage:
            raise CommandError(f"{file}: storage is {actual}; expected {storage}, or no --storage")


def by_publish_time(messages: Iterable[RawMessage], ahead: int) -> Iterator[RawMessage]:
    """Yield messages sorted by publish time within a window of `ahead` messages."""
    waiting: list[tuple[int, int, RawMessage]] = []
    for number, message in enumerate(messages):
        heappush(waiting, (message.publish_time, number, message))
        if len(waiting) > ahead:
            yield heappop(waiting)[2]
    while waiting:
        yield heappop(waiting)[2]


def selected_topics(recording: Recording, options: PlayOptions) -> list[str]:
    """Return the sorted names of the topics that options select; raises `CommandError` if none is selected."""
    owners = recording.owners
    included = {"topic": options.topics, "service": options.services, "action": options.actions}
    excluded = {"topic": options.exclude_topics, "service": options.exclude_services, "action": options.exclude_actions}
    named = {kind: _existing_names(recording, kind, names, "") for kind, names in included.items()}
    skipped = {kind: _existing_names(recording, kind, names, "exclude-") for kind, names in excluded.items()}
    regex = compile_pattern(options.regex, "--regex") if options.regex else None
    exclude = compile_pattern(options.exclude_regex, "--exclude-regex") if options.exclude_regex else None
    is_choice = any(included.values()) or regex is not None
    selected = []
    for topic in recording.topics:
        kind, name, _ = owners[topic]
        is_included = not is_choice or name in named[kind] or topic in named["topic"] or _matches(regex, topic, name)
        is_excluded = name in skipped[kind] or topic in skipped["topic"] or _matches(exclude, topic, name)
        if is_included and not is_excluded:
            selected.append(topic)
    if options.has_clock and "/clock" in selected:
        terminal_output.note("skipped /clock of the bag, as --clock publishes it")
        selected.remove("/clock")
    if recording.topics and not selected:
        raise CommandError(
            f"{recording.name}: no topic is selected; topics are {', '.join(recording.topics)[:300]}; --regex "
            "and --exclude-regex match whole names"
        )
    return selected


def _existing_names(recording: Recording, kind: str, names: Sequence[str], prefix: str) -> set[str]:
    """Return the full names of some names that the bags have.

    A missing name is an error; with a `prefix` only a note is printed.
    """
    owners = recording.owners.values()
    existing = {one.name for one in owners if one.kind == kind} | (set(recording.topics) if kind == "topic" else set())
    full = {name if name.startswith("/") else f"/{name}" for name in names}
    for name in sorted(full - existing):
        reason = f"{recording.name} has no {kind} {name}{did_you_mean(name, existing)}"
        other = next((one.kind for one in owners if one.name == name), "")
        if other:
            reason += f"; it is a{'n' if other == 'action' else ''} {other}: --{prefix}{other}s {name}"
        if not prefix:
            raise CommandError(reason)
        terminal_output.note(f"--{prefix}{kind}s: {reason}")
    return full & existing


def _matches(pattern: re.Pattern[str] | None, *names: str) -> bool:
    return pattern is not None and any(pattern.fullmatch(name) for name in names)


def select_messages(recording: Recording, topics: Sequence[str], options: PlayOptions) -> BagSelection:
    """Return the selection of messages that are played: topics, start and end.

    The end is the later one of ``--playback-duration`` and ``--playback-until-…``, and is inclusive as in rosbag2. An
    earlier end by ``--duration`` is exclusive as for other commands.
    """
    start = start_of(recording.name, recording.start_ns, recording.end_ns, options.offset_s)
    ends = []
    if options.playback_s is not None:
        ends.append(start + round(options.playback_s * NS_PER_S) + 1 if options.playback_s else start)
    if options.until_ns is not None:
        ends.append(options.until_ns + 1)
    end = min(max(ends, default=recording.end_ns + 1), recording.end_ns + 1)
    if options.duration_s is not None:
        end = min(end, start + round(options.duration_s * NS_PER_S))
    if end < start:
        raise CommandError(
            f"{recording.name}: starts at {time_text(start)}; expected an end after it, got {time_text(end - 1)}"
        )
    return BagSelection(list(topics), start, end)
