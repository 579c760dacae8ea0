"""What viewers publish.

Decides that every message is decoded before it goes to ROS: what is no message of the topic's type is refused, and the
viewers are told which field is wrong. The type is the one that is announced for the topic; for a topic that nobody has
it is the one the viewer names, known here or defined by the viewer. A type that is neither may belong to a node that is
not found yet, so it is waited for as what users name in commands is.
"""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import Message, compile_text, decode, from_json, get_message
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.errors import RosidlError, TypeNotFoundError, printable
from rosidl_py_gen.runtime import WaitTimeoutError
from rosidl_py_gen.runtime.qos import BEST_AVAILABLE
from rosidl_py_gen.tools import ToolError, types
from rosidl_py_gen.tools.names import full_topic_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.runtime import Publisher
    from rosidl_py_gen.tools.foxglove.protocol import Offer
    from rosidl_py_gen.tools.foxglove.server import Server
    from rosidl_py_gen.tools.foxglove.viewer import OfferKey
    from rosidl_py_gen.tools.session import Session

_ENCODINGS = ("cdr", "json")
_MAX_WAITING = 10
_MAX_WAITING_BYTES = 1 << 20
"""Of messages that come before the type of their topic is known."""
_MAX_SCHEMA_BYTES = 1 << 18
"""Of the definition of one type; a class takes a second for each 64 KiB, in a thread that the loop competes with."""
_MAX_SCHEMAS = 256
"""Of viewers, that become classes: these stay for good."""


class _Offered:
    """A topic that a viewer publishes on, or soon will."""

    def __init__(self, offer: Offer) -> None:
        self.offer = offer
        self.opening: asyncio.Task[None] | None = None
        self.cls: type[Message] | None = None
        self.publisher: Publisher[Any] | None = None
        self.waiting: deque[bytes] = deque()

    def close(self) -> None:
        if self.opening is not None:
            self.opening.cancel()
        if self.publisher is not None:
            self.publisher.close()


class Publishing:
    """Publishes what viewers send: `serve` after they offer something else, `take` with each message."""

    def __init__(self, session: Session, server: Server, *, paths: Sequence[str]) -> None:
        self._session = session
        self._server = server
        self._paths = paths
        self._offered: dict[OfferKey, _Offered] = {}
        self._compiled: set[int] = set()
        """Hashes of names and schemas."""

    def serve(self) -> None:
        """Follow what viewers offer."""
        offers = self._server.offers
        for key in [*self._offered]:
            if offers.get(key) is not self._offered[key].offer:
                self._offered.pop(key).close()
        for key, offer in offers.items():
            if key not in self._offered:
                offered = self._offered[key] = _Offered(offer)
                offered.opening = asyncio.ensure_future(self._open(offered))

    def take(self, key: OfferKey, data: bytes) -> None:
        """Publish what a viewer sent, now or when its type is known."""
        offered = self._offered.get(key)
        if offered is None or offered.offer is not self._server.offers[key]:  # it was offered in this moment
            self.serve()
            offered = self._offered[key]
        if offered.publisher is not None:
            self._publish(offered, data)
        elif offered.opening is not None and not offered.opening.done():
            offered.waiting.append(data)
            while len(offered.waiting) > _MAX_WAITING or sum(map(len, offered.waiting)) > _MAX_WAITING_BYTES:
                offered.waiting.popleft()

    async def _open(self, offered: _Offered) -> None:
        offer = offered.offer
        try:
            topic = full_topic_name(self._session, offer.topic)
            offered.cls = await self._class(topic, offer)
            offered.publisher = self._session.node.create_publisher(offered.cls, topic, BEST_AVAILABLE)
            patience_s = 5.0 if self._session.node.count_subscribers(topic) else 1.0
            with suppress(WaitTimeoutError):
                await offered.publisher.wait_for_subscribers(patience_s)
        except RosidlError as error:
            self._server.tell(offer.topic, f"{offer.topic} cannot be published: {error}")
            return
        while offered.waiting:
            self._publish(offered, offered.waiting.popleft())

    async def _class(self, topic: str, offer: Offer) -> type[Message]:
        if offer.encoding not in _ENCODINGS:
            raise ToolError(f'its encoding is "{printable(offer.encoding)[:40]}", not {" or ".join(_ENCODINGS)}')
        name = str(split_ros_name(offer.schema_name, "msg"))
        if self._is_there(topic, name):
            return await types.message_class(self._session, topic, name, self._paths)
        try:
            return await asyncio.to_thread(get_message, name, path=self._paths)
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
        if len(schema) > _MAX_SCHEMA_BYTES:
            raise ToolError(f"its definition has {len(schema)} bytes, at most {_MAX_SCHEMA_BYTES} are read")
        known = hash((name, schema))
        if known not in self._compiled and len(self._compiled) >= _MAX_SCHEMAS:
            raise ToolError(f"viewers have defined {_MAX_SCHEMAS} types already, and there is no room for more")
        self._compiled.add(known)
        try:
            cls: type[Message] = await asyncio.to_thread(compile_text, name, schema.decode(errors="replace"))
        except RosidlError:  # there is no class
            self._compiled.discard(known)
            raise
        if not issubclass(cls, Message):
            raise ToolError(f"{name} is a service or action, not a message")
        return cls

    def _publish(self, offered: _Offered, data: bytes) -> None:
        assert offered.cls is not None and offered.publisher is not None
        offer, cls = offered.offer, offered.cls
        try:
            if offer.encoding == "json":
                message = from_json(cls, data)
            elif cls._TYPE.fields:
                message = decode(cls, data)
            else:  # what viewers send as a message without fields is not always what ROS sends
                message = cls()
            offered.publisher.publish(message)
        except RosidlError as error:
            self._server.tell(offer.topic, f"a message for {offer.topic} was not published: {error}")

    async def close(self) -> None:
        """Let go of everything."""
        opening = [offered.opening for offered in self._offered.values() if offered.opening is not None]
        for offered in self._offered.values():
            offered.close()
        self._offered.clear()
        await asyncio.gather(*opening, return_exceptions=True)
