"""``rosidl-py foxglove`` in front of a browser, with the page among the examples."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
from time import monotonic
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

from support.browser import Browser, browser
from support.docs_pictures import update_picture
from support.node_fixtures import ROOT

from rosidl_py_gen import get_message

if TYPE_CHECKING:
    from support.node_fixtures import World

__all__ = ["browser"]

Pressure: Any = get_message("std_msgs/msg/Float64")
Battery: Any = get_message("sensor_msgs/msg/BatteryState")
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
        browser.wait_for("return values.length > 250")
        assert browser.run("return document.querySelector('#type').textContent") == "std_msgs/msg/Float64"
        low, high = browser.run("return [Math.min(...values), Math.max(...values)]")
        assert -1 <= low < high <= 1
        assert browser.run("return plot.points.length") > 50
        picture = browser.screenshot()
        assert picture.startswith(b"\x89PNG")
        update_picture("live_view.png", picture)

    await asyncio.to_thread(look)
    timer.close()
    process.terminate()
    assert (await tool.end(process)).code == 0
    await asyncio.to_thread(browser.wait_for, "return state.textContent === 'the server is gone'")


async def test_a_page_reads_a_field_behind_a_header(dds: World, tool: Any, browser: Browser) -> None:
    node = dds.node("robot")
    batteries = node.create_publisher(Battery, "battery")
    frames = itertools.cycle(["", "left", "right one"])

    def publish() -> None:
        battery = Battery(voltage=12.5, percentage=0.75)
        battery.header.frame_id = next(frames)
        batteries.publish(battery)

    timer = node.create_timer(0.02, publish)
    process = await tool.start("foxglove", "--port", "0", "--json", "--allow-origin", "null")
    address = json.loads(await asyncio.wait_for(process.stdout.readline(), 25))["address"]

    def look(field: str, condition: str) -> None:
        query = urlencode({"topic": "/battery", "field": field, "address": address})
        browser.open(f"{PAGE.as_uri()}?{query}")
        browser.wait_for(condition)

    await asyncio.to_thread(look, "voltage", "return values.length > 5 && values.every(one => one === 12.5)")
    await asyncio.to_thread(look, "percentage", "return values.length > 5 && values.every(one => one === 0.75)")
    await asyncio.to_thread(look, "location", "return state.textContent.startsWith('no number location')")
    timer.close()
    process.terminate()
    assert (await tool.end(process)).code == 0
