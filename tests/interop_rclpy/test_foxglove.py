"""``rosidl-py foxglove`` between viewers and rclpy nodes on Fast DDS, whose types it knows only from them."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from peer_helpers import fresh, message, repeated, without_definitions
from rclpy_peer import Peer
from support.foxglove_viewer import viewer

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from pathlib import Path

    from support.foxglove_viewer import Viewer

STRINGS = "test_msgs/msg/Strings"


@asynccontextmanager
async def watching(cache: Path, *options: str) -> AsyncIterator[Viewer]:
    command = (sys.executable, "-m", "rosidl_py_gen.ros_cli", "foxglove", "--port", "0", "--json", *options)
    process = await asyncio.create_subprocess_exec(
        *command, env=without_definitions(cache), stdout=asyncio.subprocess.PIPE
    )
    assert process.stdout is not None
    try:
        line = await asyncio.wait_for(process.stdout.readline(), 20)
        async with viewer(json.loads(line)["address"]) as made:
            yield made
    finally:
        process.send_signal(signal.SIGINT)
        assert await asyncio.wait_for(process.wait(), 10) == 0


async def test_a_topic_of_an_unknown_type_is_seen_and_published_on(shared_peer: Peer, tmp_path: Path) -> None:
    topic, commands = fresh("words"), fresh("commands")
    await shared_peer.do("publisher", topic=topic, type=STRINGS)
    await shared_peer.do("subscribe", topic=commands, type=STRINGS)
    strings = message(shared_peer, STRINGS)
    known = ("--path", str(shared_peer.share)) if shared_peer.distro == "humble" else ()  # it does not describe types
    async with watching(tmp_path, *known) as seen:
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
