"""What viewers connect to: it looks at who they are, and hands on what they and the SDK's server say.

Decides that the SDK's server is out of reach for all others. It takes everybody, and knows no limits that it could be
told. So it listens on an address of this machine's own network that nobody is told, and on a port to which browsers
connect no page: the fetch standard's list of bad ports holds for WebSockets, too.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import socket
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from websockets.asyncio.client import connect
from websockets.asyncio.server import serve
from websockets.exceptions import ConnectionClosed, WebSocketException

from rosidl_py_gen.tools import ToolError
from rosidl_py_gen.tools.foxglove.access import Access, Pace

if TYPE_CHECKING:
    from collections.abc import Callable
    from http import HTTPStatus

    from websockets.asyncio.connection import Connection
    from websockets.asyncio.server import Server, ServerConnection
    from websockets.http11 import Request, Response

_SUBPROTOCOLS: Any = ["foxglove.sdk.v1"]
_PATIENCE_S = 10.0
"""For a viewer to say what it wants, and to say good-bye."""
_CLOSE_S = 1.0
_MAX_VIEWERS = 64
_QUEUE = 4
"""Messages that wait here for a slow viewer; the SDK holds the others, and drops the oldest."""
_BAD_PORTS = (6000, 6566, 6665, 6666, 6667, 6668, 6669, 6679, 6697, 10080, 4190, 4045, 3659, 2049, 1719, 1720, 1723)
_TRIES = 40
_SILENT = logging.Logger("rosidl-py foxglove")
"""What is wrong with viewers is told them."""
_SILENT.addHandler(logging.NullHandler())


def start_hidden(start: Callable[[str, int], int]) -> tuple[str, int]:
    """Have a server listen where viewers do not find it; gives the address.

    Args:
        start: begins to listen at a host and port.

    Raises:
        ToolError: nothing is free.
    """
    problem = None
    for number in range(_TRIES):
        host = "127.0.0.1"
        if sys.platform == "linux":  # all of 127.0.0.0/8 is this machine
            host = "127." + ".".join(str(1 + secrets.randbelow(254)) for _ in range(3))
        try:
            return host, start(host, _BAD_PORTS[number % len(_BAD_PORTS)])
        except ToolError as error:
            problem = error
    raise ToolError(f"no address of this machine is free for the viewers' server: {problem}")


class Front:
    """Listens from `start` to `stop`.

    Args:
        most_bytes: of a message of a viewer; one that sends more is disconnected.
        per_s: messages of a viewer.
    """

    def __init__(self, access: Access, *, most_bytes: int, per_s: int) -> None:
        self._access = access
        self._most_bytes = most_bytes
        self._per_s = per_s
        self._behind = ""
        self._server: Server | None = None
        self._viewers = 0

    async def start(self, host: str, port: int, behind: tuple[str, int]) -> int:
        """Listen; gives the port.

        Args:
            behind: where the server is that speaks with viewers.

        Raises:
            ToolError: the address cannot be used.
        """
        self._behind = f"ws://{behind[0]}:{behind[1]}"
        shown = f"[{host}]" if ":" in host else host
        try:
            bound = await asyncio.to_thread(_bind, host, port)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ToolError(f"cannot listen on {shown}:{port}: {reason}; --port takes another one") from None
        self._server = await serve(
            self._serve,
            sock=bound,
            subprotocols=_SUBPROTOCOLS,
            process_request=self._look_at,
            compression=None,
            max_size=self._most_bytes,
            max_queue=_QUEUE,
            open_timeout=_PATIENCE_S,
            close_timeout=_CLOSE_S,
            ping_interval=None,
            logger=_SILENT,
        )
        found: int = bound.getsockname()[1]
        return found

    def _look_at(self, connection: ServerConnection, request: Request) -> Response | None:
        refusal = self._access.refusal(request.headers.get_all("Origin"), request.path)
        if refusal is None and self._viewers >= _MAX_VIEWERS:
            refusal = 503, f"there are {_MAX_VIEWERS} viewers already"
        if refusal is None:
            return None
        status: HTTPStatus | Any = refusal[0]
        return connection.respond(status, refusal[1] + "\n")

    async def _serve(self, viewer: ServerConnection) -> None:
        self._viewers += 1
        try:
            async with connect(
                self._behind,
                subprotocols=_SUBPROTOCOLS,
                proxy=None,
                compression=None,
                max_size=None,
                max_queue=_QUEUE,
                ping_interval=None,
                close_timeout=_CLOSE_S,
                logger=_SILENT,
            ) as server:
                await self._hand_on(viewer, server)
        except (OSError, WebSocketException, asyncio.TimeoutError):  # the server ends, or has no room
            await viewer.close(1011, "the server does not answer")
        finally:
            self._viewers -= 1

    async def _hand_on(self, viewer: Connection, server: Connection) -> None:
        ways = [asyncio.ensure_future(_copy(server, viewer, None)),
                asyncio.ensure_future(_copy(viewer, server, Pace(self._per_s)))]  # fmt: skip
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
        await viewer.close()

    async def stop(self) -> None:
        """Let all viewers go; may be called twice."""
        if self._server is not None:
            self._server.close()
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._server.wait_closed(), 2 * _CLOSE_S)


async def _copy(source: Connection, target: Connection, pace: Pace | None) -> None:
    """Until one of them is closed."""
    with suppress(ConnectionClosed):
        async for message in source:
            await target.send(message)
            pause_s = pace.wait_s() if pace is not None else 0.0
            if pause_s:
                await asyncio.sleep(pause_s)


def _bind(host: str, port: int) -> socket.socket:
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    return socket.create_server(address[:2], family=family, backlog=_MAX_VIEWERS)
