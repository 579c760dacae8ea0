"""WebSocket server: accepts viewers, and sends them channels, services, parameters and the graph. Thread: loop.

A browser states the page that connects in the Origin header, which a page cannot change. Other programs may omit or
forge the header; a token keeps such programs out.
"""

from __future__ import annotations

import asyncio
import hmac
import itertools
import logging
import secrets
import socket
import traceback
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection, serve

from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.command_support import CommandError
from rosidl_py_gen.ros_cli.foxglove import limits, protocol
from rosidl_py_gen.ros_cli.foxglove.viewer import AdvertisedChannel, AdvertisedService, Handlers, RateLimit, Viewer

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping, Sequence

    from websockets.asyncio.server import Server as WebSocketServer
    from websockets.http11 import Request, Response

    from rosidl_py_gen.ros_cli.foxglove.protocol import ClientAdvertisement
    from rosidl_py_gen.ros_cli.foxglove.viewer import ClientChannelKey


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
