"""Timers on a running loop; `time/test_schedule.py` tests their arithmetic."""

from __future__ import annotations

import asyncio
import gc
import threading
import time
from typing import TYPE_CHECKING, Any

import pytest
from support.waiting import until, while_the_loop_sleeps

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import Clock, ClockType, Duration

if TYPE_CHECKING:
    from support.worlds import World


async def test_timer_ticks_at_its_period_without_drift(memory: World) -> None:
    now_s = asyncio.get_running_loop().time
    began = now_s()
    timer = memory.node("n").create_wall_timer(0.02)
    ticks = []
    for _ in range(10):
        await timer.tick()
        ticks.append(round(now_s() - began, 9))
        await asyncio.sleep(0.015)  # 0.035 if the period began with the tick
    assert ticks == [round(0.02 * number, 9) for number in range(1, 11)]
    assert timer.missed == 0


async def test_missed_timer_ticks_are_skipped_and_counted(memory: World) -> None:
    timer = memory.node("n").create_timer(0.01)
    loop: Any = asyncio.get_running_loop()
    loop.advance_s(0.055)  # something holds it up
    since_last = await timer.tick()
    assert (round(since_last.seconds, 6), timer.missed, timer.call_count) == (0.055, 4, 1)


async def test_timer_follows_a_system_clock_that_is_set_forward(memory: World) -> None:
    now_s, set_ns = asyncio.get_running_loop().time, 0
    clock = Clock(ClockType.SYSTEM_TIME, system_ns=lambda: round(now_s() * NS_PER_S) + set_ns)
    timer = memory.node("n").create_timer(3600.0, clock=clock)
    tick = asyncio.ensure_future(timer.tick())
    await asyncio.sleep(0.5)
    set_ns = 3600 * NS_PER_S
    began = now_s()
    await tick
    assert now_s() - began <= 1.0


async def test_closing_timer_ends_iteration_and_raises_in_tick(memory: World) -> None:
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


async def test_timer_period_can_be_changed(memory: World) -> None:
    timer = memory.node("n").create_timer(100)
    assert timer.period == Duration(seconds=100)
    timer.change_period(0.01)
    timer.reset()
    await asyncio.wait_for(timer.tick(), 10)


async def test_closing_node_cancels_running_timer_callback_silently(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = memory.node("n")
    ends: list[str] = []

    async def wait_forever() -> None:
        try:
            await asyncio.sleep(60)
        except asyncio.CancelledError:
            ends.append("cancelled")
            raise

    timer = node.create_timer(0.01, wait_forever)
    await until(lambda: timer.missed > 0)
    node.close()
    await until(lambda: bool(ends))
    assert ends == ["cancelled"]
    assert caplog.text == ""


@pytest.mark.filterwarnings("error")
async def test_a_plain_callback_that_returns_a_coroutine_is_awaited(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    running = most = runs = 0

    async def work() -> None:
        nonlocal running, most, runs
        running += 1
        most = max(most, running)
        await asyncio.sleep(0.025)
        running -= 1
        runs += 1
        raise ValueError("after the work")

    timer = world.node("n").create_timer(0.01, lambda: work())
    await until(lambda: runs >= 3)
    timer.close()
    gc.collect()
    assert most == 1
    assert timer.missed >= runs
    assert "after the work" in caplog.text and "never awaited" not in caplog.text


@pytest.mark.real_time("the thread is over before the timer is due")
async def test_timer_created_in_another_thread_calls_back_on_the_loop_in_time(world: World) -> None:
    node = world.node("n")
    await node.create_timer(0.001).tick()  # the loop is attached
    calls: list[tuple[float, int]] = []
    made: list[float] = []
    idle = asyncio.get_running_loop().create_future()

    def called() -> None:
        calls.append((time.monotonic(), threading.get_ident()))
        if len(calls) == 3:
            idle.set_result(None)

    def make() -> None:
        made.append(time.monotonic())
        node.create_timer(0.05, called)

    thread = while_the_loop_sleeps(make)
    start = time.monotonic()
    await asyncio.wait({idle}, timeout=20)  # nothing else wakes the loop
    thread.join()
    assert time.monotonic() - start < 10
    assert len(calls) >= 3 and {ident for _, ident in calls} == {threading.get_ident()}
    assert calls[0][0] - made[0] >= 0.05


async def test_closing_timer_in_another_thread_wakes_pending_tick(world: World) -> None:
    node = world.node("n")
    timer = node.create_timer(100)
    start = time.monotonic()
    ticking = asyncio.ensure_future(timer.tick())
    closing = while_the_loop_sleeps(timer.close)
    await asyncio.wait({ticking}, timeout=20)  # nothing else wakes the loop
    closing.join()
    assert time.monotonic() - start < 10
    with pytest.raises(ClosedError, match="timer"):
        ticking.result()


@pytest.mark.real_time("the thread is over before the timer is due")
async def test_timer_can_be_cancelled_and_reset_in_another_thread(world: World) -> None:
    node = world.node("n")
    done = asyncio.get_running_loop().create_future()
    timer = node.create_timer(0.05, lambda: done.done() or done.set_result(time.monotonic()))
    timer.cancel()
    assert timer.is_canceled and timer.time_until_next_call() is None
    again: list[float] = []

    def reset() -> None:
        again.append(time.monotonic())
        timer.reset()

    thread = while_the_loop_sleeps(reset)
    await asyncio.wait({done}, timeout=20)  # nothing else wakes the loop
    thread.join()
    assert 0.04 <= done.result() - again[0] <= 10
    await asyncio.to_thread(timer.cancel)
    calls, other = timer.call_count, node.create_timer(0.05)
    for _ in range(3):
        await other.tick()
    assert timer.call_count == calls


async def test_a_closed_timer_cannot_be_reset(memory: World) -> None:
    node = memory.node("n")
    timer, other = node.create_timer(1, print), node.create_timer(1)
    timer.close()
    with pytest.raises(ClosedError, match="a timer of node /n is closed"):
        timer.reset()
    node.close()
    with pytest.raises(ClosedError, match="/n"):
        other.reset()
