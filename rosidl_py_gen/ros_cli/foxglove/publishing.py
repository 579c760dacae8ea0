"""What viewers publish.

Decides that every message is decoded before it goes to ROS: what is no message of the topic's type is refused, and the
viewers are told which field is wrong. The type is the one that is announced for the topic; for a topic that nobody has
it is the one the viewer names, known here or defined by the viewer. A type that is neither may belong to a node that is
not found yet, so it is waited for as what users name in commands is.
"""

from __future__ import annotations

import asyncio
import hashlib
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import Message, compile_definition, encode, get_message
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.errors import RosidlError, TypeNotFoundError, printable
from rosidl_py_gen.ros_cli import ToolError, types
from rosidl_py_gen.ros_cli.foxglove import limits
from rosidl_py_gen.ros_cli.foxglove.decoding import Decoder, Worker
from rosidl_py_gen.ros_cli.name_lookup import full_topic_name
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


class _ClientPublisher:
    """A topic that a viewer publishes on, or soon will."""

    def __init__(self, offer: ClientAdvertisement) -> None:
        self.offer = offer
        self.opening: asyncio.Task[None] | None = None
        self.decoder: Decoder | None = None
        self.publisher: Publisher[Any] | None = None
        self.waiting: deque[bytes] = deque()
        self.turn = asyncio.Lock()
        """Messages are decoded and published in order."""

    def close(self) -> None:
        if self.opening is not None:
            self.opening.cancel()
        if self.publisher is not None:
            self.publisher.close()


class ClientPublishing:
    """Publishes what viewers send: `serve` after they offer something else, `take` with each message."""

    def __init__(self, session: CommandNode, server: Server, *, paths: Sequence[str]) -> None:
        self._session = session
        self._server = server
        self._paths = paths
        self._offered: dict[ClientChannelKey, _ClientPublisher] = {}
        self._compiled: dict[tuple[str, bytes], type[Any]] = {}
        """Classes by name and hash of the schema; they stay."""
        self._compiled_bytes = 0
        self._compiling, self._decoding = Worker(), Worker()

    def serve(self) -> None:
        """Follow what viewers offer."""
        offers = self._server.offers
        for key in [*self._offered]:
            if offers.get(key) is not self._offered[key].offer:
                self._offered.pop(key).close()
        for key, offer in offers.items():
            if key not in self._offered:
                offered = self._offered[key] = _ClientPublisher(offer)
                offered.opening = asyncio.ensure_future(self._open(offered))

    async def take(self, key: ClientChannelKey, data: bytes) -> None:
        """Publish what a viewer sent, now or when its type is known."""
        offered = self._offered.get(key)
        if offered is None or offered.offer is not self._server.offers[key]:  # it was offered in this moment
            self.serve()
            offered = self._offered[key]
        if offered.publisher is not None:
            await self._publish(offered, data)
        elif offered.opening is not None and not offered.opening.done():
            self._retain(key[0], offered, data)

    def _retain(self, viewer: int, offered: _ClientPublisher, data: bytes) -> None:
        offered.waiting.append(data)
        all_waiting = [one.waiting for key, one in self._offered.items() if key[0] == viewer]
        size = sum(len(one) for waiting in all_waiting for one in waiting)
        while len(offered.waiting) > limits.MAX_WAITING or (offered.waiting and size > limits.MAX_WAITING_BYTES):
            size -= len(offered.waiting.popleft())
            topic = offered.offer.topic
            self._server.send_control(
                topic, f"messages for {topic} are left out: too many came before its type was known"
            )

    async def _open(self, offered: _ClientPublisher) -> None:
        offer = offered.offer
        try:
            topic = full_topic_name(self._session, offer.topic)
            cls = await self._class(topic, offer)
            offered.decoder = Decoder(cls, offer.encoding)
            offered.publisher = self._session.node.create_publisher(cls, topic, BEST_AVAILABLE)
            patience_s = 5.0 if self._session.node.count_subscribers(topic) else 1.0
            with suppress(WaitTimeoutError):
                await offered.publisher.wait_for_subscribers(patience_s)
        except RosidlError as error:
            self._server.send_control(offer.topic, f"{offer.topic} cannot be published: {error}")
            return
        while offered.waiting:
            await self._publish(offered, offered.waiting.popleft())

    async def _class(self, topic: str, offer: ClientAdvertisement) -> type[Message]:
        if offer.encoding not in _ENCODINGS:
            raise ToolError(f'its encoding is "{printable(offer.encoding)[:40]}", not {" or ".join(_ENCODINGS)}')
        name = str(split_ros_name(offer.schema_name, "msg"))
        if self._is_there(topic, name):
            return await types.message_class(self._session, topic, name, self._paths)
        try:
            return await self._compiling.run(lambda: get_message(name, path=self._paths))
        except TypeNotFoundError:
            if offer.schema_encoding == "ros2msg":
                return await self._compile(name, offer.schema)
            if not await self._session.wait_for(lambda: self._is_there(topic, name)):
                raise
        return await types.message_class(self._session, topic, name, self._paths)

    def _is_there(self, topic: str, name: str) -> bool:
        """Whether somebody has the topic with this type.

        Raises:
            ToolError: it has another one.
        """
        there = dict(self._session.node.get_topic_names_and_types()).get(topic, [])
        if there and name not in there:
            raise ToolError(f"its type is {', '.join(there)}, not {name}")
        return bool(there)

    async def _compile(self, name: str, schema: bytes) -> type[Message]:
        cls = await self._compiling.run(self._compiled_class, name, schema)
        if not issubclass(cls, Message):
            raise ToolError(f"{name} is a service or action, not a message")
        return cls

    def _compiled_class(self, name: str, schema: bytes) -> type[Any]:
        """Return the class of a definition; runs in the thread that compiles, one definition after another."""
        key = (name, hashlib.sha256(schema).digest())
        if key not in self._compiled:
            count, size = len(self._compiled) + 1, self._compiled_bytes + len(schema)
            if count > limits.MAX_SCHEMAS or size > limits.MAX_SCHEMAS_BYTES:
                most = f"at most {limits.MAX_SCHEMAS} types of {limits.MAX_SCHEMAS_BYTES} bytes are read from viewers"
                raise ToolError(f"with its definition there would be {count} types of {size} bytes; {most}")
            self._compiled[key] = compile_definition(name, schema.decode(errors="replace"))
            self._compiled_bytes = size
        return self._compiled[key]

    async def _publish(self, offered: _ClientPublisher, data: bytes) -> None:
        assert offered.decoder is not None and offered.publisher is not None
        topic = offered.offer.topic
        try:
            async with offered.turn:
                offered.publisher.publish_raw(await offered.decoder.run(data, self._decoding, encode))
        except RosidlError as error:
            self._server.send_control(topic, f"a message for {topic} was not published: {error}")

    async def close(self) -> None:
        """Let go of everything."""
        opening = [offered.opening for offered in self._offered.values() if offered.opening is not None]
        for offered in self._offered.values():
            offered.close()
        self._offered.clear()
        self._compiling.close()
        self._decoding.close()
        await asyncio.gather(*opening, return_exceptions=True)
