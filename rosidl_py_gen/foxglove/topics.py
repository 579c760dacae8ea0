"""Topics that viewers watch, with the bytes received from ROS, and messages that viewers publish.

A channel is shown for each topic and type. A topic is subscribed to only while a viewer watches it, with the QoS that
all publishers offer. The subscription is recreated when a publisher appears that offers less, and, for transient local
publishers, for each further viewer.

Every message of a viewer is decoded before it is published: a message that is not of the topic's type is refused, and
the viewer is sent the name of the wrong field. The type is the announced type of the topic. For a new topic, it is the
type that the viewer names, which is known here or defined by the viewer. An unknown type may belong to a node that is
not discovered yet, so the node is awaited as in other commands.
"""

from __future__ import annotations

import asyncio
import hashlib
from collections import deque
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen import Message, compile_definition, encode, get_message, type_hash
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.cdr.message import opaque_message_class
from rosidl_py_gen.command_support import (
    CommandError,
    interface_class,
    opaque_class,
    terminal_output,
)
from rosidl_py_gen.errors import RosidlError, TypeNotFoundError, printable
from rosidl_py_gen.foxglove import limits
from rosidl_py_gen.foxglove.tasks import Decoder, KeyedTasks, Worker
from rosidl_py_gen.runtime import AdaptiveSubscription, Durability, WaitTimeoutError, qos
from rosidl_py_gen.type_loading import definition_text

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.foxglove.protocol import ClientAdvertisement
    from rosidl_py_gen.foxglove.server import AdvertisedChannel, ClientChannelKey, Server
    from rosidl_py_gen.runtime import Publisher, TopicEndpointInfo


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
            if self._hidden or not self._command_node.is_hidden(topic)
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
            cls = await interface_class(self._command_node, "topic", key.topic, key.type_name, self._paths)
            text = await asyncio.to_thread(definition_text, cls)
            return text, opaque_message_class(key.type_name, type_hash(cls))
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
        cls = entry.cls or opaque_class(self._command_node, key.topic, key.type_name)
        return AdaptiveSubscription(self._node, key.topic, cls, lambda data: send(data, now_ns()), raw=True)

    async def close(self) -> None:
        """Withdraw all topics from viewers, and close the subscriptions."""
        await self._tasks.close()


_ENCODINGS = ("cdr", "json")


_ClientKey = tuple["ClientChannelKey", "ClientAdvertisement"]


class _ClientPublisher:
    def __init__(self) -> None:
        self.has_failed = False
        self.decoder: Decoder | None = None
        self.publisher: Publisher[Any] | None = None
        self.waiting: deque[bytes] = deque()
        self.lock = asyncio.Lock()
        """Lock that is held while a message of the viewer is decoded and published, so that messages stay in order."""


