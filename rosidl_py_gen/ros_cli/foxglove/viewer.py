"""Connection to a viewer of ``foxglove``: its queues, subscriptions and requests.

The costs of a viewer are limited. Of waiting messages of topics, the oldest are dropped. Other messages to a viewer are
never dropped: a viewer that does not read them is disconnected. Messages of the viewer are handled at a pace that
depends on the time they take, and the data that the server retains for the viewer are limited by number and size.
"""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple

from websockets.exceptions import ConnectionClosed

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli.foxglove import limits, protocol
from rosidl_py_gen.ros_cli.foxglove.protocol import (
    ClientAdvertisement,
    ClientMessage,
    ProtocolError,
    ServiceCallRequest,
)

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from websockets.asyncio.server import ServerConnection

    from rosidl_py_gen.ros_cli.foxglove.server import Server

ClientChannelKey = tuple[int, int]
"""Id of a viewer, and the id by which the viewer names a channel."""


@dataclass(slots=True)
class Handlers:
    """Functions that connections of viewers call.

    Attributes:
        refresh: called after subscriptions or advertised topics of a viewer have changed.
        publish: publishes a message of a viewer on a topic that the viewer has advertised.
        get: returns values of parameters by name, of all parameters if the list of names is empty.
        set: sets parameters by name, and returns their values afterwards.
    """

    refresh: Callable[[], None]
    publish: Callable[[ClientChannelKey, bytes], Awaitable[None]]
    get: Callable[[list[str]], Awaitable[dict[str, Any]]]
    set: Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]


class AdvertisedChannel:
    """Topic as viewers see it: the `advertisement` sent to all viewers, and the viewers that watch the topic."""

    def __init__(self, advertisement: dict[str, Any]) -> None:
        self.advertisement = advertisement
        self.watchers: dict[Viewer, int] = {}
        """Ids of the subscriptions to the topic, by the viewer that watches it."""

    @property
    def viewers(self) -> frozenset[int]:
        """Ids of the viewers that watch the topic."""
        return frozenset(viewer.number for viewer in self.watchers)

    def send(self, data: bytes, time_ns: int) -> None:
        """Queue a message for every viewer that watches the topic; a slow viewer loses its oldest message."""
        for viewer, subscription in self.watchers.items():
            viewer.send(subscription, time_ns, data)

    def close(self) -> None:
        """End the subscriptions of all viewers to the topic."""
        for viewer, subscription in self.watchers.items():
            del viewer.watched[subscription]
        self.watchers.clear()


class AdvertisedService(NamedTuple):
    """Service as viewers see it, with the function that handles CDR requests."""

    advertisement: dict[str, Any]
    call: Callable[[bytes], Awaitable[bytes]]


class RateLimit:
    """Limit of the messages read from a viewer: `per_s` messages per second, with bursts of up to `per_s` messages.

    If a viewer sends faster, its messages are read more slowly, so that it has to wait; no message is lost.
    """

    def __init__(self, per_s: int) -> None:
        self._per_s = per_s
        self._left = float(per_s)
        self._at = monotonic()

    def wait_s(self) -> float:
        """Count a message; return the time to wait before reading the next one, in seconds."""
        now = monotonic()
        self._left = min(self._per_s, self._left + (now - self._at) * self._per_s) - 1
        self._at = now
        return max(0.0, -self._left / self._per_s)


