"""What viewers connect to: it looks at who they are, and tells them what there is, all on the event loop."""

from __future__ import annotations

import asyncio
import itertools
import logging
import secrets
import socket
import traceback
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING, Any

from websockets.asyncio.server import ServerConnection, serve

from rosidl_py_gen.ros_cli import ToolError, terminal_output
from rosidl_py_gen.ros_cli.foxglove import limits, protocol
from rosidl_py_gen.ros_cli.foxglove.access import Access, RateLimit
from rosidl_py_gen.ros_cli.foxglove.viewer import AdvertisedChannel, AdvertisedService, Handlers, ServerState, Viewer

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping
    from http import HTTPStatus

    from websockets.asyncio.server import Server as WebSocketServer
    from websockets.http11 import Request, Response

_NAME = "rosidl-py"
_PATIENCE_S = 10.0
"""For a viewer to say what it wants."""
_CLOSE_S = 0.2
"""For a viewer to confirm the end; then its connection is aborted."""
_STATUS_S = 1.0
"""The same trouble is reported so often at most."""
_READ_QUEUE = 1
"""Messages that wait for being read; each may be as large as one may be."""
_SILENT = logging.Logger("rosidl-py foxglove")
"""What is wrong with viewers is told them."""
_SILENT.addHandler(logging.NullHandler())


@dataclass(frozen=True, slots=True)
class Listening:
    """How a server is started.

    Attributes:
        queue: messages that may wait for a slow viewer.
        most_bytes: of a message of a viewer; one that sends more is disconnected.
        per_s: messages of a viewer; one that sends more is read more slowly.
        has_time: viewers are told the time, instead of using their own.
        is_read_only: viewers can neither publish nor call services, and setting parameters is refused.
    """

    host: str
    port: int
    queue: int
    max_message_bytes: int
    per_s: int
    has_time: bool
    is_read_only: bool


