"""WebSocket server and its connections to viewers: channels, services, parameters and the graph. Thread: loop.

A browser states the page that connects in the Origin header, which a page cannot change. Other programs may omit or
forge the header; a token keeps such programs out.

The costs of a viewer are limited. Of waiting messages of topics, the oldest are dropped. Other messages to a viewer are
never dropped: a viewer that does not read them is disconnected. Messages of the viewer are handled at a pace that
depends on the time they take, and the data that the server retains for the viewer are limited by number and size.
"""

from __future__ import annotations

import asyncio
import hmac
import itertools
import logging
import secrets
import socket
import traceback
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed

from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.foxglove import limits, protocol
from rosidl_py_gen.foxglove.protocol import ClientAdvertisement, ClientMessage, ProtocolError, ServiceCallRequest

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping, Sequence

    from websockets.asyncio.server import Server as WebSocketServer
    from websockets.http11 import Request, Response

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


KNOWN_ORIGINS = ("https://app.foxglove.dev", "https://lichtblick-suite.github.io", "file://")
"""Permitted Origin headers: Foxglove, Lichtblick, desktop apps. Pages from files, or without origin, send ``null``."""
_LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
ANY = "*"


@dataclass(frozen=True, slots=True)
class FoxgloveOptions:
    """Options of the command ``foxglove``."""

    host: str
    port: int
    is_read_only: bool
    origins: Sequence[str]
    token: str
    max_mib: int
    per_s: int
    use_sim_time: bool
    queue: int
    hidden: bool
    paths: Sequence[str] = ()
    as_json: bool = False


def _refusal(options: FoxgloveOptions, origins: Sequence[str], path: str) -> tuple[int, str] | None:
    """Return status and text of the HTTP response that refuses a connection; None if origin and token permit it."""
    if len(origins) > 1 or not all(_is_allowed(origin, options.origins) for origin in origins):
        text = ", ".join(origins)[:100]
        return 403, f"pages of {text} must not connect; permit them with rosidl-py foxglove --allow-origin"
    if options.token and not _has_token(path, options.token):
        return 401, "the address requires ?token=... of rosidl-py foxglove"
    return None


def _is_allowed(origin: str, permitted: Sequence[str]) -> bool:
    allowed = (*KNOWN_ORIGINS, *(one.rstrip("/") if one != "file://" else one for one in permitted))
    if ANY in allowed or origin in allowed:
        return True
    try:
        parts = urlsplit(origin)
        return parts.scheme in ("http", "https") and parts.hostname in _LOCAL_HOSTS and parts.username is None
    except ValueError:
        return False


def _has_token(path: str, token: str) -> bool:
    try:
        tokens = parse_qs(urlsplit(path).query, max_num_fields=20).get("token", [])
    except ValueError:
        return False
    return len(tokens) == 1 and hmac.compare_digest(tokens[0].encode(errors="replace"), token.encode())


_NAME = "rosidl-py"
_HANDSHAKE_TIMEOUT_S = 10.0
"""Maximum time for the WebSocket handshake of a viewer, in seconds."""
_CLOSE_GRACE_S = 0.2
"""Time that a viewer has to confirm the end of its connection, in seconds; then the connection is aborted."""
_WARNING_INTERVAL_S = 1.0
"""Minimum interval between two warnings about the same subject, in seconds."""
_READ_QUEUE = 1
"""Maximum number of received messages of a viewer that wait to be handled; each may have the maximum size."""
_SILENT_LOGGER = logging.Logger("rosidl-py foxglove")
"""Logger without output for the WebSocket library, because errors of viewers are sent to the viewers."""
_SILENT_LOGGER.addHandler(logging.NullHandler())


class _Connection(ServerConnection):
    """WebSocket connection that reads small blocks, and is aborted if the viewer does not read replies to its pings."""

    def connection_made(self, transport: Any) -> None:
        transport.max_size = limits.READ_BYTES
        self._answers = 0
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        if self.transport.is_closing():
            return
        before = self.transport.get_write_buffer_size()
        super().data_received(data)
        grown = self.transport.get_write_buffer_size() - before
        self._answers = self._answers + grown if before else 0
        if self._answers > limits.MAX_ANSWER_BYTES:
            self.transport.abort()


