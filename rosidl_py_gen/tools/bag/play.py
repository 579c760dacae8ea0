"""``bag play``.

Decides the quality of service of what is published: the strongest that was offered when it was recorded, which every
subscription connects to that did then. A topic with messages of two definitions has a publisher for each.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.bags.metadata import qos_profiles
from rosidl_py_gen.bags.pacing import paced
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.base.stamps import NS_PER_S, set_stamp
from rosidl_py_gen.cdr import Message, TypeInfo
from rosidl_py_gen.errors import DecodeError, EncodeError, RosidlError
from rosidl_py_gen.runtime import Durability, QoSProfile, Reliability, WaitTimeoutError, validate_full_name
from rosidl_py_gen.tools import Job, ToolError, printing
from rosidl_py_gen.tools.bag.described import wrong
from rosidl_py_gen.tools.bag.part import Part, duration_text, part_of, progress
from rosidl_py_gen.tools.commands.bag import PlayOptions
from rosidl_py_gen.tools.names import full_topic_name
from rosidl_py_gen.tools.session import Network, Session, now_s

if TYPE_CHECKING:
    from rosidl_py_gen.bags import BagTopic
    from rosidl_py_gen.runtime import Publisher

_LISTENERS_S = 2.0
"""Until everybody who listens is known; those on Fast DDS are up to a second late (docs/internals/dds.md 6)."""
_ACKNOWLEDGED_S = 1.0
_PROGRESS_S = 0.5
_MIN_DEPTH = 10


def run(network: Network, options: PlayOptions) -> Job:
    """What the command does."""
    return Job(_open(network, options), endless=options.loop)


async def _open(network: Network, options: PlayOptions) -> int:
    with BagReader(options.path, search_path=options.paths) as reader:
        part = _playable(reader, part_of(reader, options.topics, options.offset_s, options.duration_s))
        return await _play(network, reader, part, options)


def _playable(reader: BagReader, part: Part) -> Part:
    """Without the topics that ROS 2 cannot have; a type of two parts is a message's, as everywhere.

    Raises:
        ToolError: nothing is left.
    """
    left = {}
    for channel in reader.channels:
        if channel.name not in part.topics:
            continue
        if reason := _unplayable(channel):
            printing.note(f"{channel.name} [{channel.type_name}] is left out: {reason}")
        else:
            left[channel.name] = True
    if part.topics and not left:
        raise ToolError(f"{reader.path}: none of its topics can be played")
    return part._replace(topics=[name for name in part.topics if name in left])


def _unplayable(channel: BagTopic) -> str:
    """Why messages cannot be published; empty when they can."""
    if channel.message_encoding != "cdr":
        return f"its messages are {channel.message_encoding}, not cdr"
    try:
        validate_full_name(channel.name)
        split_ros_name(channel.type_name, "msg")
    except RosidlError as error:
        return str(error)
    return ""


async def _play(network: Network, reader: BagReader, part: Part, options: PlayOptions) -> int:
    overrides = {"start_type_description_service": True}  # others may not have the types
    async with Session(network, overrides=overrides) as session:
        player = _Player(session, reader, part, options)
        await session.wait_until_quiet()
        if network.get("spin_time_s") is None:
            await player.heard(_LISTENERS_S)
        await asyncio.sleep(options.delay_s)
        with progress() as show:
            helpers = [asyncio.ensure_future(one) for one in (player.publish_clock(), player.report(show))]
            try:
                await player.play()
                while options.loop:
                    await player.play()
            finally:
                for helper in helpers:
                    helper.cancel()
        await player.acknowledged()
        printing.note(f"published {player.count} messages of {len(part.topics)} topics")
    return 0


class _Player:
    def __init__(self, session: Session, reader: BagReader, part: Part, options: PlayOptions) -> None:
        self._reader = reader
        self._part = part
        self._options = options
        self._began: tuple[float, int] | None = None
        self._node = session.node
        self._noted: set[str] = set()
        names = _remapped(session, part.topics, options.remaps)
        self._publishers: list[Publisher[Any]] = []
        self._send: dict[tuple[str, ...], Callable[[bytes], bool]] = {}
        for channel in reader.channels:
            if channel.name in names:
                self._send[channel.key] = self._sender(channel, names[channel.name])
        self._by_channel: dict[int, Callable[[bytes], bool]] = {}
        self._kept: list[BagTopic] = []  # so that their `id` is nobody else's
        self.count = 0
        """Messages published."""

    def _sender(self, channel: BagTopic, name: str) -> Callable[[bytes], bool]:
        """What publishes a message of this channel; it answers whether it did."""
        if _unplayable(channel):
            return lambda data: False
        publisher = self._node.create_publisher(self._class(channel), name, _offered(channel))
        self._publishers.append(publisher)

        def send(data: bytes) -> bool:
            try:
                publisher.publish_raw(data)
            except EncodeError as reason:  # big endian, as other systems may record it
                try:
                    publisher.publish(self._reader.definition(channel).cls.decode(data))
                except (DecodeError, RosidlError):
                    self._note(f"{channel.name}: left out a message: {reason}")
                    return False
            return True

        return send

    def _class(self, channel: BagTopic) -> type[Message]:
        """Without a definition, or with a wrong one, the bytes are published under the name of their type alone."""
        if reason := wrong(self._reader, channel):
            printing.note(reason)
            return _opaque(channel)
        try:
            return self._reader.definition(channel).cls
        except RosidlError:
            return _opaque(channel)

    def _note(self, text: str) -> None:
        if text not in self._noted and len(self._noted) < 10:
            self._noted.add(text)
            printing.note(text)

    async def play(self) -> None:
        """Publish everything once."""
        names, start, end = self._part
        self._began = None
        found = self._reader.raw_messages(names, start_ns=start, end_ns=end)
        async for item in paced(found, self._options.rate):
            if self._began is None:
                self._began = now_s(), item.log_time
            send = self._by_channel.get(id(item.channel))  # comparing definitions for each message takes long
            if send is None:
                send = self._by_channel[id(item.channel)] = self._send[item.channel.key]
                self._kept.append(item.channel)
            self.count += send(item.data)

    def _now(self) -> int | None:
        """The time of the bag, nanoseconds; None before the first message."""
        if self._began is None:
            return None
        since, log_time = self._began
        return log_time + round((now_s() - since) * self._options.rate * NS_PER_S)

    async def publish_clock(self) -> None:
        """Publish ``/clock`` for ever, if that is options."""
        if self._options.clock_hz is None:
            return
        clock: Any = get_message("rosgraph_msgs/msg/Clock")
        publisher = self._node.create_publisher(clock, "/clock", QoSProfile(depth=1))
        rate = self._node.create_rate(self._options.clock_hz)
        while True:
            if (now := self._now()) is not None:
                message = clock()
                set_stamp(message.clock, now)
                publisher.publish(message)
            await rate.sleep()

    async def report(self, show: Callable[[str], None]) -> None:
        """Say how far it is, for ever."""
        length = duration_text(self._part.end_ns - self._part.start_ns)
        while True:
            if (now := self._now()) is not None:
                show(f"{duration_text(now - self._part.start_ns)} of {length}, {self.count} messages; Ctrl-C ends it")
            await asyncio.sleep(_PROGRESS_S)

    async def heard(self, timeout_s: float) -> None:
        """Wait until every topic has a subscriber, or the time has passed."""
        await _while_there_is_time(one.wait_for_subscribers(timeout_s) for one in self._publishers)

    async def acknowledged(self) -> None:
        """Wait until what was published has arrived, for a second at most."""
        await _while_there_is_time(one.wait_for_acknowledged(_ACKNOWLEDGED_S) for one in self._publishers)


async def _while_there_is_time(waits: Iterable[Awaitable[object]]) -> None:
    """Wait for all of these, each as long as it takes at most."""
    for outcome in await asyncio.gather(*waits, return_exceptions=True):
        if isinstance(outcome, BaseException) and not isinstance(outcome, WaitTimeoutError):
            raise outcome


def _remapped(session: Session, topics: Sequence[str], remaps: Sequence[str]) -> dict[str, str]:
    """Topic of the bag -> what it is called now. Raises `ToolError`."""
    names = {topic: topic for topic in topics}
    for remap in remaps:
        before, arrow, after = remap.partition(":=")
        if not (before and arrow and after):
            raise ToolError(f'"{remap}" is no remapping; expected FROM:=TO')
        known = full_topic_name(session, before)
        if known not in names:
            raise ToolError(f"--remap {remap}: {known} is not played; there are {', '.join(topics)[:300]}")
        names[known] = full_topic_name(session, after)
    return names


def _offered(topic: BagTopic) -> QoSProfile:
    """Depths are often not known to recorders: at least ROS's default of ten."""
    offered = qos_profiles(topic.offered_qos)
    profile = QoSProfile(depth=max(_MIN_DEPTH, *(one.depth for one in offered)) if offered else _MIN_DEPTH)
    if offered and all(one.reliability is Reliability.BEST_EFFORT for one in offered):
        profile = profile.best_effort()
    if any(one.durability is Durability.TRANSIENT_LOCAL for one in offered):
        profile = profile.transient_local()
    return profile


def _opaque(topic: BagTopic) -> type[Message]:
    """A class with the name and hash of a topic's messages, for publishing their bytes."""

    class Opaque(Message):
        __slots__ = ()
        _TYPE = TypeInfo(str(split_ros_name(topic.type_name, "msg")), topic.type_hash, ())

    return Opaque
