"""One viewer of ``foxglove``: what waits for it, and what it asks for.

Decides what a viewer may cost. Messages of topics wait for it up to a number, and the oldest are left out then. What
else it is told is never left out: a viewer that takes so little of it that too much waits is let go. What it sends is
read at its pace; its calls and questions that are under way are counted.
"""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from websockets.exceptions import ConnectionClosed

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tools.foxglove import protocol
from rosidl_py_gen.tools.foxglove.protocol import Call, Offer, ProtocolError, Said

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Coroutine

    from websockets.asyncio.server import ServerConnection

    from rosidl_py_gen.tools.foxglove.access import Pace

_MAX_OFFERS, _MAX_JOBS = 64, 64
"""Topics a viewer may publish on, and calls and questions of it that may be under way, at a time."""
_MAX_TOLD = 4096
"""What may wait for a viewer beside messages; most of it is the time, 30 times a second."""

OfferKey = tuple[int, int]
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

    look: Callable[[], None]
    publish: Callable[[OfferKey, bytes], None]
    get: Callable[[list[str]], Awaitable[dict[str, Any]]]
    set: Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]


class Channel:
    """A topic as viewers see it; `told` is what they were told of it."""

    def __init__(self, told: dict[str, Any]) -> None:
        self.told = told
        self.watchers: dict[Viewer, int] = {}
        """Viewer -> how it calls its subscription."""

    @property
    def viewers(self) -> frozenset[int]:
        """Numbers of those that watch it."""
        return frozenset(viewer.number for viewer in self.watchers)

    def send(self, data: bytes, time_ns: int) -> None:
        """Queue a message for every viewer that watches; never waits, and drops a viewer's oldest when it is slow."""
        for viewer, subscription in self.watchers.items():
            viewer.send(protocol.message_data(subscription, time_ns, data))


class Service(NamedTuple):
    """A service as viewers see it, and what answers a request; both are CDR."""

    told: dict[str, Any]
    call: Callable[[bytes], Awaitable[bytes]]


@dataclass(slots=True)
class Shown:
    """What all viewers see, by numbers, and the topics that they offer."""

    channels: dict[int, Channel] = field(default_factory=dict)
    services: dict[int, Service] = field(default_factory=dict)
    offers: dict[OfferKey, Offer] = field(default_factory=dict)
    graph: protocol.Graph = protocol.NO_GRAPH


