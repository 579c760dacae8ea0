"""Player that sends each recorded message of one or several bags when it is due, and the selection of messages.

With ``--topics``, ``--services``, ``--actions`` or ``--regex`` only the named topics, service events and topics of
actions are played. Exclusion precedes inclusion. Patterns match whole names, as for ``ros2 bag play``. Services of
rosbag2's player and keys of the terminal control the player.
"""

from __future__ import annotations

import asyncio
from contextlib import ExitStack, nullcontext
from heapq import heappop, heappush, merge
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S, set_stamp, stamp_ns
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import CommandError, CommandNode, NetworkOptions, first_of, terminal_output
from rosidl_py_gen.ros_cli import DAMAGED, AsyncCommand
from rosidl_py_gen.ros_cli.bag.player_recorder import read_keys, read_qos_overrides
from rosidl_py_gen.ros_cli.bag.reading import BagSelection, duration_text, opened_bag, start_of, time_text
from rosidl_py_gen.ros_cli.bag.rosbag2_services import serve_rosbag2
from rosidl_py_gen.ros_cli.bag.topic_owner import topic_owner
from rosidl_py_gen.ros_cli.options import compile_pattern
from rosidl_py_gen.ros_cli.playback.senders import Requests, TopicPublishers, cannot_play_reason
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    import re
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from rosidl_py_gen.bags import BagReader, BagTopic, RawMessage
    from rosidl_py_gen.ros_cli.playback import PlayOptions
    from rosidl_py_gen.runtime import Node

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


class Timeline:
    """Clock of a playback, which runs at a rate, pauses and jumps. Thread: loop."""

    def __init__(self, at_ns: int, rate: float, *, is_paused: bool = False) -> None:
        self._at_ns = at_ns
        self._since_s = CommandNode.now_s()
        self.rate = rate
        """Speed of the clock; 2.0 is twice as fast as real time."""
        self.is_paused = is_paused
        self._wake_up: asyncio.Future[bool] | None = None
        self._changes = 0

    def now_ns(self) -> int:
        """Return the time in the recording that playback has reached, in nanoseconds."""
        if self.is_paused:
            return self._at_ns
        return self._at_ns + round((CommandNode.now_s() - self._since_s) * self.rate * NS_PER_S)

    def set_paused(self, is_paused: bool) -> None:
        """Stop the clock if `is_paused` is True, else continue it."""
        self.jump(self.now_ns())
        self.is_paused = is_paused

    def set_rate(self, rate: float) -> bool:
        """Set the rate of the clock; returns False if `rate` is not a positive finite number."""
        if not 0 < rate < float("inf"):
            return False
        self.jump(self.now_ns())
        self.rate = rate
        return True

    def jump(self, at_ns: int) -> None:
        """Set the clock to a time in nanoseconds, and make a waiting `until` return False."""
        self._at_ns, self._since_s = at_ns, CommandNode.now_s()
        self.wake()

    def wake(self) -> None:
        """Make a waiting `until` return False, although the clock was not changed."""
        self._changes += 1
        if self._wake_up is not None and not self._wake_up.done():
            self._wake_up.set_result(False)

    async def until(self, at_ns: int | None) -> bool:
        """Wait until the clock reaches a time (None: never).

        Returns False if the clock was changed during the wait.
        """
        if not self.is_paused and at_ns is not None:
            left_s = self._since_s + (at_ns - self._at_ns) / NS_PER_S / self.rate - CommandNode.now_s()
            if left_s <= 0:
                before = self._changes
                await asyncio.sleep(0)
                return before == self._changes
        else:
            left_s = None
        loop = asyncio.get_running_loop()
        waiting: asyncio.Future[bool] = loop.create_future()
        self._wake_up = waiting
        due = None if left_s is None else loop.call_later(left_s, _set_due, waiting)
        try:
            return await waiting
        finally:
            self._wake_up = None
            if due is not None:
                due.cancel()


def _set_due(waiting: asyncio.Future[bool]) -> None:
    if not waiting.done():
        waiting.set_result(True)


