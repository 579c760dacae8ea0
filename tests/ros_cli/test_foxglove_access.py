"""Access to ``rosidl-py foxglove``, and limits of viewers, with real WebSocket clients."""

from __future__ import annotations

import asyncio
import json
import time
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any

import pytest
from support.foxglove_viewer import served, viewer
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from rosidl_py_gen.ros_cli.foxglove.viewer import RateLimit

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

GOOD = [
    None,
    "http://localhost",
    "http://localhost:8080",
    "https://127.0.0.1:3000",
    "http://[::1]:8080",
    "https://app.foxglove.dev",
    "https://lichtblick-suite.github.io",
    "file://",
]
HOSTILE = [
    "https://evil.example",
    "http://app.foxglove.dev",
    "https://app.foxglove.dev.evil.example",
    "https://evil.example/https://app.foxglove.dev",
    "https://app.foxglove.dev:444",
    "http://localhost.evil.example",
    "http://localhost@evil.example",
    "http://user@localhost",
    "http://127.0.0.1.evil.example",
    "ftp://localhost",
    "localhost",
    "null",
    "",
    "http://[::1",
    "*",
    "file:///home/x.html",
]


@asynccontextmanager
async def front(**settings: Any) -> AsyncIterator[str]:
    """The address of a server."""
    async with served(**settings) as (_, address):
        yield address


async def visit(address: str, origin: str | None, **how: Any) -> str:
    protocols: Any = ["foxglove.sdk.v1"]
    how.setdefault("additional_headers", {} if origin is None else {"Origin": origin})
    try:
        async with connect(address, subprotocols=protocols, proxy=None, **how) as connection:
            return str(json.loads(await connection.recv())["op"])
    except InvalidStatus as refused:
        return f"{refused.response.status_code} {refused.response.body.decode()}"


async def test_pages_of_this_machine_known_apps_and_what_is_no_page_may_connect() -> None:
    async with front() as address:
        for origin in GOOD:
            assert await visit(address, origin) == "serverInfo", origin


async def test_other_pages_may_not_connect() -> None:
    async with front() as address:
        for origin in HOSTILE:
            assert (await visit(address, origin)).startswith(f"403 pages of {origin} must not connect"), origin
        twice = [("Origin", "http://localhost"), ("Origin", "https://evil.example")]
        assert (await visit(address, None, additional_headers=twice)).startswith("403")


async def test_pages_that_were_allowed_may_connect() -> None:
    async with front(origins=["https://one.example/", "null"]) as address:
        assert await visit(address, "https://one.example") == "serverInfo"
        assert await visit(address, "null") == "serverInfo"
        assert (await visit(address, "https://two.example")).startswith("403")
    async with front(origins=["*"]) as address:
        assert await visit(address, "https://two.example") == "serverInfo"


async def test_with_a_token_nobody_connects_without_it() -> None:
    async with front(token="let me/in&é") as address:
        assert await visit(f"{address}/?token=let%20me/in%26%C3%A9", None) == "serverInfo"
        right = "token=let%20me/in%26%C3%A9"
        for wrong in ("", "?token=", "?token=let", "?TOKEN=let%20me/in%26%C3%A9", f"?{right}&{right}", f"?{right}x",
                      "?" + "a=1&" * 100 + right, "?token=%ff"):  # fmt: skip
            assert (await visit(f"{address}/{wrong}", None)).startswith("401"), wrong
        assert (await visit(f"{address}/?{right}", "https://evil.example")).startswith("403")


async def test_a_message_that_is_too_large_ends_its_viewer_only() -> None:
    async with front() as address, viewer(address) as good:
        for sent in (b"\1" * ((1 << 20) + 1), [b"\1" * 600_000, b"\1" * 600_000]):
            async with viewer(address) as bad:
                await bad.connection.send(sent)
                await bad.until(lambda bad=bad: not bad.is_open)
                assert bad.connection.close_code == 1009
        await good.send("subscribe", subscriptions=[{"id": 1, "channelId": 77}])
        await good.until(lambda: "Unknown channel ID: 77" in good.warnings())


async def test_a_viewer_that_sends_too_much_is_read_more_slowly_and_others_are_not() -> None:
    async with front(per_s=50) as address, viewer(address) as good, viewer(address) as flood:
        start = time.monotonic()
        for _ in range(150):
            await flood.connection.send("{")
        await flood.send("subscribe", subscriptions=[{"id": 1, "channelId": 88}])
        await good.send("subscribe", subscriptions=[{"id": 1, "channelId": 77}])
        await good.until(lambda: "Unknown channel ID: 77" in good.warnings())
        assert "Unknown channel ID: 88" not in flood.warnings()
        await flood.until(lambda: "Unknown channel ID: 88" in flood.warnings())
        assert time.monotonic() - start > 1.8


async def test_there_is_an_end_of_viewers() -> None:
    async with front() as address:
        held = [connect(address, proxy=None, subprotocols=["foxglove.sdk.v1"]) for _ in range(64)]  # type: ignore[list-item]
        connections = [await one for one in held]
        assert (await visit(address, None)).startswith("503 there are 64 viewers already")
        await connections.pop().close()
        while (await visit(address, None)).startswith("503"):
            await asyncio.sleep(0.01)
        await asyncio.gather(*(one.close() for one in connections))


async def test_who_does_not_speak_http_is_let_go() -> None:
    async with front() as address:
        host, port = address.removeprefix("ws://").split(":")
        for said in (
            b"\0" * 100 + b"\r\n\r\n",
            b"GET / HTTP/1.1\r\n\r\n",
            b"GET /" + b"a" * 20_000,
            b"POST / HTTP/1.1\r\n\r\n",
        ):
            reader, writer = await asyncio.open_connection(host, int(port))
            writer.write(said + b"\r\n\r\n")
            assert not (await asyncio.wait_for(reader.read(), 10)).startswith(b"HTTP/1.1 101")
            writer.close()
        assert await visit(address, None) == "serverInfo"


async def test_what_the_server_sends_comes_in_its_order_whole() -> None:
    async def call(data: bytes) -> bytes:
        return data * 3

    async with served() as (server, address), viewer(address) as seen:
        server.add_service("/x", "std_srvs/srv/Trigger", ("", ""), call)
        for number in range(1, 20):
            data = bytes([number]) * 40_000
            assert await seen.call("/x", data, number) == data * 3
    with pytest.raises((OSError, ConnectionClosed)):
        await visit(address, None)


def test_a_viewer_may_send_so_many_at_once_and_then_at_its_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("rosidl_py_gen.ros_cli.foxglove.viewer.monotonic", lambda: now)
    pace = RateLimit(10)
    assert [pace.wait_s() for _ in range(10)] == [0.0] * 10
    assert pace.wait_s() == pytest.approx(0.1)
    now += 0.1
    assert pace.wait_s() == pytest.approx(0.1)
    now += 1000
    assert [pace.wait_s() for _ in range(10)] == [0.0] * 10
    assert pace.wait_s() > 0
