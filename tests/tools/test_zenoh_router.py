"""``rosidl-py zenoh-router``, as users run it. Routers listen on loopback, on a free port."""

from __future__ import annotations

import asyncio
import re
import signal
from typing import TYPE_CHECKING

import pytest
import zenoh

if TYPE_CHECKING:
    from conftest import Tool

LOOPBACK = "tcp/127.0.0.1:0"


async def listening(process: asyncio.subprocess.Process) -> str:
    """The endpoint that a router tells of."""
    assert process.stdout is not None
    line = (await asyncio.wait_for(process.stdout.readline(), 20)).decode()
    found = re.fullmatch(r"Zenoh router [0-9a-f]{1,32} listens on (tcp/127\.0\.0\.1:[1-9]\d*)\n", line)
    assert found is not None, line
    return found[1]


def client(endpoint: str) -> zenoh.Session:
    """A session that exchanges all through the router."""
    config = zenoh.Config()
    for key, value in {"mode": '"client"', "connect/endpoints": f'["{endpoint}"]'}.items():
        config.insert_json5(key, value)
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
async def test_a_router_serves_until_a_signal_ends_it(tool: Tool, number: signal.Signals) -> None:
    process = await tool.start("zenoh-router", "--listen", LOOPBACK)
    endpoint = await listening(process)
    with client(endpoint) as asking:
        assert len(asking.info.routers_zid()) == 1
    process.send_signal(number)
    ended = await tool.end(process)
    assert (ended.code, ended.out, ended.err) == (0, "", "")


async def test_routers_in_a_line_carry_data_from_end_to_end(tool: Tool) -> None:
    ends = [await listening(await tool.start("zenoh-router", "--listen", LOOPBACK))]
    for _ in range(2):
        ends.append(await listening(await tool.start("zenoh-router", "--listen", LOOPBACK, "--connect", ends[-1])))
    with client(ends[0]) as first, client(ends[-1]) as last:
        received = first.declare_subscriber("a/b")
        publisher = last.declare_publisher("a/b")
        deadline = asyncio.get_running_loop().time() + 10
        while not publisher.matching_status.matching:
            assert asyncio.get_running_loop().time() < deadline, "never matched"
            await asyncio.sleep(0.01)
        publisher.put(b"hello")
        assert (await asyncio.to_thread(received.recv)).payload.to_bytes() == b"hello"


async def test_a_second_router_says_why_it_cannot_listen(tool: Tool) -> None:
    endpoint = await listening(await tool.start("zenoh-router", "--listen", LOOPBACK))
    ended = await tool("zenoh-router", "--listen", endpoint)
    assert (ended.code, ended.out) == (1, "")
    assert re.match(f"error: no Zenoh router on {endpoint}: .*Address already in use", ended.err)


async def test_wrong_pairs_of_the_override_variable_are_told(tool: Tool) -> None:
    process = await tool.start("zenoh-router", "--listen", LOOPBACK, ZENOH_CONFIG_OVERRIDE="mode=peer")
    await listening(process)
    process.send_signal(signal.SIGINT)
    ended = await tool.end(process)
    assert ended.code == 0
    assert ended.err.startswith("warning: ZENOH_CONFIG_OVERRIDE: mode='peer': expected ")
