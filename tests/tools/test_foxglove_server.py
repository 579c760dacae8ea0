"""The server of ``rosidl-py foxglove``, and the viewer of our own, without the rest of the command."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest
from viewer import viewer
from websockets.asyncio.server import serve

from rosidl_py_gen.runtime import CallTimeoutError
from rosidl_py_gen.tools.foxglove.own_viewer import own_viewer
from rosidl_py_gen.tools.foxglove.server import Handlers, Listening, Server


async def nothing(*_: Any) -> dict[str, Any]:
    return {}


def started(server: Server, **handlers: Any) -> str:
    """The address."""
    taken = {"look": lambda: None, "get": nothing, "set": nothing, "refreshed": nothing, **handlers}
    return f"ws://127.0.0.1:{server.start(Listening('127.0.0.1', 0, 16, False, False), Handlers(**taken), 'token')}"


@pytest.mark.parametrize(
    ("error", "said"),
    [(CallTimeoutError("no response from /x in 10 s"), "no response from /x"), (asyncio.CancelledError(), "ends")],
)
async def test_why_a_call_failed_is_told(error: BaseException, said: str) -> None:
    async def fail(_: bytes) -> bytes:
        raise error

    server = Server()
    address = started(server)
    server.add_service("/x", "std_srvs/srv/Trigger", ("", ""), fail)
    async with viewer(address) as seen:
        assert said in str(await seen.call("/x", b""))
    await server.stop()


async def test_our_own_viewer_comes_again_when_the_server_closes_its_connection() -> None:
    visits = 0

    async def answer(connection: Any) -> None:
        nonlocal visits
        visits += 1
        if visits == 1:
            connection.transport.abort()
            return
        if visits == 2:
            return
        await connection.recv()
        await connection.send(json.dumps({"op": "connectionGraphUpdate"}))
        await connection.wait_closed()

    protocols: Any = ["foxglove.sdk.v1"]
    async with serve(answer, "127.0.0.1", 0, subprotocols=protocols) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        async with own_viewer("127.0.0.1", port, "token"):
            assert visits == 3
