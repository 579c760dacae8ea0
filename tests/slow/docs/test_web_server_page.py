"""The server of docs/howto/main-loops.md answers, without uvicorn."""

from __future__ import annotations

import asyncio
import importlib
from typing import TYPE_CHECKING

import pytest
from support.folders import ROOT
from support.markdown_pages import blocks

if TYPE_CHECKING:
    from pathlib import Path

    from support.worlds import World

pytestmark = pytest.mark.needs("fastapi")


async def test_handlers_call_the_service_and_return_the_latest_message(
    dds: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from example_interfaces.srv import AddTwoInts

    (code,) = (block.text for block in blocks(ROOT / "docs/howto/main-loops.md") if block.title == "server.py")
    (tmp_path / "server.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    server = importlib.import_module("server")
    robot = dds.node("robot")
    robot.create_service(AddTwoInts, "add_two_ints", lambda request: AddTwoInts.Response(sum=request.a + request.b))
    greetings = robot.create_publisher("std_msgs/msg/String", "chatter")
    async with server.app.router.lifespan_context(server.app):
        assert await server.add(40, 2) == {"sum": 42}
        for _ in range(200):
            greetings.publish({"data": "hello"})
            await asyncio.sleep(0.05)
            if await server.chatter():
                break
        assert await server.chatter() == {"data": "hello"}
        assert {"/add", "/chatter"} <= {route.path for route in server.app.routes}
