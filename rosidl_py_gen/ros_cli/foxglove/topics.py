"""Topics as viewers see them: one channel for each topic and type, with the bytes that come from ROS.

Decides which topics are shown, and that one is subscribed to only while somebody watches, with what all its publishers
offer. A subscription is made again when a publisher appears that offers less, and, where publishers keep messages for
those who come late, when a further viewer comes.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import terminal_output, types
from rosidl_py_gen.ros_cli.name_lookup import is_hidden
from rosidl_py_gen.runtime import AdaptiveSubscription, Durability
from rosidl_py_gen.type_loading.from_description import definition_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.foxglove.clock import ViewerClock
    from rosidl_py_gen.ros_cli.foxglove.server import Server
    from rosidl_py_gen.ros_cli.foxglove.viewer import AdvertisedChannel
    from rosidl_py_gen.runtime import TopicEndpointInfo

_AT_A_TIME = 8
"""Definitions that are looked for."""


class _Key(NamedTuple):
    topic: str
    type_name: str


class _AdvertisedTopic:
    """A topic that viewers see, or soon will."""

    def __init__(self) -> None:
        self.opening: asyncio.Task[None] | None = None
        self.channel: AdvertisedChannel | None = None
        self.followed: AdaptiveSubscription[bytes] | None = None
        self.viewers: frozenset[int] = frozenset()
        self.has_failed = False
        """To subscribe; tried again for the next viewer."""

    def unsubscribe(self) -> None:
        if self.followed is not None:
            self.followed.close()
            self.followed = None

    def end(self) -> None:
        if self.opening is not None:
            self.opening.cancel()
        self.unsubscribe()


class TopicBridge:
    """Keeps what viewers see like what there is: `refresh` after changes of the graph, `serve` after those of
    viewers.
    """

    def __init__(
        self, session: CommandNode, server: Server, clock: ViewerClock, *, paths: Sequence[str], hidden: bool
    ) -> None:
        self._session = session
        self._node = session.node
        self._server = server
        self._clock = clock
        self._paths = paths
        self._hidden = hidden
        self._shown: dict[_Key, _AdvertisedTopic] = {}
        self._turns = asyncio.Semaphore(_AT_A_TIME)

    def refresh(self) -> None:
        """Follow the graph."""
        there = self._there()
        for key in [*self._shown]:
            if key not in there:
                self._close(self._shown.pop(key))
        for key in there:
            if key not in self._shown:
                shown = self._shown[key] = _AdvertisedTopic()
                shown.opening = asyncio.ensure_future(self._open(key, shown))
        self.serve()

    def _there(self) -> set[_Key]:
        """What others than we have."""
        return {
            _Key(topic, one.topic_type)
            for topic, _ in self._node.get_topic_names_and_types()
            if self._hidden or not is_hidden(topic)
            for one in self._others(topic)
        }

    def _others(self, topic: str) -> list[TopicEndpointInfo]:
        """By participant: names of nodes come later than endpoints, and others may have ours."""
        node = self._node
        infos = [*node.get_publishers_info_by_topic(topic), *node.get_subscriptions_info_by_topic(topic)]
        own = {one.guid for one in node.context.participants() if one.is_own}
        return [one for one in infos if one.participant_guid not in own]

    async def _open(self, key: _Key, shown: _AdvertisedTopic) -> None:
        async with self._turns:
            text = await self._definition(key)
        shown.channel = self._server.open_channel(key.topic, key.type_name, text)

    def _close(self, shown: _AdvertisedTopic) -> None:
        shown.end()
        if shown.channel is not None:
            self._server.close_channel(shown.channel)

    async def _definition(self, key: _Key) -> str:
        """Empty when it cannot be found: the topic is seen, but not what is in it."""
        try:
            cls = await types.message_class(self._session, key.topic, key.type_name, self._paths)
            return await asyncio.to_thread(definition_text, cls)
        except RosidlError as error:
            terminal_output.note(
                f"{key.topic}: viewers cannot read it, as there is no definition of {key.type_name}: {error}"
            )
            return ""

    def serve(self) -> None:
        """Subscribe to what is watched, with what its publishers offer now, and to nothing else."""
        for key, shown in self._shown.items():
            before, shown.viewers = shown.viewers, shown.channel.viewers if shown.channel else frozenset()
            has_newcomer = bool(shown.viewers - before)
            if not shown.viewers:
                shown.unsubscribe()
            elif has_newcomer or not shown.has_failed:
                self._follow(key, shown, has_newcomer)

    def _follow(self, key: _Key, shown: _AdvertisedTopic, has_newcomer: bool) -> None:
        shown.has_failed = False
        try:
            if shown.followed is None:
                shown.followed = self._subscribed(key, shown)
            elif has_newcomer and shown.followed.qos.durability is Durability.TRANSIENT_LOCAL:
                shown.followed.resubscribe()
            else:
                shown.followed.refresh()
        except RosidlError as error:  # a name or type that is none of ROS
            shown.has_failed = True
            shown.unsubscribe()
            self._server.send_control(key.topic, f"{key.topic} cannot be read: {error}")

    def _subscribed(self, key: _Key, shown: _AdvertisedTopic) -> AdaptiveSubscription[bytes]:
        assert shown.channel is not None
        send, now_ns = shown.channel.send, self._clock.now_ns
        cls = types.opaque_class(self._session, key.topic, key.type_name)
        return AdaptiveSubscription(self._node, key.topic, cls, lambda data: send(data, now_ns()), raw=True)

    async def close(self) -> None:
        """Let go of everything."""
        tasks = [shown.opening for shown in self._shown.values() if shown.opening is not None]
        for shown in self._shown.values():
            shown.end()
        self._shown.clear()
        await asyncio.gather(*tasks, return_exceptions=True)
