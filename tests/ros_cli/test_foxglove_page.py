"""``rosidl-py foxglove`` in front of a browser, with the page among the examples."""

from __future__ import annotations

import asyncio
import json
import math
from time import monotonic
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

from support.browser import Browser, browser
from support.node_fixtures import ROOT

from rosidl_py_gen import get_message

if TYPE_CHECKING:
    from support.node_fixtures import World

__all__ = ["browser"]

Pressure: Any = get_message("std_msgs/msg/Float64")
PAGE = ROOT / "examples" / "live_view.html"


async def test_a_page_plots_a_field(dds: World, tool: Any, browser: Browser) -> None:
    node = dds.node("robot")
    wave = node.create_publisher(Pressure, "wave")
    began = monotonic()
    timer = node.create_timer(0.02, lambda: wave.publish(Pressure(data=math.sin(3 * (monotonic() - began)))))
    process = await tool.start("foxglove", "--port", "0", "--json", "--allow-origin", "null")
    address = json.loads(await asyncio.wait_for(process.stdout.readline(), 25))["address"]
    query = urlencode({"topic": "/wave", "field": "data", "address": address})

    def look() -> None:
        browser.open(f"{PAGE.as_uri()}?{query}")
        browser.wait_for("return values.length > 50")
        assert browser.run("return document.querySelector('#type').textContent") == "std_msgs/msg/Float64"
        low, high = browser.run("return [Math.min(...values), Math.max(...values)]")
        assert -1 <= low < high <= 1
        assert browser.run("return plot.points.length") > 50
        assert browser.screenshot().startswith(b"\x89PNG")

    await asyncio.to_thread(look)
    timer.close()
    process.terminate()
    assert (await tool.end(process)).code == 0
    await asyncio.to_thread(browser.wait_for, "return state.textContent === 'the server is gone'")
