"""Publishers of recorded topics.

The QoS is that of the user; else the strongest that was offered when recorded, which connects to the same
subscriptions. A topic with messages of two definitions has a publisher for each.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.metadata import qos_profiles
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.errors import DecodeError, EncodeError, RosidlError
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.bag.output_definitions import guess_mismatch
from rosidl_py_gen.ros_cli.type_resolution import opaque_message_class
from rosidl_py_gen.runtime import Durability, QoSProfile, Reliability, WaitTimeoutError, validate_full_name

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Iterable, Mapping

    from rosidl_py_gen.bags import BagReader, BagTopic
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime import Node, Publisher

_MIN_DEPTH = 10
_ACKNOWLEDGEMENT_TIMEOUT_S = 5.0


def cannot_play_reason(channel: BagTopic) -> str:
    """Return why messages of a channel cannot be published; empty if they can."""
    if channel.message_encoding != "cdr":
        return f"messages are {channel.message_encoding}; expected cdr"
    try:
        validate_full_name(channel.name)
        split_ros_name(channel.type_name, "msg")
    except RosidlError as error:
        return str(error)
    return ""


class TopicPublishers:
    """Publishers of a player.

    Args:
        overrides: QoS profiles by topic of the bag, or by the name it is published with.
    """

    def __init__(self, node: Node, overrides: Mapping[str, QoSProfile], note: terminal_output.OnceNotes) -> None:
        self._node = node
        self._overrides = overrides
        self._note = note
        self._publishers: list[Publisher[Any]] = []

    def sender(self, reader: BagReader, channel: BagTopic, name: str) -> Callable[[bytes], bool]:
        """Return a function that publishes a message of a channel, and returns True if it did."""
        qos = self._overrides.get(channel.name) or self._overrides.get(name) or _offered_qos(channel)
        publisher = self._node.create_publisher(_class_of(reader, channel), name, qos)
        self._publishers.append(publisher)

        def send(data: bytes) -> bool:
            try:
                publisher.publish_raw(data)
            except EncodeError as reason:  # big endian, as recorded by other systems
                try:
                    publisher.publish(reader.definition(channel).message_class.decode(data))
                except (DecodeError, RosidlError):
                    self._note(f"{channel.name}: skipped a message: {reason}")
                    return False
            return True

        return send

    async def wait_for_subscribers(self, timeout_s: float) -> None:
        """Wait until every topic has a subscriber, or the timeout has passed."""
        await wait_each_until_timeout(publisher.wait_for_subscribers(timeout_s) for publisher in self._publishers)

    async def wait_acknowledged(self, timeout_ms: int | None) -> None:
        """Wait until published messages are acknowledged; None waits 5 s at most, 0 without limit.

        With a limit of the user, missing acknowledgements are noted.
        """
        if timeout_ms is None:
            await wait_each_until_timeout(
                publisher.wait_for_acknowledged(_ACKNOWLEDGEMENT_TIMEOUT_S) for publisher in self._publishers
            )
            return
        for publisher in self._publishers:
            if publisher.qos.reliability is Reliability.BEST_EFFORT:
                terminal_output.note(
                    f"--wait-for-all-acked: {publisher.topic} is best effort, without acknowledgements"
                )
        timeout_s = timeout_ms / 1000 if timeout_ms else None
        waits = (publisher.wait_for_acknowledged(timeout_s) for publisher in self._publishers)
        for timed_out in await wait_each_until_timeout(waits):
            terminal_output.note(f"--wait-for-all-acked: {timed_out}")


async def wait_each_until_timeout(waits: Iterable[Awaitable[object]]) -> list[WaitTimeoutError]:
    """Wait for all awaitables; return the errors of those that timed out."""
    timed_out = []
    for outcome in await asyncio.gather(*waits, return_exceptions=True):
        if isinstance(outcome, WaitTimeoutError):
            timed_out.append(outcome)
        elif isinstance(outcome, BaseException):
            raise outcome
    return timed_out


def _class_of(reader: BagReader, channel: BagTopic) -> type[Message]:
    """Return the class of a channel; a class without fields if its definition is missing or wrong."""
    if reason := guess_mismatch(reader, channel):
        terminal_output.note(reason)
        return opaque_message_class(channel.type_name, channel.type_hash)
    try:
        return reader.definition(channel).message_class
    except RosidlError:
        return opaque_message_class(channel.type_name, channel.type_hash)


def _offered_qos(topic: BagTopic) -> QoSProfile:
    """Return the QoS of a topic, with a depth of at least 10, as recorders often do not know it."""
    offered = qos_profiles(topic.offered_qos)
    profile = QoSProfile(depth=max(_MIN_DEPTH, *(publisher.depth for publisher in offered)) if offered else _MIN_DEPTH)
    if offered and all(publisher.reliability is Reliability.BEST_EFFORT for publisher in offered):
        profile = profile.best_effort()
    if any(publisher.durability is Durability.TRANSIENT_LOCAL for publisher in offered):
        profile = profile.transient_local()
    return profile
