"""Playing a bag: when its messages come."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader, BagWriter
from rosidl_py_gen.runtime.loop.virtual_time import VirtualTimeLoop

if TYPE_CHECKING:
    from pathlib import Path

String: Any = get_message("std_msgs/msg/String")
S = 1_000_000_000


def test_playing_keeps_the_distances(tmp_path: Path) -> None:
    path = tmp_path / "b.mcap"
    with BagWriter(path) as writer:
        for number in range(4):
            writer.write("/s", String(data=str(number)), 7 * S + number * S // 10)

    async def main() -> list[float]:
        now_s = asyncio.get_running_loop().time
        with BagReader(path) as reader:
            return [round(now_s(), 9) async for _ in reader.play(rate=2)]

    assert VirtualTimeLoop().run(main()) == [0.0, 0.05, 0.1, 0.15]