class Player:
    """Player of a recording, with methods for keys and services.

    The constructor raises `CommandError` for invalid options. Thread: loop.
    """

    def __init__(
        self,
        command_node: CommandNode,
        recording: Recording,
        part: BagSelection,
        options: PlayOptions,
        overrides: Mapping[str, QoSProfile],
    ) -> None:
        self._recording = recording
        self._part = part
        self._options = options
        self._node = command_node.node
        note = terminal_output.OnceNotes()
        self.publishers = TopicPublishers(command_node.node, overrides, note)
        self.requests = Requests(command_node.node, options.requests_source, options.paths, note)
        self._names = _remapped_names(command_node, recording, part.topics, options.remaps)
        known = {channel.name for _, channel in recording.channels}.union(self._names.values())
        if unknown := [name for name in overrides if name not in known]:
            more = "" if len(unknown) == 1 else f", nor {pluralize(len(unknown) - 1, 'other topic')} of this file"
            note(f"{options.qos_file}: the bag has no topic {unknown[0]}{more}{did_you_mean(unknown[0], known)}")
        self._clock_topics = {command_node.full_name(one) for one in options.clock_topics}
        for name in sorted(self._clock_topics.difference(part.topics)):
            raise CommandError(f"--clock-topics {name}: topic is not played; topics are {', '.join(part.topics)[:300]}")
        self._clock: Callable[[int], None] = self._clock_sender() if options.has_clock else lambda now: None
        self._send: dict[tuple[str, ...], Callable[[bytes], bool]] = {}
        for reader, channel in recording.channels:
            if channel.name in part.topics and channel.key not in self._send:
                self._send[channel.key] = self._sender(reader, channel)
        self._by_channel: dict[int, Callable[[bytes], bool]] = {}
        self._channels: list[BagTopic] = []  # so that their `id` stays unique
        self.timeline = Timeline(part.start_ns, options.rate, is_paused=options.start_paused)
        self._messages: Iterator[RawMessage] = iter(())
        self._next: RawMessage | None = None
        self._is_stopped = False
        self._has_begun = asyncio.Event()
        self.count = 0
        """Number of messages published and requests sent."""
        self.on_change: Callable[[], None] = lambda: None
        """Function that is called when the result of `state` has changed."""

    def _sender(self, reader: BagReader, channel: BagTopic) -> Callable[[bytes], bool]:
        if cannot_play_reason(channel):
            return lambda data: False
        kind, name, service = self._recording.owners[channel.name]
        if kind == "action" and self._options.actions_as_client:
            if service:
                return self.requests.sender(reader, channel, self._names.get(service, service))
            return lambda data: False  # the server publishes them
        if kind == "service" and self._options.publish_requests:
            return self.requests.sender(reader, channel, self._names.get(name, name))
        return self.publishers.sender(reader, channel, self._names.get(channel.name, channel.name))

    def _publish(self, item: RawMessage) -> bool:
        send = self._by_channel.get(id(item.channel))  # comparing definitions for each message takes long
        if send is None:
            send = self._by_channel[id(item.channel)] = self._send[item.channel.key]
            self._channels.append(item.channel)
        if self._options.clock_topics_all or item.channel.name in self._clock_topics:
            self._clock(self._due(item))
        was_sent = send(item.data)
        self.count += was_sent
        if self._options.progress_hz < 0:
            self.on_change()
        return was_sent

    def _clock_sender(self) -> Callable[[int], None]:
        clock: Any = get_message("rosgraph_msgs/msg/Clock")
        publisher = self._node.create_publisher(clock, "/clock", QoSProfile(depth=1))

        def send(now_ns: int) -> None:
            message = clock()
            set_stamp(message.clock, max(0, now_ns))
            publisher.publish(message)

        return send

    async def publish_clock(self, hz: float) -> None:
        """Publish the time of playback on ``/clock`` at a rate of `hz` until cancelled."""
        rate = self._node.create_rate(hz)
        while True:
            self._clock(self.timeline.now_ns())
            await rate.sleep()

    async def play(self) -> None:
        """Publish all messages, repeatedly with ``--loop``, until `stop`; at the end, wait while paused.

        A selection without messages is not repeated.
        """
        self._begin(self._part.start_ns)
        self._has_begun.set()
        while not self._is_stopped:
            if self._next is None:
                if self.timeline.is_paused:
                    await self.timeline.until(None)
                    continue
                if self._options.loop:
                    self._begin(self._part.start_ns)
                if self._next is None:
                    return
            elif await self.timeline.until(self._due(self._next)):
                item = self._next
                self._advance()
                self._publish(item)

    def _due(self, item: RawMessage) -> int:
        return item.publish_time if self._options.order == "sent" else item.log_time

    def _begin(self, at_ns: int) -> None:
        topics, _, end_ns = self._part
        if self._options.order == "sent":
            messages = self._recording.messages(topics, self._part.start_ns, self._recording.end_ns + 1)
            ordered = by_publish_time(messages, self._options.read_ahead)
            first = at_ns if at_ns > self._part.start_ns else 0  # also what was sent before recording began
            self._messages = (one for one in ordered if first <= one.publish_time < end_ns)
        else:
            self._messages = self._recording.messages(topics, at_ns, end_ns)
        self._advance()
        self.timeline.jump(at_ns)

    def _advance(self) -> None:
        self._next = next(self._messages, None)

    async def started(self) -> None:
        """Wait until `play` has started; before that there is no next message."""
        await self._has_begun.wait()

    def set_paused(self, is_paused: bool) -> None:
        """Pause playback if `is_paused` is True, else resume it."""
        self.timeline.set_paused(is_paused)
        self.on_change()

    def toggle(self) -> None:
        """Pause playback, or resume it if it is paused."""
        self.set_paused(not self.timeline.is_paused)

    def set_rate(self, rate: float) -> bool:
        """Set the rate of playback; returns False if `rate` is not a positive finite number."""
        is_set = self.timeline.set_rate(rate)
        self.on_change()
        return is_set

    def change_rate(self, by: float) -> None:
        """Add `by` to the rate of playback, unless the new rate would be 0 or less."""
        self.set_rate(round(self.timeline.rate + by, 6))

    def step(self) -> bool:
        """Publish the next message if playback is paused; returns True if a message was sent."""
        was_sent = self._step()
        self.on_change()
        return was_sent

    def _step(self) -> bool:
        if not self.timeline.is_paused:
            return False
        while self._next is not None:
            item = self._next
            self._advance()
            self.timeline.jump(self._due(item))
            if self._publish(item):
                return True
        return False

    def burst(self, count: int) -> int:
        """Publish the next `count` messages, 0 for all, if playback is paused; returns how many were sent."""
        done = 0
        while (not count or done < count) and self._step():
            done += 1
        self.on_change()
        return done

    def seek(self, at_ns: int) -> bool:
        """Continue playback at a time, not before the start of the selection; returns False if it is after the end."""
        if at_ns >= self._part.end_ns:
            return False
        self._begin(max(at_ns, self._part.start_ns))
        self.on_change()
        return True

    def stop(self) -> None:
        """End playback: make `play` return."""
        self._is_stopped = True
        self.timeline.wake()

    def state(self) -> str:
        """Return the progress of playback as a line of text."""
        length_ns = self._part.end_ns - self._part.start_ns
        at = duration_text(min(max(0, self.timeline.now_ns() - self._part.start_ns), length_ns))
        rate = "" if self.timeline.rate == 1 else f", at {self.timeline.rate:g} times the rate"
        paused = ", paused" if self.timeline.is_paused else ""
        return f"{at} of {duration_text(length_ns)}, {pluralize(self.count, 'message')}{rate}{paused}"


