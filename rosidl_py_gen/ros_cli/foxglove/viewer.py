"""One viewer of ``foxglove``: what waits for it, and what it asks for.

Decides what a viewer may cost. Messages of topics wait for it up to a number, and the oldest are left out then. What
else it is told is never left out: a viewer that takes so little of it that too much waits is let go. What it sends is
read at its pace, which depends on the time that its messages take; what the server retains for it is limited by number
and size.
"""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
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
    from collections.abc import Awaitable, Callable, Coroutine

    from websockets.asyncio.server import ServerConnection

    from rosidl_py_gen.ros_cli.foxglove.access import RateLimit

ClientChannelKey = tuple[int, int]
"""Viewer, and the number it gave its channel."""


@dataclass(slots=True)
class Handlers:
    """What is called for viewers.

    Attributes:
        look: who watches what, or what is offered, has changed.
        publish: a viewer sent a message for a topic that it offers.
        get: values of the parameters with these names, all when there are none.
        set: wanted values; gives all of these parameters as they are then.
    """

    refresh: Callable[[], None]
    publish: Callable[[ClientChannelKey, bytes], Awaitable[None]]
    get: Callable[[list[str]], Awaitable[dict[str, Any]]]
    set: Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]


class AdvertisedChannel:
    """A topic as viewers see it; `advertisement` is what they were told of it."""

    def __init__(self, told: dict[str, Any]) -> None:
        self.advertisement = told
        self.watchers: dict[Viewer, int] = {}
        """Viewer -> how it calls its subscription."""

    @property
    def viewers(self) -> frozenset[int]:
        """Numbers of those that watch it."""
        return frozenset(viewer.number for viewer in self.watchers)

    def send(self, data: bytes, time_ns: int) -> None:
        """Queue a message for every viewer that watches; never waits, and drops a viewer's oldest when it is slow."""
        for viewer, subscription in self.watchers.items():
            viewer.send(subscription, time_ns, data)

    def close(self) -> None:
        """End all subscriptions to it."""
        for viewer, subscription in self.watchers.items():
            del viewer.watched[subscription]
        self.watchers.clear()


class AdvertisedService(NamedTuple):
    """A service as viewers see it, and what answers a request; both are CDR."""

    advertisement: dict[str, Any]
    call: Callable[[bytes], Awaitable[bytes]]


@dataclass(slots=True)
class ServerState:
    """State that all viewers share: channels and services by number, and a lock for one heavy message at a time."""

    channels: dict[int, AdvertisedChannel] = field(default_factory=dict)
    services: dict[int, AdvertisedService] = field(default_factory=dict)
    offers: dict[ClientChannelKey, ClientAdvertisement] = field(default_factory=dict)
    graph: protocol.Graph = protocol.NO_GRAPH
    heavy: asyncio.Lock = field(default_factory=asyncio.Lock)


