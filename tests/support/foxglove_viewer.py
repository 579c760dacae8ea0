"""A viewer for tests: the Foxglove WebSocket protocol, as the Foxglove app speaks it, with the library `websockets`.

And a server without anything to see.
"""

from __future__ import annotations

import asyncio
import json
import struct
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING, Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from rosidl_py_gen.foxglove.server import FoxgloveOptions, Handlers, Server

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

PATIENCE_S = 60


class Viewer:
    """Connection of a viewer, and the messages that it received."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.channels: dict[str, dict[str, Any]] = {}
        """Advertised channels by topic."""
        self.services: dict[str, dict[str, Any]] = {}
        self.said: list[dict[str, Any]] = []
        """All JSON messages."""
        self.frames: list[tuple[int, int, bytes]] = []
        """Subscription, time in nanoseconds and data of every message."""
        self.responses: dict[int, bytes] = {}
        self.is_open = True
        self._news = asyncio.Condition()
        self.reading: asyncio.Task[None] | None = None

    async def read(self) -> None:
        """Handle received messages until the server closes."""
        with suppress(ConnectionClosed):
            async for message in self.connection:
                self._take(message)
                async with self._news:
                    self._news.notify_all()
        self.is_open = False
        async with self._news:
            self._news.notify_all()

    def _take(self, message: str | bytes) -> None:
        if isinstance(message, str):
            self._take_json(json.loads(message))
        elif message[0] == 1:
            subscription, time_ns = struct.unpack_from("<IQ", message, 1)
            self.frames.append((subscription, time_ns, message[13:]))
        elif message[0] == 2:
            self.said.append({"op": "time", "time": struct.unpack_from("<Q", message, 1)[0]})
        elif message[0] == 3:
            _, call, length = struct.unpack_from("<III", message, 1)
            self.responses[call] = message[13 + length :]

    def _take_json(self, said: dict[str, Any]) -> None:
        self.said.append(said)
        match said["op"]:
            case "advertise":
                self.channels |= {channel["topic"]: channel for channel in said["channels"]}
            case "unadvertise":
                self.channels = {n: one for n, one in self.channels.items() if one["id"] not in said["channelIds"]}
            case "advertiseServices":
                self.services |= {service["name"]: service for service in said["services"]}
            case "unadvertiseServices":
                self.services = {n: one for n, one in self.services.items() if one["id"] not in said["serviceIds"]}

    async def until(self, condition: Callable[[], Any]) -> Any:
        """Wait until the condition is truthy and return its value."""
        async with self._news:
            await asyncio.wait_for(self._news.wait_for(condition), PATIENCE_S)
        return condition()

    def of(self, op: str) -> list[dict[str, Any]]:
        return [said for said in self.said if said["op"] == op]

    def warnings(self) -> str:
        """Return all status messages as text, without replies to `handled`."""
        return "\n".join(text for text in self._warned() if "assets" not in text)

    async def send(self, op: str, **fields: Any) -> None:
        """Send a JSON message."""
        await self.connection.send(json.dumps({"op": op, **fields}))

    async def subscribe(self, topic: str, subscription: int = 1) -> dict[str, Any]:
        """Wait for the topic, subscribe, return its channel."""
        channel: dict[str, Any] = await self.until(lambda: self.channels.get(topic))
        await self.send("subscribe", subscriptions=[{"id": subscription, "channelId": channel["id"]}])
        await self.handled()
        return channel

    async def handled(self) -> str:
        """Wait until the server has handled the sent messages, and return all status messages."""
        before = len(self.said)
        await self.send("fetchAsset", uri="", requestId=0)  # refused, but in its turn
        await self.until(lambda: any("assets" in text for text in self._warned(before)))
        return self.warnings()

    def _warned(self, since: int = 0) -> list[str]:
        return [said["message"] for said in self.said[since:] if said["op"] == "status"]

    async def offer(self, channel: int, topic: str, type_name: str, encoding: str = "cdr", **fields: Any) -> None:
        """Advertise a channel of our own."""
        told = {"id": channel, "topic": topic, "encoding": encoding, "schemaName": type_name, **fields}
        await self.send("advertise", channels=[told])

    async def publish(self, channel: int, data: bytes) -> None:
        """Send a message on the channel."""
        await self.connection.send(struct.pack("<BI", 1, channel) + data)

    async def call(self, service: str, request: bytes, number: int = 1) -> bytes | str:
        """Call a service; return the response or the error text."""
        known = await self.until(lambda: self.services.get(service))
        await self.connection.send(struct.pack("<BIII", 2, known["id"], number, 3) + b"cdr" + request)

        def failure() -> list[str]:
            return [said["message"] for said in self.of("serviceCallFailure") if said["callId"] == number]

        await self.until(lambda: number in self.responses or failure())
        return self.responses[number] if number in self.responses else failure()[0]

    async def parameters(self, op: str = "getParameters", **fields: Any) -> dict[str, Any]:
        """Get or set parameters, and return the reply."""
        number = f"ask{len(self.said)}"
        await self.send(op, id=number, **fields)
        answer = await self.until(lambda: [one for one in self.of("parameterValues") if one.get("id") == number])
        return {one["name"]: one.get("value") for one in answer[0]["parameters"]}


@asynccontextmanager
async def viewer(address: str, **how: Any) -> AsyncIterator[Viewer]:
    """Connect to ``ws://...``; `how` as for `connect`."""
    protocols: Any = ["foxglove.sdk.v1"]
    connection = await connect(address, subprotocols=protocols, proxy=None, max_size=None, **how)
    made = Viewer(connection)
    made.reading = asyncio.ensure_future(made.read())
    try:
        yield made
    finally:
        made.reading.cancel()
        await asyncio.gather(made.reading, return_exceptions=True)
        with suppress(AttributeError):  # asyncio's, for a transport that was closed while much was to be written
            await connection.close()


def foxglove_options(**settings: Any) -> FoxgloveOptions:
    """Return options for a server in the process of the test."""
    usual: dict[str, Any] = {"host": "127.0.0.1", "port": 0, "is_read_only": False, "origins": (), "token": ""}
    usual |= {"max_mib": 1, "per_s": 1000, "use_sim_time": False, "queue": 256, "hidden": False}
    return FoxgloveOptions(**usual | settings)


@asynccontextmanager
async def served(**settings: Any) -> AsyncIterator[tuple[Server, str]]:
    """Start a server with these options, and yield it with its address."""

    async def nothing(*_: Any) -> dict[str, Any]:
        return {}

    async def publish(*_: Any) -> None:
        pass

    server = Server(foxglove_options(**settings))
    handlers = Handlers(lambda: None, publish, nothing, nothing)
    port = await server.start(handlers, has_time=False)
    try:
        yield server, f"ws://127.0.0.1:{port}"
    finally:
        await server.stop()