def _remapped_names(
    command_node: CommandNode, recording: Recording, topics: Sequence[str], remaps: Sequence[str]
) -> dict[str, str]:
    known = {*topics, *filter(None, (recording.owners[topic].service for topic in topics))}
    names = {}
    for remap in remaps:
        before, arrow, after = remap.partition(":=")
        if not (before and arrow and after):
            raise CommandError(f"--remap {remap}: expected FROM:=TO")
        name = command_node.full_name(before)
        if name not in known:
            raise CommandError(f"--remap {remap}: {name} is not played; topics are {', '.join(topics)[:300]}")
        names[name] = command_node.full_name(after)
    return names


_SUBSCRIBER_DISCOVERY_S = 2.0
"""Maximum time to wait for subscribers before playback, in seconds; Fast DDS is slower (docs/internals/dds.md 6)."""
_RATE_STEP = 0.1
_PLAYER = "/rosbag2_player"
_NEED_START = ("burst", "play_next", "seek")


def play_bag(network: NetworkOptions, options: PlayOptions) -> AsyncCommand:
    """Return a command that plays bags; raises `CommandError` or OSError for the file of QoS profiles."""
    overrides = read_qos_overrides(options.qos_file)
    return AsyncCommand(_play(network, options, overrides), endless=options.loop)