class Viewer:
    """One connection.

    Args:
        queue: messages that may wait.
        may_publish: True if it may publish.
    """

    def __init__(
        self,
        connection: ServerConnection,
        number: int,
        shown: ServerState,
        handlers: Handlers,
        queue: int,
        *,
        may_publish: bool,
    ) -> None:
        self._connection = connection
        self._shown = shown
        self._handlers = handlers
        self._acts = may_publish
        self.number = number
        self._told: deque[str | bytes] = deque()
        self._told_bytes = 0
        self._messages: deque[tuple[int, int, bytes]] = deque()
        """Subscription, time and data; the data is shared by all viewers."""
        self._message_bytes = 0
        self._queue = queue
        self._news = asyncio.Event()
        self._jobs: dict[asyncio.Task[None], int] = {}
        """With the size of what each retains, in bytes."""
        self._turn = asyncio.Lock()
        self._publishing: asyncio.Future[None] | None = None
        self._refused = 0
        """Entries of the message that is handled now."""
        self._offered: dict[int, ClientAdvertisement] = {}
        self.watched: dict[int, AdvertisedChannel] = {}
        """Channels by its numbers for subscriptions."""
        self.follows_graph = False
        self.followed: set[str] | None = set()
        """Names of parameters whose changes it is told; None stands for all."""

    # ----------------------------------------------------------------------------------------------------- to and fro

    def send(self, subscription: int, time_ns: int, data: bytes) -> None:
        """Queue a message of a topic; the oldest ones are left out when there is no room."""
        self._messages.append((subscription, time_ns, data))
        self._message_bytes += len(data)
        while len(self._messages) > self._queue or (
            self._message_bytes > limits.MAX_TOLD_BYTES and len(self._messages) > 1
        ):
            self._next_message()
        self._news.set()

    def _next_message(self) -> tuple[int, int, bytes]:
        message = self._messages.popleft()
        self._message_bytes -= len(message[2])
        return message

    def send_control(self, text: str | bytes) -> None:
        """Queue what must not be left out."""
        is_full = len(self._told) >= limits.MAX_TOLD or self._told_bytes > limits.MAX_TOLD_BYTES
        if is_full:
            self.abort()
            return
        self._told.append(text)
        self._told_bytes += len(text)
        self._news.set()

    def abort(self) -> None:
        """Disconnect at once, without waiting for what is queued."""
        self._connection.transport.abort()

    async def run(self, pace: RateLimit) -> None:
        """Until the connection is closed."""
        sending = asyncio.ensure_future(self._send())
        try:
            with suppress(ConnectionClosed):
                async for message in self._connection:
                    if isinstance(message, str) and len(message) > limits.HEAVY_TEXT:
                        async with self._shown.heavy:
                            await self._take(message, pace)
                    else:
                        await self._take(message, pace)
        finally:
            sending.cancel()
            self.cancel()
            for channel in self.watched.values():
                channel.watchers.pop(self, None)
            for number in self._offered:
                del self._shown.offers[self.number, number]
            self._handlers.refresh()
            await asyncio.gather(sending, *self._jobs, return_exceptions=True)

    async def _send(self) -> None:
        with suppress(ConnectionClosed):
            while await self._news.wait():
                self._news.clear()
                while self._told or self._messages:
                    if self._told:
                        text = self._told.popleft()
                        self._told_bytes -= len(text)
                        await self._connection.send(text)
                    else:
                        await self._connection.send(protocol.message_data(*self._next_message()))

    def cancel(self) -> None:
        """Wait for no answers any more, and for no message that is being published."""
        for job in self._jobs:
            job.cancel()
        if self._publishing is not None:
            self._publishing.cancel()

    # -------------------------------------------------------------------------------------------------- what it wants

    async def _take(self, message: str | bytes, pace: RateLimit) -> None:
        """Handle a message, and pause for as long as it took, so that other viewers have half of the time."""
        began = monotonic()
        self._refused = 0
        publishing = None
        try:
            publishing = self._do(protocol.read(message), len(message))
        except ProtocolError as error:
            self._refuse(str(error))
        if self._refused > limits.MAX_STATUSES:
            count = self._refused - limits.MAX_STATUSES
            self.send_control(protocol.status(f"{count} further entries of the message are refused", protocol.ERROR))
        took_s = monotonic() - began
        if publishing is not None:
            self._publishing = asyncio.ensure_future(publishing)
            await asyncio.wait([self._publishing])
        await asyncio.sleep(max(pace.wait_s(), took_s if took_s > limits.PAUSE_FROM_S else 0))

    def _refuse(self, why: str) -> None:
        self._refused += 1
        if self._refused <= limits.MAX_STATUSES:
            self.send_control(protocol.status(why, protocol.ERROR))

    def _do(self, said: ClientMessage, size: int) -> Awaitable[None] | None:
        """Do what a message of `size` bytes wants; returns what the next one has to wait for."""
        match said.op:
            case "subscribe":
                for subscription, number in said.what:
                    self._subscribe(subscription, number)
                self._handlers.refresh()
            case "unsubscribe":
                for subscription in said.what:
                    if channel := self.watched.pop(subscription, None):
                        del channel.watchers[self]
                self._handlers.refresh()
            case "advertise" | "unadvertise" | "publish" if not self._acts:
                raise ProtocolError("Server does not support clientPublish capability")
            case "advertise":
                for number, offer in said.what:
                    self._offer(number, offer)
                self._handlers.refresh()
            case "unadvertise":
                for number in said.what:
                    self._withdraw(number)
                self._handlers.refresh()
            case "publish":
                number, data = said.what
                if number not in self._offered:
                    raise ProtocolError(f"Channel ID {number} is not advertised")
                return self._handlers.publish((self.number, number), data)
            case "call":
                self._begin_call(said.what, size)
            case "getParameters" | "setParameters":
                self._begin(self._answer(said), size)
            case "subscribeParameterUpdates":
                self._follow_parameters({*said.what})
            case "unsubscribeParameterUpdates":
                self.followed = (self.followed and self.followed - {*said.what}) if said.what else set()
            case "subscribeConnectionGraph":
                self.follows_graph = True
                self.send_control(protocol.graph_update(protocol.NO_GRAPH, self._shown.graph))
            case "unsubscribeConnectionGraph":
                self.follows_graph = False
            case _:
                raise ProtocolError("Server does not support assets capability")
        return None

    def _subscribe(self, subscription: int, number: int) -> None:
        channel = self._shown.channels.get(number)
        if channel is None:
            self._refuse(f"Unknown channel ID: {number}; ignoring subscription")
        elif self in channel.watchers:
            self._refuse(f"Client is already subscribed to channel: {number}; ignoring subscription")
        elif subscription in self.watched:
            self._refuse(f"Subscription ID was already used: {subscription}; ignoring subscription")
        else:
            channel.watchers[self] = subscription
            self.watched[subscription] = channel

    def _offer(self, number: int, offer: ClientAdvertisement) -> None:
        others = [one for key, one in self._offered.items() if key != number]
        size = sum(len(one.schema) for one in others) + len(offer.schema)
        if len(others) >= limits.MAX_OFFERS:
            self._refuse(f"{offer.topic} cannot be published: {limits.MAX_OFFERS} topics are already")
        elif len(offer.schema) > limits.MAX_SCHEMA_BYTES:
            most = f"expected at most {limits.MAX_SCHEMA_BYTES}; without a definition the types known here can be used"
            self._refuse(f"{offer.topic} cannot be published: its definition has {len(offer.schema)} bytes, {most}")
        elif size > limits.MAX_VIEWER_SCHEMA_BYTES:
            most = f"expected at most {limits.MAX_VIEWER_SCHEMA_BYTES} for all topics of a viewer"
            self._refuse(f"{offer.topic} cannot be published: with its definition there are {size} bytes, {most}")
        else:
            self._offered[number] = self._shown.offers[self.number, number] = offer

    def _withdraw(self, number: int) -> None:
        if self._offered.pop(number, None):
            del self._shown.offers[self.number, number]

    def _follow_parameters(self, names: set[str]) -> None:
        if self.followed is None or not names:
            self.followed = None
            return
        followed = self.followed | names
        length = sum(map(len, followed))
        if len(followed) > limits.MAX_FOLLOWED or length > limits.MAX_FOLLOWED_LENGTH:
            most = f"{limits.MAX_FOLLOWED} names with {limits.MAX_FOLLOWED_LENGTH} characters"
            found = f"there would be {len(followed)} names with {length} characters, expected at most {most}"
            raise ProtocolError(f"parameters are not followed: {found}; an empty list follows all")
        self.followed = followed

    def _begin(self, job: Coroutine[Any, Any, None], size: int) -> None:
        try:
            if len(self._jobs) >= limits.MAX_JOBS:
                raise ProtocolError(f"{limits.MAX_JOBS} calls and questions are under way already")
            total = sum(self._jobs.values()) + size
            if self._jobs and total > limits.MAX_JOB_BYTES:
                most = f"expected at most {limits.MAX_JOB_BYTES} at a time"
                raise ProtocolError(f"calls and questions of {total} bytes would be under way, {most}")
        except ProtocolError:
            job.close()
            raise
        task = asyncio.ensure_future(job)
        self._jobs[task] = size
        task.add_done_callback(lambda done: self._jobs.pop(done, None))

    def _begin_call(self, call: ServiceCallRequest, size: int) -> None:
        try:
            self._begin(self._call(call), size)
        except ProtocolError as error:
            self.send_control(protocol.failure(call, str(error)))
            raise

    async def _call(self, call: ServiceCallRequest) -> None:
        service = self._shown.services.get(call.service)
        try:
            if service is None:
                raise ProtocolError(f"Unknown service ID: {call.service}")
            if call.encoding != "cdr":
                raise ProtocolError(f'requests are CDR, not "{call.encoding[:40]}"')
            self.send_control(protocol.response(call, await service.call(call.data)))
        except RosidlError as error:
            self.send_control(protocol.failure(call, str(error)))
        except asyncio.CancelledError:
            self.send_control(protocol.failure(call, "the server ends"))

    async def _answer(self, said: ClientMessage) -> None:
        async with self._turn:  # in the order of the questions
            is_set = said.op == "setParameters"
            try:
                values = await (self._handlers.set(dict(said.what)) if is_set else self._handlers.get(said.what))
            except RosidlError as error:
                self.send_control(protocol.status(f"{said.op}: {error}", protocol.ERROR))
                values = {}
        if said.id is not None:
            self.send_control(protocol.parameter_values(values, said.id))
