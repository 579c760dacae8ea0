"""Playing a bag: when its messages come."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.mcap import BagReader, BagWriter

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

String: Any = get_message("std_msgs/msg/String")
S = 1_000_000_000


def test_playing_keeps_the_distances(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Never early, and what it waits for is no more than the distances, whatever holds it up."""
    path = tmp_path / "b.mcap"
    with BagWriter(path) as writer:
        for number in range(4):
            writer.write("/s", String(data=str(number)), 7 * S + number * S // 10)
    sleep, asked_s = asyncio.sleep, list[float]()

    async def watched(delay_s: float) -> None:
        asked_s.append(delay_s)
        await sleep(delay_s)

    async def main() -> list[float]:
        with BagReader(path) as reader:
            began = time.monotonic()
            return [time.monotonic() - began async for _ in reader.play(rate=2)]

    monkeypatch.setattr(asyncio, "sleep", watched)
    times = asyncio.run(main())
    assert all(came >= number / 20 - 0.005 for number, came in enumerate(times)) and len(times) == 4
    assert sum(asked_s) <= 0.16
