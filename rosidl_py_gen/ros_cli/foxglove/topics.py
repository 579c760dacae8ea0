"""Topics in the form in which viewers see them: a channel for each topic and type, with the bytes received from ROS.

A topic is subscribed to only while a viewer watches it, with the QoS that all publishers offer. The subscription is
recreated when a publisher appears that offers less, and, for transient local publishers, for each further viewer.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen import type_hash
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import terminal_output, type_resolution
from rosidl_py_gen.ros_cli.foxglove.keyed_tasks import KeyedTasks
from rosidl_py_gen.ros_cli.name_lookup import is_hidden
from rosidl_py_gen.runtime import AdaptiveSubscription, Durability
from rosidl_py_gen.type_loading.from_description import definition_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.foxglove.server import Server
    from rosidl_py_gen.ros_cli.foxglove.viewer import AdvertisedChannel
    from rosidl_py_gen.runtime import TopicEndpointInfo


class _Key(NamedTuple):
    topic: str
    type_name: str


class _WatchedTopic:
    def __init__(self, channel: AdvertisedChannel, cls: type[Message] | None) -> None:
        self.channel = channel
        self.cls = cls
        """Message class with the name and hash of the definition that viewers receive; None if the definition is
        unknown."""
        self.subscription: AdaptiveSubscription[bytes] | None = None
        self.viewers: frozenset[int] = frozenset()
        self.has_failed = False
        """True if subscribing to the topic failed; it is retried when a further viewer watches the topic."""

    def unsubscribe(self) -> None:
        if self.subscription is not None:
            self.subscription.close()
            self.subscription = None


class TopicBridge:
    """Bridge that advertises the topics of the graph to viewers; call `refresh` after each change of the graph."""

    def __init__(
        self,
        command_node: CommandNode,
        server: Server,
        now_ns: Callable[[], int],
        *,
        paths: Sequence[str],
        hidden: bool,
    ) -> None:
        self._command_node = command_node
        self._node = command_node.node
        self._server = server
        self._now_ns = now_ns
        self._paths = paths
        self._hidden = hidden
        self._topics: dict[_Key, _WatchedTopic] = {}
        self._tasks = KeyedTasks(self._show)

    def refresh(self) -> None:
        """Advertise new topics of the graph to viewers, and withdraw topics that have disappeared."""
        self._tasks.update(self._current())
        self.update_subscriptions()

    def _current(self) -> set[_Key]:
        """Return name and type of each topic on which another participant has an endpoint."""
        return {
            _Key(topic, one.topic_type)
            for topic, _ in self._node.get_topic_names_and_types()
            if self._hidden or not is_hidden(topic)
            for one in self._others(topic)
        }

    def _others(self, topic: str) -> list[TopicEndpointInfo]:
        """Return the endpoints of a topic that belong to other participants than the command's own, without waiting for
        node names.
        """
        node = self._node
        infos = [*node.get_publishers_info_by_topic(topic), *node.get_subscriptions_info_by_topic(topic)]
        own = {one.guid for one in node.context.participants() if one.is_own}
        return [one for one in infos if one.participant_guid not in own]

    async def _show(self, key: _Key) -> None:
        async with self._tasks.limiter:
            text, cls = await self._definition(key)
        topic = self._topics[key] = _WatchedTopic(self._server.open_channel(key.topic, key.type_name, text), cls)
        try:
            await asyncio.Event().wait()  # until the topic has disappeared
        finally:
            del self._topics[key]
            topic.unsubscribe()
            self._server.close_channel(topic.channel)

    async def _definition(self, key: _Key) -> tuple[str, type[Message] | None]:
        try:
            cls = await type_resolution.interface_class(
                self._command_node, "topic", key.topic, key.type_name, self._paths
            )
            text = await asyncio.to_thread(definition_text, cls)
            return text, type_resolution.opaque_message_class(key.type_name, type_hash(cls))
        except RosidlError as error:
            terminal_output.note(
                f"{key.topic}: viewers cannot decode it, because the definition of {key.type_name} is unknown: {error}"
            )
            return "", None

    def update_subscriptions(self) -> None:
        """Create or update the subscriptions of topics that viewers watch, and close all other subscriptions."""
        for key, entry in self._topics.items():
            before, entry.viewers = entry.viewers, entry.channel.viewers
            has_newcomer = bool(entry.viewers - before)
            if not entry.viewers:
                entry.unsubscribe()
            elif has_newcomer or not entry.has_failed:
                self._update_subscription(key, entry, has_newcomer)

    def _update_subscription(self, key: _Key, entry: _WatchedTopic, has_newcomer: bool) -> None:
        entry.has_failed = False
        try:
            if entry.subscription is None:
                entry.subscription = self._subscribe(key, entry)
            elif has_newcomer and entry.subscription.qos.durability is Durability.TRANSIENT_LOCAL:
                entry.subscription.resubscribe()
            else:
                entry.subscription.refresh()
        except RosidlError as error:  # the name or type is invalid in ROS
            entry.has_failed = True
            entry.unsubscribe()
            self._server.send_control(key.topic, f"{key.topic} cannot be read: {error}")

    def _subscribe(self, key: _Key, entry: _WatchedTopic) -> AdaptiveSubscription[bytes]:
        send, now_ns = entry.channel.send, self._now_ns
        cls = entry.cls or type_resolution.opaque_class(self._command_node, key.topic, key.type_name)
        return AdaptiveSubscription(self._node, key.topic, cls, lambda data: send(data, now_ns()), raw=True)

    async def close(self) -> None:
        """Withdraw all topics from viewers, and close the subscriptions."""
        await self._tasks.close()
