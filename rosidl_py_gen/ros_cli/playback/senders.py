"""Publishers of what was recorded.

Decides the quality of service of what is published: what the user says, else the strongest that was offered when it was
recorded, which every subscription connects to that did then. A topic with messages of two definitions has a publisher
for each.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.metadata import qos_profiles
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.cdr import Message, TypeInfo
from rosidl_py_gen.errors import DecodeError, EncodeError, RosidlError
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.bag.output_definitions import guess_mismatch
from rosidl_py_gen.runtime import Durability, QoSProfile, Reliability, WaitTimeoutError, validate_full_name

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Iterable, Mapping

    from rosidl_py_gen.bags import BagReader, BagTopic
    from rosidl_py_gen.runtime import Node, Publisher

_MIN_DEPTH = 10
_MAX_NOTES = 10
_ACKNOWLEDGED_S = 5.0


def unplayable(channel: BagTopic) -> str:
    """Why messages cannot be published; empty when they can. A type of two parts is a message's, as everywhere."""
    if channel.message_encoding != "cdr":
        return f"its messages are {channel.message_encoding}, not cdr"
    try:
        validate_full_name(channel.name)
        split_ros_name(channel.type_name, "msg")
    except RosidlError as error:
        return str(error)
    return ""


class OnceNotes:
    """Says each sentence once, and not more than ten of them."""

    def __init__(self) -> None:
        self._said: set[str] = set()

    def __call__(self, text: str) -> None:
        if text not in self._said and len(self._said) < _MAX_NOTES:
            self._said.add(text)
            terminal_output.note(text)


class Senders:
    """The publishers of a player.

    Args:
        overrides: quality of service by topic of the bag, or by the name it is published under.
    """

    def __init__(self, node: Node, overrides: Mapping[str, QoSProfile], note: OnceNotes) -> None:
        self._node = node
        self._overrides = overrides
        self._note = note
        self._publishers: list[Publisher[Any]] = []

    def sender(self, reader: BagReader, channel: BagTopic, name: str) -> Callable[[bytes], bool]:
        """What publishes a message of this channel; it answers whether it did."""
        qos = self._overrides.get(channel.name) or self._overrides.get(name) or _offered(channel)
        publisher = self._node.create_publisher(_class(reader, channel), name, qos)
        self._publishers.append(publisher)

        def send(data: bytes) -> bool:
            try:
                publisher.publish_raw(data)
            except EncodeError as reason:  # big endian, as other systems may record it
                try:
                    publisher.publish(reader.definition(channel).message_class.decode(data))
                except (DecodeError, RosidlError):
                    self._note(f"{channel.name}: left out a message: {reason}")
                    return False
            return True

        return send

    async def wait_for_subscribers(self, timeout_s: float) -> None:
        """Wait until every topic has a subscriber, or the time has passed."""
        await wait_each_until_timeout(one.wait_for_subscribers(timeout_s) for one in self._publishers)

    async def wait_acknowledged(self, timeout_ms: int | None) -> None:
        """Wait until what was published has arrived; None for 5 s at most, 0 as long as it takes.

        When the user said how long, what did not arrive is told.
        """
        if timeout_ms is None:
            await wait_each_until_timeout(one.wait_for_acknowledged(_ACKNOWLEDGED_S) for one in self._publishers)
            return
        for one in self._publishers:
            if one.qos.reliability is Reliability.BEST_EFFORT:
                terminal_output.note(f"--wait-for-all-acked: {one.topic} is best effort, which nobody acknowledges")
        timeout_s = timeout_ms / 1000 if timeout_ms else None
        waits = (one.wait_for_acknowledged(timeout_s) for one in self._publishers)
        for late in await wait_each_until_timeout(waits):
            terminal_output.note(f"--wait-for-all-acked: {late}")


async def wait_each_until_timeout(waits: Iterable[Awaitable[object]]) -> list[WaitTimeoutError]:
    """Wait for all of these, each as long as it takes at most; gives those whose time was over."""
    late = []
    for outcome in await asyncio.gather(*waits, return_exceptions=True):
        if isinstance(outcome, WaitTimeoutError):
            late.append(outcome)
        elif isinstance(outcome, BaseException):
            raise outcome
    return late


def _class(reader: BagReader, channel: BagTopic) -> type[Message]:
    """Without a definition, or with a wrong one, the bytes are published under the name of their type alone."""
    if reason := guess_mismatch(reader, channel):
        terminal_output.note(reason)
        return _opaque(channel)
    try:
        return reader.definition(channel).message_class
    except RosidlError:
        return _opaque(channel)


def _opaque(topic: BagTopic) -> type[Message]:
    """A class with the name and hash of a topic's messages, for publishing their bytes."""

    class OpaqueMessage(Message):
        __slots__ = ()
        _TYPE = TypeInfo(str(split_ros_name(topic.type_name, "msg")), topic.type_hash, ())

    return OpaqueMessage


def _offered(topic: BagTopic) -> QoSProfile:
    """Depths are often not known to recorders: at least ROS's default of ten."""
    offered = qos_profiles(topic.offered_qos)
    profile = QoSProfile(depth=max(_MIN_DEPTH, *(one.depth for one in offered)) if offered else _MIN_DEPTH)
    if offered and all(one.reliability is Reliability.BEST_EFFORT for one in offered):
        profile = profile.best_effort()
    if any(one.durability is Durability.TRANSIENT_LOCAL for one in offered):
        profile = profile.transient_local()
    return profile
