"""A viewer of our own, connected to the server as others are, because some things only viewers can do safely.

Decides nothing about what is shown. While it is subscribed to the graph, no other viewer is the first or the last one,
which is when the SDK calls back with a lock held; and what it sets makes the SDK publish parameters from a thread of
its own. The head of `server` says why that matters.
"""

from __future__ import annotations

import asyncio
import json
import secrets
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException

from rosidl_py_gen.tools import ToolError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

_SUBPROTOCOL = "foxglove.sdk.v1"
_PATIENCE_S, _CLOSE_S = 5.0, 1.0


class OwnViewer:
    """Made by `own_viewer`."""

    def __init__(self, connection: ClientConnection, token: str) -> None:
        self._connection = connection
        self._token = token

    async def watch_graph(self) -> None:
        """Subscribe to the graph; it may be published from then on.

        Raises:
            ToolError: the connection is lost.
        """
        await self._connection.send(json.dumps({"op": "subscribeConnectionGraph"}))
        async for message in self._connection:
            if isinstance(message, str) and json.loads(message).get("op") == "connectionGraphUpdate":
                return
        raise ToolError("the server closed its connection with itself")

    async def read_on(self) -> None:
        """Take what comes, so that nothing piles up; returns when the server had no room left for it nevertheless."""
        with suppress(ConnectionClosed):
            async for _ in self._connection:
                pass

    async def publish_parameters(self) -> None:
        """Have the SDK ask for what has changed, and tell those viewers that subscribed to it."""
        with suppress(ConnectionClosed):
            await self._connection.send(json.dumps({"op": "setParameters", "parameters": [], "id": self._token}))


def new_token() -> str:
    """A request id that no other viewer can guess."""
    return secrets.token_hex(16)


@asynccontextmanager
async def own_viewer(host: str, port: int, token: str) -> AsyncIterator[OwnViewer]:
    """Connect to the server that listens there; `token` is what it was started with.

    Raises:
        ToolError: it does not answer.
    """
    reached = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    address = f"[{reached}]" if ":" in reached else reached
    try:
        connection = await connect(
            f"ws://{address}:{port}",
            subprotocols=[_SUBPROTOCOL],  # type: ignore[list-item]  # a NewType of str
            proxy=None,
            max_size=None,
            open_timeout=_PATIENCE_S,
            close_timeout=_CLOSE_S,
        )
    except (OSError, WebSocketException, asyncio.TimeoutError) as error:
        raise ToolError(f"the server at {address}:{port} cannot be reached from here: {error}") from None
    async with connection:
        yield OwnViewer(connection, token)