class _Connection(ServerConnection):
    """Connection of which little is read at once, and which ends when nobody takes the answers to its pings."""

    def connection_made(self, transport: Any) -> None:
        """Begin to read."""
        transport.max_size = limits.READ_BYTES
        self._answers = 0
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Handle what was read; `websockets` answers pings without waiting for the peer to read."""
        if self.transport.is_closing():
            return
        before = self.transport.get_write_buffer_size()
        super().data_received(data)
        grown = self.transport.get_write_buffer_size() - before
        self._answers = self._answers + grown if before else 0
        if self._answers > limits.MAX_ANSWER_BYTES:
            self.transport.abort()


class Server:
    """Listens from `start` to `stop`."""

    def __init__(self, access: Access) -> None:
        self._access = access
        self._listening: Listening | None = None
        self._server: WebSocketServer | None = None
        self._numbers = itertools.count(1)
        self._viewers: dict[int, Viewer] = {}
        self._shown = ServerState()
        self.offers = self._shown.offers
        """Topics that viewers want to publish on."""
        self._said: dict[str, float] = {}

    # -------------------------------------------------------------------------------------------------- who connects

    async def start(self, listening: Listening, handlers: Handlers) -> int:
        """Listen; gives the port.

        Raises:
            ToolError: the address cannot be used.
        """
        self._listening, host, port = listening, listening.host, listening.port
        try:
            bound = await asyncio.to_thread(_bind, host, port)
        except (OSError, OverflowError) as error:
            shown = f"[{host}]" if ":" in host else host
            reason = getattr(error, "strerror", None) or error
            raise ToolError(f"cannot listen on {shown}:{port}: {reason}; --port takes another one") from None
        names: Any = protocol.SUBPROTOCOLS
        session = secrets.token_hex(8)
        self._server = await serve(
            lambda connection: self._serve(connection, listening, handlers, session),
            sock=bound,
            subprotocols=names,
            process_request=self._look_at,
            create_connection=_Connection,
            compression=None,
            max_size=listening.max_message_bytes,
            max_queue=_READ_QUEUE,
            open_timeout=_PATIENCE_S,
            close_timeout=_CLOSE_S,
            ping_interval=None,
            logger=_SILENT,
        )
        found: int = bound.getsockname()[1]
        return found

    async def stop(self) -> None:
        """Let all viewers go; may be called twice."""
        for viewer in self._viewers.values():
            viewer.cancel()
        if self._server is not None:
            self._server.close()
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._server.wait_closed(), _CLOSE_S)
            for viewer in self._viewers.values():
                viewer.abort()

    def _look_at(self, connection: ServerConnection, request: Request) -> Response | None:
        refusal = self._access.refusal(request.headers.get_all("Origin"), request.path)
        if refusal is None and len(self._viewers) >= limits.MAX_VIEWERS:
            refusal = 503, f"there are {limits.MAX_VIEWERS} viewers already"
        if refusal is None:
            return None
        code: HTTPStatus | Any = refusal[0]
        return connection.respond(code, refusal[1] + "\n")

    async def _serve(
        self, connection: ServerConnection, listening: Listening, handlers: Handlers, session: str
    ) -> None:
        acts = not listening.is_read_only
        viewer = Viewer(connection, next(self._numbers), self._shown, handlers, listening.queue, may_publish=acts)
        self._viewers[viewer.number] = viewer
        can = ["parameters", "parametersSubscribe", "connectionGraph", *["time"] * listening.has_time]
        can += ["clientPublish", "services"] * acts
        viewer.send_control(protocol.server_info(_NAME, can, ["cdr", "json"] * acts, session))
        viewer.send_control(protocol.advertise(one.advertisement for one in self._shown.channels.values()))
        viewer.send_control(protocol.advertise_services(one.advertisement for one in self._shown.services.values()))
        try:
            await viewer.run(RateLimit(listening.per_s))
        except Exception:  # the library would say nothing, as of all that is wrong with viewers
            terminal_output.note(f"a viewer is let go: {traceback.format_exc()}")
            raise
        finally:
            del self._viewers[viewer.number]

    # ------------------------------------------------------------------------------------------ what there is to see

    def _tell(self, text: str | bytes) -> None:
        for viewer in self._viewers.values():
            viewer.send_control(text)

    def open_channel(self, topic: str, type_name: str, definition: str) -> AdvertisedChannel:
        """Show viewers a topic whose messages are CDR; an empty definition says that nobody knows it."""
        number = next(self._numbers)
        made = self._shown.channels[number] = AdvertisedChannel(protocol.channel(number, topic, type_name, definition))
        self._tell(protocol.advertise([made.advertisement]))
        return made

    def close_channel(self, channel: AdvertisedChannel) -> None:
        """Take a topic away from viewers."""
        del self._shown.channels[channel.advertisement["id"]]
        channel.close()
        self._tell(protocol.unadvertise([channel.advertisement["id"]]))

    def add_service(
        self, name: str, type_name: str, texts: tuple[str, str], call: Callable[[bytes], Awaitable[bytes]]
    ) -> None:
        """Show viewers a service.

        Args:
            texts: definitions of request and response.
            call: gets the request and gives the response, both CDR; what it raises is told the viewer.
        """
        number = next(self._numbers)
        told = protocol.service(number, name, type_name, texts)
        self._shown.services[number] = AdvertisedService(told, call)
        self._tell(protocol.advertise_services([told]))

    def remove_services(self, names: list[str]) -> None:
        """Take services away from viewers."""
        gone = [number for number, one in self._shown.services.items() if one.advertisement["name"] in names]
        for number in gone:
            del self._shown.services[number]
        self._tell(protocol.unadvertise_services(gone))

    def publish_graph(self, published: protocol.Names, subscribed: protocol.Names, served: protocol.Names) -> None:
        """Tell which nodes publish and subscribe to topics, and serve services."""
        before, self._shown.graph = self._shown.graph, (published, subscribed, served)
        update = protocol.graph_update(before, self._shown.graph)
        for viewer in self._viewers.values():
            if viewer.follows_graph:
                viewer.send_control(update)

    def publish_parameters(self, values: Mapping[str, Any]) -> None:
        """Tell new values to those who follow them."""
        for viewer in self._viewers.values():
            followed = viewer.followed
            if some := {name: value for name, value in values.items() if followed is None or name in followed}:
                viewer.send_control(protocol.parameter_values(some))

    def tell_time(self, time_ns: int) -> None:
        """Tell viewers what time it is, if they were promised that."""
        if self._listening is not None and self._listening.has_time:
            self._tell(protocol.time(time_ns))

    def send_control(self, about: str, text: str) -> None:
        """Warn viewers; at most once a second `about` a thing."""
        now = monotonic()
        if now < self._said.get(about, 0.0) + _STATUS_S:
            return
        self._said = {key: at for key, at in self._said.items() if now < at + _STATUS_S}
        count = len(self._said)
        if count > limits.MAX_WARNINGS:
            return
        self._said[about] = now
        self._tell(protocol.status(text if count < limits.MAX_WARNINGS else "further warnings of now are left out"))


def _bind(host: str, port: int) -> socket.socket:
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    return socket.create_server(address[:2], family=family, backlog=limits.MAX_VIEWERS)
