"""Publishing of messages that viewers send.

Every message is decoded before it is published: a message that is not of the topic's type is refused, and the viewer is
sent the name of the wrong field. The type is the announced type of the topic. For a new topic, it is the type that the
viewer names, which is known here or defined by the viewer. An unknown type may belong to a node that is not discovered
yet, so the node is awaited as in other commands.
"""

from __future__ import annotations

import asyncio
import hashlib
from collections import deque
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import Message, compile_definition, encode, get_message
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.errors import RosidlError, TypeNotFoundError, printable
from rosidl_py_gen.ros_cli import type_resolution
from rosidl_py_gen.ros_cli.command_support import CommandError
from rosidl_py_gen.ros_cli.foxglove import limits
from rosidl_py_gen.ros_cli.foxglove.decoding import Decoder, Worker
from rosidl_py_gen.ros_cli.foxglove.keyed_tasks import KeyedTasks
from rosidl_py_gen.ros_cli.name_lookup import full_name
from rosidl_py_gen.runtime import WaitTimeoutError
from rosidl_py_gen.runtime.qos import BEST_AVAILABLE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.ros_cli.command_node import CommandNode
    from rosidl_py_gen.ros_cli.foxglove.protocol import ClientAdvertisement
    from rosidl_py_gen.ros_cli.foxglove.server import Server
    from rosidl_py_gen.ros_cli.foxglove.viewer import ClientChannelKey
    from rosidl_py_gen.runtime import Publisher

_ENCODINGS = ("cdr", "json")


_Key = tuple["ClientChannelKey", "ClientAdvertisement"]


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
        self._publishers: dict[_Key, _ClientPublisher] = {}
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

    async def _serve(self, key: _Key) -> None:
        client, offer = self._publishers[key], key[1]
        try:
            topic = full_name(self._command_node.node, offer.topic)
            cls = await self._class(topic, offer)
            client.decoder = Decoder(cls, offer.encoding)
            client.publisher = self._command_node.node.create_publisher(cls, topic, BEST_AVAILABLE)
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
        name = str(split_ros_name(offer.schema_name, "msg"))
        if not self._has_type(topic, name):
            try:
                return await self._compiling.run(lambda: get_message(name, path=self._paths))
            except TypeNotFoundError:
                if offer.schema_encoding == "ros2msg":
                    return await self._compiling.run(self._compiled_class, name, offer.schema)
                if not await self._command_node.wait_for(lambda: self._has_type(topic, name)):
                    raise
        cls: type[Message] = await type_resolution.interface_class(
            self._command_node, "topic", topic, name, self._paths
        )
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