def _playable_topics(recording: Recording, topics: Sequence[str]) -> list[str]:
    """Return the topics that ROS 2 permits to publish, and print a note about others.

    Raises `CommandError` if none is left.
    """
    left = {}
    for _, channel in recording.channels:
        if channel.name not in topics:
            continue
        if reason := cannot_play_reason(channel):
            terminal_output.note(f"{channel.name} [{channel.type_name}] is skipped: {reason}")
        else:
            left[channel.name] = True
    if topics and not left:
        raise CommandError(f"{recording.name}: none of its topics can be played")
    return [name for name in topics if name in left]


async def _play(network: NetworkOptions, options: PlayOptions, overrides: Mapping[str, QoSProfile]) -> int:
    node_options = {"start_type_description_service": True}  # peers may not have the types
    with Recording(options.bags, options.paths, options.storage) as recording:
        topics = _playable_topics(recording, selected_topics(recording, options))
        part = select_messages(recording, topics, options)
        async with CommandNode(network, parameter_overrides=node_options) as command_node:
            player = Player(command_node, recording, part, options, overrides)
            _serve(command_node.node, player)
            await command_node.wait_for_discovery()
            if network.get("spin_time_s") is None:
                await asyncio.gather(
                    player.publishers.wait_for_subscribers(_SUBSCRIBER_DISCOVERY_S),
                    player.requests.wait_for_servers(_SUBSCRIBER_DISCOVERY_S),
                )
            await asyncio.sleep(options.delay_s)
            await _play_with_keys(player, options)
            await asyncio.gather(
                player.publishers.wait_acknowledged(options.acked_ms), player.requests.wait_for_responses()
            )
        sent = player.requests.count
        requests = (
            f" and sent {pluralize(sent, 'request')}" if options.publish_requests or options.actions_as_client else ""
        )
        terminal_output.note(
            f"published {pluralize(player.count - sent, 'message')} of {pluralize(len(topics), 'topic')}{requests}"
        )
        return DAMAGED if recording.is_damaged else 0


async def _play_with_keys(player: Player, options: PlayOptions) -> None:
    actions: dict[str, Callable[[], object]] = {
        "space": player.toggle,
        "right": player.step,
        "up": lambda: player.change_rate(_RATE_STEP),
        "down": lambda: player.change_rate(-_RATE_STEP),
    }
    keys = nullcontext(False) if options.no_keys else read_keys(actions)
    with keys as has_keys, terminal_output.StatusLine() as status:
        usage = "space: pause, →: next message, ↑↓: rate; Ctrl-C ends playback" if has_keys else "Ctrl-C ends playback"
        if has_keys and not status.is_possible:
            terminal_output.note(usage)
        if options.start_paused and not has_keys:
            terminal_output.note(f"paused, until the service {_PLAYER}/resume is called")

        def show_state() -> None:
            status.show(f"{player.state()}; {usage}")

        helpers = [player.publish_clock(options.clock_hz)] if options.clock_hz else []
        if options.progress_hz:
            player.on_change = show_state
        if options.progress_hz > 0:
            helpers.append(_repeat(show_state, 1 / options.progress_hz))
        await first_of(player.play(), *helpers)


async def _repeat(show: Callable[[], None], every_s: float) -> None:
    while True:
        show()
        await asyncio.sleep(every_s)


def _serve(node: Node, player: Player) -> None:
    """Create the services of rosbag2's player, which control `player`."""
    timeline = player.timeline

    async def wait_for_start(service: str) -> None:
        if service in _NEED_START:
            await player.started()

    serve_rosbag2(
        node,
        f"{_PLAYER}/",
        {
            "pause": lambda _: player.set_paused(True),
            "resume": lambda _: player.set_paused(False),
            "toggle_paused": lambda _: player.toggle(),
            "is_paused": lambda _: {"paused": timeline.is_paused},
            "get_rate": lambda _: {"rate": timeline.rate},
            "set_rate": lambda request: {"success": player.set_rate(request.rate)},
            "play": lambda _: {"success": False},  # it is playing already
            "play_next": lambda _: {"success": player.step()},
            "burst": lambda request: {"actually_burst": player.burst(request.num_messages)},
            "seek": lambda request: {"success": player.seek(stamp_ns(request.time))},
            "stop": lambda _: player.stop(),
        },
        wait_for_start,
    )
