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
_TRIES, _PAUSE_S = 5, 0.2
"""The server may have no room left for it right after it came, when there is much to tell."""


class OwnViewer:
    """Made by `own_viewer`."""

    def __init__(self, connection: ClientConnection, token: str) -> None:
        self._connection = connection
        self._token = token

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
    """Connect to the server that listens there, and subscribe to the graph: it may be published from then on.

    Args:
        token: what the server was started with.

    Raises:
        ToolError: it does not answer, or closes the connection again and again.
    """
    reached = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    address = f"[{reached}]:{port}" if ":" in reached else f"{reached}:{port}"
    async with await _connected(address) as connection:
        yield OwnViewer(connection, token)


async def _connected(address: str) -> ClientConnection:
    problem: Exception | None = None
    for _ in range(_TRIES):
        try:
            return await _connect(address)
        except (OSError, WebSocketException, asyncio.TimeoutError) as error:
            problem = error
        await asyncio.sleep(_PAUSE_S)
    raise ToolError(f"the server at {address} cannot be reached from here: {problem}")


async def _connect(address: str) -> ClientConnection:
    connection = await connect(
        f"ws://{address}",
        subprotocols=[_SUBPROTOCOL],  # type: ignore[list-item]  # a NewType of str
        proxy=None,
        max_size=None,
        open_timeout=_PATIENCE_S,
        close_timeout=_CLOSE_S,
    )
    try:
        await connection.send(json.dumps({"op": "subscribeConnectionGraph"}))
        while True:
            message = await connection.recv()
            if isinstance(message, str) and json.loads(message).get("op") == "connectionGraphUpdate":
                return connection
    except BaseException:
        await connection.close()
        raise