class Server:
    """WebSocket server between `start` and `stop`, with the channels, services and graph that viewers share."""

    def __init__(self, options: FoxgloveOptions) -> None:
        self.options = options
        self.handlers: Handlers
        self.channels: dict[int, AdvertisedChannel] = {}
        self.services: dict[int, AdvertisedService] = {}
        self.offers: dict[ClientChannelKey, ClientAdvertisement] = {}
        """Topics on which viewers have announced to publish, by the ids of viewer and channel."""
        self.graph = protocol.NO_GRAPH
        self.heavy_message = asyncio.Lock()
        """Lock that is held while a long text message is handled, so that the server handles one at a time."""
        self._has_time = False
        self._server: WebSocketServer | None = None
        self._numbers = itertools.count(1)
        self._viewers: dict[int, Viewer] = {}
        self._warned_at: dict[str, float] = {}

    async def start(self, handlers: Handlers, *, has_time: bool) -> int:
        """Listen for viewers, and return the port. Raises `CommandError` if the server cannot listen on the address.

        Args:
            handlers: functions that connections of viewers call.
            has_time: True if viewers are sent the time, instead of using their own.
        """
        self.handlers, self._has_time = handlers, has_time
        host, port = self.options.host, self.options.port
        try:
            bound = await asyncio.to_thread(_bind, host, port)
        except (OSError, OverflowError) as error:
            address = f"[{host}]" if ":" in host else host
            reason = getattr(error, "strerror", None) or error
            raise CommandError(f"cannot listen on {address}:{port}: {reason}; pass another --port") from None
        names: Any = protocol.SUBPROTOCOLS
        session = secrets.token_hex(8)
        self._server = await serve(
            lambda connection: self._serve(connection, session),
            sock=bound,
            subprotocols=names,
            process_request=self._check_request,
            create_connection=_Connection,
            compression=None,
            max_size=self.options.max_mib << 20,
            max_queue=_READ_QUEUE,
            open_timeout=_HANDSHAKE_TIMEOUT_S,
            close_timeout=_CLOSE_GRACE_S,
            ping_interval=None,
            logger=_SILENT_LOGGER,
        )
        bound_port: int = bound.getsockname()[1]
        return bound_port

    async def stop(self) -> None:
        """Disconnect all viewers; may be called repeatedly."""
        for viewer in self._viewers.values():
            viewer.cancel()
        if self._server is not None:
            self._server.close()
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._server.wait_closed(), _CLOSE_GRACE_S)
            for viewer in self._viewers.values():
                viewer.abort()

    def _check_request(self, connection: ServerConnection, request: Request) -> Response | None:
        status: Any = 0
        if refusal := _refusal(self.options, request.headers.get_all("Origin"), request.path):
            status, text = refusal
        elif len(self._viewers) >= limits.MAX_VIEWERS:
            status, text = 503, f"there are {limits.MAX_VIEWERS} viewers already"
        return connection.respond(status, f"{text}\n") if status else None

    async def _serve(self, connection: ServerConnection, session: str) -> None:
        may_act = not self.options.is_read_only
        number = next(self._numbers)
        viewer = self._viewers[number] = Viewer(connection, self, number)
        can = ["parameters", "parametersSubscribe", "connectionGraph", *["time"] * self._has_time]
        can += ["clientPublish", "services"] * may_act
        encodings = ["cdr", "json"] * may_act
        viewer.send_control(
            protocol.control(
                "serverInfo", name=_NAME, capabilities=can, supportedEncodings=encodings, sessionId=session
            )
        )
        channels = [channel.advertisement for channel in self.channels.values()]
        viewer.send_control(protocol.control("advertise", channels=channels))
        services = [service.advertisement for service in self.services.values()]
        viewer.send_control(protocol.control("advertiseServices", services=services))
        try:
            await viewer.run(RateLimit(self.options.per_s))
        except Exception:  # the library logs nothing, as its logger is silent
            terminal_output.note(f"disconnected a viewer: {traceback.format_exc()}")
            raise
        finally:
            del self._viewers[number]

    def _broadcast(self, text: str | bytes) -> None:
        for viewer in self._viewers.values():
            viewer.send_control(text)

    def open_channel(self, topic: str, type_name: str, definition: str) -> AdvertisedChannel:
        """Advertise a topic of CDR messages to all viewers; an empty `definition` means an unknown definition."""
        number = next(self._numbers)
        advertised = self.channels[number] = AdvertisedChannel(protocol.channel(number, topic, type_name, definition))
        self._broadcast(protocol.control("advertise", channels=[advertised.advertisement]))
        return advertised

    def close_channel(self, channel: AdvertisedChannel) -> None:
        """Withdraw the topic of a channel from all viewers, and end their subscriptions."""
        del self.channels[channel.advertisement["id"]]
        channel.close()
        self._broadcast(protocol.control("unadvertise", channelIds=[channel.advertisement["id"]]))

    def add_service(
        self, name: str, type_name: str, texts: tuple[str, str], call: Callable[[bytes], Awaitable[bytes]]
    ) -> int:
        """Advertise a service to all viewers, and return the number of the service.

        Args:
            texts: definitions of request and response.
            call: takes the request and returns the response, both CDR; the viewer is sent the text of an exception.
        """
        number = next(self._numbers)
        advertisement = protocol.service(number, name, type_name, texts)
        self.services[number] = AdvertisedService(advertisement, call)
        self._broadcast(protocol.control("advertiseServices", services=[advertisement]))
        return number

    def remove_service(self, number: int) -> None:
        """Withdraw the service with this number from all viewers."""
        del self.services[number]
        self._broadcast(protocol.control("unadvertiseServices", serviceIds=[number]))

    def publish_graph(self, graph: protocol.Graph) -> None:
        """Send the changes of the connection graph since the last call to the viewers that follow the graph."""
        if graph == self.graph:
            return
        update = protocol.graph_update(self.graph, graph)
        self.graph = graph
        for viewer in self._viewers.values():
            if viewer.follows_graph:
                viewer.send_control(update)

    def publish_parameters(self, values: Mapping[str, Any]) -> None:
        """Send changed values of parameters, by name, to the viewers that follow these parameters."""
        for viewer in self._viewers.values():
            followed = viewer.followed
            if some := {name: value for name, value in values.items() if followed is None or name in followed}:
                viewer.send_control(protocol.parameter_values(some))

    def send_time(self, time_ns: int) -> None:
        """Send the time to all viewers, unless they use their own time."""
        if self._has_time:
            self._broadcast(protocol.time(time_ns))

    def send_control(self, subject: str, text: str) -> None:
        """Send a text message, usually a warning, to all viewers, at most once a second for each `subject`."""
        now = monotonic()
        if now < self._warned_at.get(subject, 0.0) + _WARNING_INTERVAL_S:
            return
        self._warned_at = {key: at for key, at in self._warned_at.items() if now < at + _WARNING_INTERVAL_S}
        count = len(self._warned_at)
        if count > limits.MAX_WARNINGS:
            return
        self._warned_at[subject] = now
        self._broadcast(protocol.status(text if count < limits.MAX_WARNINGS else "further warnings are dropped"))


def _bind(host: str, port: int) -> socket.socket:
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    return socket.create_server(address[:2], family=family, backlog=limits.MAX_VIEWERS)