class Viewer:
    """Connection to a viewer; `number` is the id of the viewer."""

    def __init__(self, connection: ServerConnection, server: Server, number: int) -> None:
        self._connection = connection
        self._server = server
        self._handlers = server.handlers
        self.number = number
        self._control: deque[str | bytes] = deque()
        self._control_bytes = 0
        self._messages: deque[tuple[int, int, bytes]] = deque()
        """Queued messages of topics: subscription id, time in ns, and data that all viewers share."""
        self._message_bytes = 0
        self._news = asyncio.Event()
        self._jobs: dict[asyncio.Task[None], int] = {}
        """Messages of topics that wait to be sent: subscription id, time in ns, and data that all viewers share."""
        self._parameter_lock = asyncio.Lock()
        self._publishing: asyncio.Future[None] | None = None
        self._rejected = 0
        """Service calls and parameter requests in flight, each with the size in bytes of the data that it retains."""
        self._advertised: dict[int, ClientAdvertisement] = {}
        self.watched: dict[int, AdvertisedChannel] = {}
        """Channels that the viewer watches, by subscription id."""
        self.follows_graph = False
        self.followed: set[str] | None = set()
        """Names of parameters whose changes are sent to the viewer; None means all parameters."""

    def send(self, subscription: int, time_ns: int, data: bytes) -> None:
        """Queue a message of a topic for the viewer; the oldest queued message is dropped if the queue is full."""
        self._messages.append((subscription, time_ns, data))
        self._message_bytes += len(data)
        while len(self._messages) > self._server.options.queue or (
            self._message_bytes > limits.MAX_CONTROL_BYTES and len(self._messages) > 1
        ):
            self._next_message()
        self._news.set()

    def _next_message(self) -> tuple[int, int, bytes]:
        message = self._messages.popleft()
        self._message_bytes -= len(message[2])
        return message

    def send_control(self, text: str | bytes) -> None:
        """Queue a message for the viewer that must not be dropped; disconnects the viewer if the queue is full."""
        is_full = len(self._control) >= limits.MAX_CONTROL_MESSAGES or self._control_bytes > limits.MAX_CONTROL_BYTES
        if is_full:
            self.abort()
            return
        self._control.append(text)
        self._control_bytes += len(text)
        self._news.set()

    def abort(self) -> None:
        """Disconnect the viewer at once, without sending queued messages."""
        self._connection.transport.abort()

    async def run(self, pace: RateLimit) -> None:
        """Handle messages of the viewer, no faster than `pace`, until the connection is closed."""
        sending = asyncio.ensure_future(self._send())
        try:
            with suppress(ConnectionClosed):
                async for message in self._connection:
                    if isinstance(message, str) and len(message) > limits.HEAVY_TEXT:
                        async with self._server.heavy_message:
                            await self._handle(message, pace)
                    else:
                        await self._handle(message, pace)
        finally:
            sending.cancel()
            self.cancel()
            for channel in self.watched.values():
                channel.watchers.pop(self, None)
            for number in self._advertised:
                del self._server.offers[self.number, number]
            self._handlers.refresh()
            await asyncio.gather(sending, *self._jobs, return_exceptions=True)

    async def _send(self) -> None:
        with suppress(ConnectionClosed):
            while await self._news.wait():
                self._news.clear()
                while self._control or self._messages:
                    if self._control:
                        text = self._control.popleft()
                        self._control_bytes -= len(text)
                        await self._connection.send(text)
                    else:
                        await self._connection.send(protocol.message_data(*self._next_message()))

    def cancel(self) -> None:
        """Cancel the viewer's service calls and parameter requests, and the publishing of its current message."""
        for job in self._jobs:
            job.cancel()
        if self._publishing is not None:
            self._publishing.cancel()

    async def _handle(self, message: str | bytes, pace: RateLimit) -> None:
        """Handle a message of the viewer, then pause for as long as that took, which leaves half of the time to other
        viewers.
        """
        began = monotonic()
        self._rejected = 0
        publishing = None
        try:
            publishing = self._dispatch(protocol.read(message), len(message))
        except ProtocolError as error:
            self._reject(str(error))
        if self._rejected > limits.MAX_STATUSES:
            count = self._rejected - limits.MAX_STATUSES
            self.send_control(protocol.status(f"{count} further entries of the message are refused", protocol.ERROR))
        took_s = monotonic() - began
        if publishing is not None:
            self._publishing = asyncio.ensure_future(publishing)
            await asyncio.wait([self._publishing])
        await asyncio.sleep(max(pace.wait_s(), took_s if took_s > limits.PAUSE_FROM_S else 0))

    def _reject(self, why: str) -> None:
        self._rejected += 1
        if self._rejected <= limits.MAX_STATUSES:
            self.send_control(protocol.status(why, protocol.ERROR))

    def _dispatch(self, message: ClientMessage, size: int) -> Awaitable[None] | None:
        """Handle a message of `size` bytes; return an awaitable to complete before the next message, or None."""
        match message.op:
            case "subscribe":
                for subscription, number in message.what:
                    self._subscribe(subscription, number)
                self._handlers.refresh()
            case "unsubscribe":
                for subscription in message.what:
                    if channel := self.watched.pop(subscription, None):
                        del channel.watchers[self]
                self._handlers.refresh()
            case "advertise" | "unadvertise" | "publish" if self._server.options.is_read_only:
                raise ProtocolError("Server does not support clientPublish capability")
            case "advertise":
                for number, offer in message.what:
                    self._advertise(number, offer)
                self._handlers.refresh()
            case "unadvertise":
                for number in message.what:
                    if self._advertised.pop(number, None):
                        del self._server.offers[self.number, number]
                self._handlers.refresh()
            case "publish":
                number, data = message.what
                if number not in self._advertised:
                    raise ProtocolError(f"Channel ID {number} is not advertised")
                return self._handlers.publish((self.number, number), data)
            case "call" | "getParameters" | "setParameters":
                self._start_job(message, size)
            case "subscribeParameterUpdates":
                self._follow_parameters({*message.what})
            case "unsubscribeParameterUpdates":
                self.followed = (self.followed and self.followed - {*message.what}) if message.what else set()
            case "subscribeConnectionGraph":
                self.follows_graph = True
                self.send_control(protocol.graph_update(protocol.NO_GRAPH, self._server.graph))
            case "unsubscribeConnectionGraph":
                self.follows_graph = False
            case _:
                raise ProtocolError("Server does not support assets capability")
        return None

    def _subscribe(self, subscription: int, number: int) -> None:
        channel = self._server.channels.get(number)
        if channel is None:
            self._reject(f"Unknown channel ID: {number}; ignoring subscription")
        elif self in channel.watchers:
            self._reject(f"Client is already subscribed to channel: {number}; ignoring subscription")
        elif subscription in self.watched:
            self._reject(f"Subscription ID was already used: {subscription}; ignoring subscription")
        else:
            channel.watchers[self] = subscription
            self.watched[subscription] = channel

    def _advertise(self, number: int, offer: ClientAdvertisement) -> None:
        others = [one for key, one in self._advertised.items() if key != number]
        size = sum(len(one.schema) for one in others) + len(offer.schema)
        if len(others) >= limits.MAX_CLIENT_CHANNELS:
            refusal = f"{limits.MAX_CLIENT_CHANNELS} topics are published already"
        elif len(offer.schema) > limits.MAX_SCHEMA_BYTES:
            limit = f"expected at most {limits.MAX_SCHEMA_BYTES}; without a definition the types known here can be used"
            refusal = f"its definition has {len(offer.schema)} bytes, {limit}"
        elif size > limits.MAX_VIEWER_SCHEMA_BYTES:
            limit = f"expected at most {limits.MAX_VIEWER_SCHEMA_BYTES} for all topics of a viewer"
            refusal = f"with its definition there are {size} bytes, {limit}"
        else:
            self._advertised[number] = self._server.offers[self.number, number] = offer
            return
        self._reject(f"{offer.topic} cannot be published: {refusal}")

    def _follow_parameters(self, names: set[str]) -> None:
        if self.followed is None or not names:
            self.followed = None
            return
        followed = self.followed | names
        length = sum(map(len, followed))
        if len(followed) > limits.MAX_FOLLOWED or length > limits.MAX_FOLLOWED_LENGTH:
            limit = f"{limits.MAX_FOLLOWED} names with {limits.MAX_FOLLOWED_LENGTH} characters"
            reason = f"there would be {len(followed)} names with {length} characters, expected at most {limit}"
            raise ProtocolError(f"parameters are not followed: {reason}; an empty list follows all")
        self.followed = followed

    def _start_job(self, message: ClientMessage, size: int) -> None:
        total = sum(self._jobs.values()) + size
        refusal = ""
        if len(self._jobs) >= limits.MAX_JOBS:
            refusal = f"{limits.MAX_JOBS} calls and parameter requests are in flight already"
        elif self._jobs and total > limits.MAX_JOB_BYTES:
            limit = f"expected at most {limits.MAX_JOB_BYTES} at a time"
            refusal = f"calls and parameter requests of {total} bytes would be in flight, {limit}"
        if refusal:
            if message.op == "call":
                self.send_control(protocol.failure(message.what, refusal))
            raise ProtocolError(refusal)
        task = asyncio.ensure_future(self._call(message.what) if message.op == "call" else self._reply(message))
        self._jobs[task] = size
        task.add_done_callback(lambda done: self._jobs.pop(done, None))

    async def _call(self, call: ServiceCallRequest) -> None:
        service = self._server.services.get(call.service)
        try:
            if service is None:
                raise ProtocolError(f"Unknown service ID: {call.service}")
            if call.encoding != "cdr":
                raise ProtocolError(f'the encoding is "{call.encoding[:40]}"; expected cdr')
            self.send_control(protocol.response(call, await service.call(call.data)))
        except RosidlError as error:
            self.send_control(protocol.failure(call, str(error)))
        except asyncio.CancelledError:
            self.send_control(protocol.failure(call, "the server is closed"))

    async def _reply(self, message: ClientMessage) -> None:
        async with self._parameter_lock:  # in the order of the requests
            is_set = message.op == "setParameters"
            try:
                values = await (self._handlers.set(dict(message.what)) if is_set else self._handlers.get(message.what))
            except RosidlError as error:
                self.send_control(protocol.status(f"{message.op}: {error}", protocol.ERROR))
                values = {}
        if message.id is not None:
            self.send_control(protocol.parameter_values(values, message.id))