class ClientPublishing:
    """Publishers for viewers; call `update_publishers` after each change of the topics that viewers publish on."""

    def __init__(self, command_node: CommandNode, server: Server, *, paths: Sequence[str]) -> None:
        self._command_node = command_node
        self._server = server
        self._paths = paths
        self._publishers: dict[_ClientKey, _ClientPublisher] = {}
        self._tasks = KeyedTasks(self._serve)
        self._compiled: dict[tuple[str, bytes], type[Any]] = {}
        """Classes of viewers' definitions by type name and hash of the definition; the classes are never freed."""
        self._compiled_bytes = 0
        self._compiling, self._decoding = Worker(), Worker()

    def update_publishers(self) -> None:
        """Create publishers for topics that viewers have advertised, and close publishers of withdrawn topics."""
        offers = self._server.offers.items()
        self._publishers = {key: self._publishers.get(key) or _ClientPublisher() for key in offers}
        self._tasks.update(offers)

    async def publish_from_viewer(self, key: ClientChannelKey, data: bytes) -> None:
        """Publish a message of a viewer now, or when the type of its topic is known."""
        offer = self._server.offers[key]
        if (key, offer) not in self._publishers:  # it was advertised just now
            self.update_publishers()
        client = self._publishers[key, offer]
        if client.publisher is not None:
            await self._publish(client, offer.topic, data)
        elif not client.has_failed:
            self._retain(key[0], client, offer.topic, data)

    def _retain(self, viewer: int, client: _ClientPublisher, topic: str, data: bytes) -> None:
        client.waiting.append(data)
        all_waiting = [one.waiting for ((number, _), _), one in self._publishers.items() if number == viewer]
        size = sum(len(one) for waiting in all_waiting for one in waiting)
        while len(client.waiting) > limits.MAX_WAITING or (client.waiting and size > limits.MAX_WAITING_BYTES):
            size -= len(client.waiting.popleft())
            self._server.send_control(
                topic, f"messages for {topic} are dropped: too many arrived before its type was known"
            )

    async def _serve(self, key: _ClientKey) -> None:
        client, offer = self._publishers[key], key[1]
        try:
            topic = self._command_node.full_name(offer.topic)
            cls = await self._class(topic, offer)
            client.decoder = Decoder(cls, offer.encoding)
            client.publisher = self._command_node.node.create_publisher(cls, topic, qos.BEST_AVAILABLE)
        except RosidlError as error:
            client.has_failed = True
            self._server.send_control(offer.topic, f"{offer.topic} cannot be published: {error}")
            return
        with closing(client.publisher):
            timeout_s = 5.0 if self._command_node.node.count_subscribers(topic) else 1.0
            with suppress(WaitTimeoutError):
                await client.publisher.wait_for_subscribers(timeout_s)
            while client.waiting:
                await self._publish(client, offer.topic, client.waiting.popleft())
            await asyncio.Event().wait()  # until the viewer withdraws it

    async def _class(self, topic: str, offer: ClientAdvertisement) -> type[Message]:
        if offer.encoding not in _ENCODINGS:
            raise CommandError(
                f'its encoding is "{printable(offer.encoding)[:40]}"; expected {" or ".join(_ENCODINGS)}'
            )
        name = str(RosName.parse(offer.schema_name, "msg"))
        if not self._has_type(topic, name):
            try:
                return await self._compiling.run(lambda: get_message(name, path=self._paths))
            except TypeNotFoundError:
                if offer.schema_encoding == "ros2msg":
                    return await self._compiling.run(self._compiled_class, name, offer.schema)
                if not await self._command_node.wait_for(lambda: self._has_type(topic, name)):
                    raise
        cls: type[Message] = await interface_class(self._command_node, "topic", topic, name, self._paths)
        return cls

    def _has_type(self, topic: str, name: str) -> bool:
        """Return True if a node announces the topic with type `name`.

        Raises `CommandError` if only other types are announced.
        """
        announced = dict(self._command_node.node.get_topic_names_and_types()).get(topic, [])
        if announced and name not in announced:
            raise CommandError(f"its type is {', '.join(announced)}; expected {name}")
        return bool(announced)

    def _compiled_class(self, name: str, schema: bytes) -> type[Message]:
        """Return the class of a message definition that a viewer has sent; raises `CommandError`. Thread: worker."""
        key = (name, hashlib.sha256(schema).digest())
        if key not in self._compiled:
            count, size = len(self._compiled) + 1, self._compiled_bytes + len(schema)
            if count > limits.MAX_SCHEMAS or size > limits.MAX_SCHEMAS_BYTES:
                raise CommandError(
                    f"viewers have sent too many definitions: {count} ({size} bytes); "
                    f"expected at most {limits.MAX_SCHEMAS} ({limits.MAX_SCHEMAS_BYTES} bytes)"
                )
            self._compiled[key] = compile_definition(name, schema.decode(errors="replace"))
            self._compiled_bytes = size
        cls = self._compiled[key]
        if not issubclass(cls, Message):
            raise CommandError(f"{name} is a service or action; expected a message")
        return cls

    async def _publish(self, client: _ClientPublisher, topic: str, data: bytes) -> None:
        assert client.decoder is not None and client.publisher is not None
        try:
            async with client.lock:
                client.publisher.publish_raw(await client.decoder.run(data, self._decoding, encode))
        except RosidlError as error:
            self._server.send_control(topic, f"a message for {topic} was not published: {error}")

    async def close(self) -> None:
        """Stop the worker threads, and close all publishers."""
        self._compiling.close()
        self._decoding.close()
        await self._tasks.close()
