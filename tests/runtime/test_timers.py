"""Timers on a running loop; their arithmetic is tested in runtime_pure."""

from __future__ import annotations

import asyncio
import logging
import time
from typing import TYPE_CHECKING

import pytest

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import ClockType, Duration, Time

if TYPE_CHECKING:
    from .conftest import World


async def test_ticks_come_at_the_period_and_do_not_drift(memory: World) -> None:
    node = memory.node("n")
    start = time.monotonic()
    timer = node.create_wall_timer(0.02)
    for _ in range(10):
        await timer.tick()
        await asyncio.sleep(0.005)
    assert 0.19 <= time.monotonic() - start <= 0.26


async def test_missed_ticks_are_skipped_and_counted(memory: World) -> None:
    timer = memory.node("n").create_timer(0.01)
    time.sleep(0.055)
    since_last = await timer.tick()
    assert since_last.seconds >= 0.05
    assert timer.missed == 4
    assert timer.call_count == 1


async def test_plain_and_async_callbacks(memory: World) -> None:
    node = memory.node("n")
    calls: list[str] = []

    async def slow() -> None:
        calls.append("slow")
        await asyncio.sleep(0.035)

    node.create_timer(0.01, lambda: calls.append("plain"))
    slow_timer = node.create_timer(0.01, slow)
    await asyncio.sleep(0.105)
    assert 7 <= calls.count("plain") <= 11
    assert 2 <= calls.count("slow") <= 4
    assert slow_timer.missed >= 4


async def test_a_failing_callback_is_logged_and_called_again(memory: World, caplog: pytest.LogCaptureFixture) -> None:
    count = 0

    def callback() -> None:
        nonlocal count
        count += 1
        raise ValueError("tick tock")

    memory.node("n").create_timer(0.01, callback)
    with caplog.at_level(logging.ERROR):
        await asyncio.sleep(0.06)
    assert count >= 3
    assert "tick tock" in caplog.text


async def test_cancel_and_reset(memory: World) -> None:
    calls: list[float] = []
    timer = memory.node("n").create_timer(0.01, lambda: calls.append(time.monotonic()))
    timer.cancel()
    assert timer.is_canceled and timer.time_until_next_call() is None
    await asyncio.sleep(0.03)
    assert calls == []
    timer.reset()
    await asyncio.sleep(0.03)
    assert calls


async def test_simulated_time_drives_timers(memory: World) -> None:
    node = memory.node("n")
    clock = node.clock
    clock.enable_ros_time_override()
    calls: list[int] = []
    node.create_timer(1.0, lambda: calls.append(clock.now_ns()))
    await asyncio.sleep(0.02)
    assert calls == []  # the clock has not started
    for second in (10, 11, 12):
        clock.set_ros_time_override(Time(seconds=second, clock_type=ClockType.ROS_TIME))
        await asyncio.sleep(0.01)
    assert calls[-1] == 12_000_000_000
    assert len(calls) >= 2


async def test_the_iterator_ends_and_tick_raises_when_the_timer_closes(memory: World) -> None:
    timer = memory.node("n").create_timer(100)

    async def iterate() -> int:
        return len([tick async for tick in timer])

    iterating = asyncio.create_task(iterate())
    ticking = asyncio.create_task(timer.tick())
    await asyncio.sleep(0.01)
    timer.close()
    timer.close()
    assert await iterating == 0
    with pytest.raises(ClosedError):
        await ticking


async def test_a_timer_with_callback_cannot_be_awaited(memory: World) -> None:
    with pytest.raises(TypeError, match="callback"):
        await memory.node("n").create_timer(1, print).tick()


async def test_the_period_can_change(memory: World) -> None:
    timer = memory.node("n").create_timer(100)
    assert timer.period == Duration(seconds=100)
    timer.change_period(0.01)
    timer.reset()
    await asyncio.wait_for(timer.tick(), 1)