class Viewer:
    """One connection.

    Args:
        queue: messages that may wait.
        acts: it may publish.
    """

    def __init__(
        self, connection: ServerConnection, number: int, shown: Shown, handlers: Handlers, queue: int, *, acts: bool
    ) -> None:
        self._connection = connection
        self._shown = shown
        self._handlers = handlers
        self._acts = acts
        self.number = number
        self._told: deque[str | bytes] = deque()
        self._messages: deque[bytes] = deque(maxlen=queue)
        self._news = asyncio.Event()
        self._jobs: set[asyncio.Task[None]] = set()
        self._turn = asyncio.Lock()
        self.follows_graph = False
        self.followed: set[str] | None = set()
        """Names of parameters whose changes it is told; None stands for all."""

    # ----------------------------------------------------------------------------------------------------- to and fro

    def send(self, message: bytes) -> None:
        """Queue a message of a topic; the oldest one is left out when there is no room."""
        self._messages.append(message)
        self._news.set()

    def tell(self, text: str | bytes) -> None:
        """Queue what must not be left out."""
        self._told.append(text)
        self._news.set()
        if len(self._told) > _MAX_TOLD:
            self._connection.transport.abort()

    async def run(self, pace: Pace) -> None:
        """Until the connection is closed."""
        sending = asyncio.ensure_future(self._send())
        try:
            with suppress(ConnectionClosed):
                async for message in self._connection:
                    self._take(message)
                    if pause_s := pace.wait_s():
                        await asyncio.sleep(pause_s)
        finally:
            sending.cancel()
            self.cancel()
            for channel in self._shown.channels.values():
                channel.watchers.pop(self, None)
            for key in [key for key in self._shown.offers if key[0] == self.number]:
                del self._shown.offers[key]
            self._handlers.look()
            await asyncio.gather(sending, *self._jobs, return_exceptions=True)

    async def _send(self) -> None:
        with suppress(ConnectionClosed):
            while await self._news.wait():
                self._news.clear()
                while self._told or self._messages:
                    await self._connection.send(self._told.popleft() if self._told else self._messages.popleft())

    def cancel(self) -> None:
        """Wait for no answers any more."""
        for job in self._jobs:
            job.cancel()

    # -------------------------------------------------------------------------------------------------- what it wants

    def _take(self, message: str | bytes) -> None:
        try:
            self._do(protocol.read(message))
        except ProtocolError as error:
            self._refuse(str(error))

    def _refuse(self, why: str) -> None:
        self.tell(protocol.status(why, protocol.ERROR))

    def _do(self, said: Said) -> None:
        match said.op:
            case "subscribe":
                for subscription, number in said.what:
                    self._subscribe(subscription, number)
                self._handlers.look()
            case "unsubscribe":
                for channel in self._shown.channels.values():
                    if channel.watchers.get(self) in said.what:
                        del channel.watchers[self]
                self._handlers.look()
            case "advertise" | "unadvertise" | "publish" if not self._acts:
                raise ProtocolError("Server does not support clientPublish capability")
            case "advertise":
                for number, offer in said.what:
                    self._offer(number, offer)
                self._handlers.look()
            case "unadvertise":
                for number in said.what:
                    self._shown.offers.pop((self.number, number), None)
                self._handlers.look()
            case "publish":
                number, data = said.what
                if (self.number, number) not in self._shown.offers:
                    raise ProtocolError(f"Channel ID {number} is not advertised")
                self._handlers.publish((self.number, number), data)
            case "call":
                self._begin(self._call(said.what))
            case "getParameters" | "setParameters":
                self._begin(self._answer(said))
            case "subscribeParameterUpdates":
                self.followed = None if self.followed is None or not said.what else self.followed | {*said.what}
            case "unsubscribeParameterUpdates":
                self.followed = (self.followed and self.followed - {*said.what}) if said.what else set()
            case "subscribeConnectionGraph":
                self.follows_graph = True
                self.tell(protocol.graph_update(protocol.NO_GRAPH, self._shown.graph))
            case "unsubscribeConnectionGraph":
                self.follows_graph = False
            case _:
                raise ProtocolError("Server does not support assets capability")

    def _subscribe(self, subscription: int, number: int) -> None:
        channel = self._shown.channels.get(number)
        if channel is None:
            self._refuse(f"Unknown channel ID: {number}; ignoring subscription")
        elif self in channel.watchers:
            self._refuse(f"Client is already subscribed to channel: {number}; ignoring subscription")
        elif any(one.watchers.get(self) == subscription for one in self._shown.channels.values()):
            self._refuse(f"Subscription ID was already used: {subscription}; ignoring subscription")
        else:
            channel.watchers[self] = subscription

    def _offer(self, number: int, offer: Offer) -> None:
        if sum(viewer == self.number for viewer, _ in self._shown.offers) >= _MAX_OFFERS:
            self._refuse(f"{offer.topic} cannot be published: {_MAX_OFFERS} topics are already")
        else:
            self._shown.offers[self.number, number] = offer

    def _begin(self, job: Coroutine[Any, Any, None]) -> None:
        if len(self._jobs) >= _MAX_JOBS:
            job.close()
            raise ProtocolError(f"{_MAX_JOBS} calls and questions are under way already")
        task = asyncio.ensure_future(job)
        self._jobs.add(task)
        task.add_done_callback(self._jobs.discard)

    async def _call(self, call: Call) -> None:
        service = self._shown.services.get(call.service)
        try:
            if service is None:
                raise ProtocolError(f"Unknown service ID: {call.service}")
            if call.encoding != "cdr":
                raise ProtocolError(f'requests are CDR, not "{call.encoding[:40]}"')
            self.tell(protocol.response(call, await service.call(call.data)))
        except RosidlError as error:
            self.tell(protocol.failure(call, str(error)))
        except asyncio.CancelledError:
            self.tell(protocol.failure(call, "the server ends"))

    async def _answer(self, said: Said) -> None:
        async with self._turn:  # in the order of the questions
            is_set = said.op == "setParameters"
            values = await (self._handlers.set(dict(said.what)) if is_set else self._handlers.get(said.what))
        if said.id is not None:
            self.tell(protocol.parameter_values(values, said.id))
