"""``rosidl-py foxglove`` between viewers and rclpy nodes, whose types it knows only from these nodes."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import pytest
from peer_helpers import fresh, message, repeated, service, without_definitions
from rclpy_peer import Peer
from support.foxglove_viewer import viewer

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable
    from contextlib import AbstractAsyncContextManager
    from pathlib import Path

    from support.foxglove_viewer import Viewer

    Watching = Callable[..., AbstractAsyncContextManager[Viewer]]

STRINGS, BASIC = "test_msgs/msg/Strings", "test_msgs/srv/BasicTypes"


@pytest.fixture
def watching(tmp_path: Path) -> Watching:
    @asynccontextmanager
    async def watch(*options: str) -> AsyncIterator[Viewer]:
        command = (sys.executable, "-m", "rosidl_py_gen.ros_cli", "foxglove", "--port", "0", "--json", *options)
        process = await asyncio.create_subprocess_exec(
            *command, env=without_definitions(tmp_path), stdout=asyncio.subprocess.PIPE
        )
        assert process.stdout is not None
        try:
            line = await asyncio.wait_for(process.stdout.readline(), 20)
            async with viewer(json.loads(line)["address"]) as made:
                yield made
        finally:
            process.send_signal(signal.SIGINT)
            assert await asyncio.wait_for(process.wait(), 10) == 0

    return watch


async def test_viewer_subscribes_and_publishes_on_topics_of_unknown_type(shared_peer: Peer, watching: Watching) -> None:
    topic, commands = fresh("words"), fresh("commands")
    await shared_peer.do("publisher", topic=topic, type=STRINGS)
    await shared_peer.do("subscribe", topic=commands, type=STRINGS)
    strings = message(shared_peer, STRINGS)
    known = ("--path", str(shared_peer.share)) if shared_peer.distro == "humble" else ()  # it does not describe types
    async with watching(*known) as seen:
        channel = await seen.subscribe(topic)
        assert channel["schemaName"] == STRINGS and "string string_value\n" in channel["schema"]

        async def send() -> None:
            await shared_peer.do("publish", topic=topic, messages_=[{"string_value": "grüße"}])

        await repeated(send, seen.until(lambda: seen.frames))
        assert strings.decode(seen.frames[0][2]).string_value == "grüße"
        await seen.offer(1, commands, STRINGS)
        await seen.publish(1, strings(string_value="go").encode())
        (answer,) = await shared_peer.do("take", topic=commands)
        assert answer["string_value"] == "go"


async def test_viewer_calls_services_and_sets_parameters_of_rclpy_node(shared_peer: Peer, watching: Watching) -> None:
    name, holder = fresh("answers"), fresh("holder")
    await shared_peer.do("serve", name=name, type=BASIC, how="echo")
    await shared_peer.do("add_node", name=holder.strip("/"))
    await shared_peer.do("declare", node=holder.strip("/"), parameters={"speed": 1.5, "arm.names": ["a", "ü"]})
    basic = service(shared_peer, BASIC)
    async with watching("--path", str(shared_peer.share)) as seen:  # rclpy tells types of services only by hash
        response = await seen.call(name, basic.Request(int32_value=-5, string_value="words").encode())
        assert isinstance(response, bytes) and basic.Response.decode(response).int32_value == -5
        key = f"{holder}.speed"
        while key not in (known := await seen.parameters(parameterNames=[])):
            await asyncio.sleep(0.2)
        assert (known[key], known[f"{holder}.arm.names"]) == (1.5, ["a", "ü"])
        assert await seen.parameters("setParameters", parameters=[{"name": key, "value": 3}]) == {key: 3.0}
    assert await shared_peer.do("parameters", node=holder.strip("/"), names=["speed"]) == [3.0]
