"""Sleeps and rates on a clock that jumps or changes its source (docs/internals/protocol.md 9.6), without real sleeping.

Facts of rclpy: a sleep ends with False when ROS time is activated or deactivated; a Rate is a timer.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable
from typing import Any

import pytest
from support.waiting import run, until
from support.worlds import World

from rosidl_py_gen.runtime.clocks import Clock, Rate
from rosidl_py_gen.runtime.time_values import ClockType, ClockTypeError, Duration, Time, TimeRangeError
from rosidl_py_gen.runtime.transport.memory import MemoryTransport

pytestmark = pytest.mark.on_zenoh

STEPS = 5
"""Iterations of the event loop after which every task that can resume has resumed."""


def ros(seconds: float) -> Time:
    return Time(seconds=seconds, clock_type=ClockType.ROS_TIME)


class Simulation:
    def __init__(self, start: float | None = 10) -> None:
        self.system_s = 1_700_000_000.0
        self.clock = Clock(ClockType.ROS_TIME, system_ns=lambda: round(self.system_s * 1e9))
        if start is not None:
            self.clock.set_ros_time_override(ros(start))
            self.clock.enable_ros_time_override()

    async def at(self, *seconds: float) -> None:
        for second in seconds:
            self.clock.set_ros_time_override(ros(second))
            await self.settle()

    @staticmethod
    async def settle() -> None:
        for _ in range(STEPS):
            await asyncio.sleep(0)

    async def start(self, sleep: Awaitable[bool]) -> asyncio.Future[bool]:
        task = asyncio.ensure_future(sleep)
        await self.settle()
        return task

    async def rounds(self, frequency_hz: float) -> list[float]:
        seen: list[float] = []
        rate = Rate(self.clock, frequency_hz)

        async def loop() -> None:
            while True:
                await rate.sleep()
                seen.append(self.clock.now().seconds)

        self.task = asyncio.ensure_future(loop())
        await self.settle()
        return seen


async def test_rate_keeps_its_grid_and_restarts_after_backward_jump() -> None:
    simulation = Simulation(10)
    rounds = await simulation.rounds(1)
    await simulation.at(10.5, 11.2, 11.9, 12.0, 14.7, 14.9, 15.1, 5.0, 5.9, 6.0, 6.5, 7.0)
    assert rounds == [11.2, 12.0, 14.7, 15.1, 6.0, 7.0]
    simulation.task.cancel()


async def test_rate_restarts_after_backward_jump_between_two_sleeps() -> None:
    simulation = Simulation(100)
    rate = Rate(simulation.clock, 10)
    first = await simulation.start(rate.sleep())  # type: ignore[arg-type]
    await simulation.at(100.1)
    assert first.done()
    await simulation.at(10)  # while the loop's body runs
    second = await simulation.start(rate.sleep())  # type: ignore[arg-type]
    await simulation.at(10.05)
    assert not second.done()
    await simulation.at(10.1)
    assert second.done()


@pytest.mark.parametrize("begins_at", [0.5, 50])
async def test_rate_continues_after_activation_and_deactivation_of_sim_time(begins_at: float) -> None:
    simulation = Simulation(None)
    rounds = await simulation.rounds(10)
    simulation.clock.enable_ros_time_override()
    await simulation.settle()
    assert rounds == []  # the clock reads 0: nothing is due
    first = begins_at
    await simulation.at(first, first + 0.05, first + 0.1, first + 0.2)
    assert rounds == [first + 0.1, first + 0.2]
    simulation.clock.disable_ros_time_override()
    await simulation.settle()
    simulation.system_s += 0.11
    await until(lambda: len(rounds) == 3)  # system time is polled
    simulation.task.cancel()


async def test_time_source_change_between_two_sleeps_restarts_the_rate() -> None:
    simulation = Simulation(10)
    rate = Rate(simulation.clock, 1)
    first = await simulation.start(rate.sleep())  # type: ignore[arg-type]
    await simulation.at(11)
    assert first.done()
    simulation.clock.disable_ros_time_override()
    simulation.clock.set_ros_time_override(ros(3))
    simulation.clock.enable_ros_time_override()
    second = await simulation.start(rate.sleep())  # type: ignore[arg-type]
    await simulation.at(3.9)
    assert not second.done()
    await simulation.at(4)
    assert second.done()


def test_overdue_rate_lets_other_tasks_run() -> None:
    async def main() -> None:
        simulation = Simulation(10)
        rate = Rate(simulation.clock, 10)
        others = 0

        async def other() -> None:
            nonlocal others
            while True:
                others += 1
                await asyncio.sleep(0)

        first = await simulation.start(rate.sleep())  # type: ignore[arg-type]
        await simulation.at(11)
        assert first.done()
        task = asyncio.ensure_future(other())
        for now in range(12, 32):
            simulation.clock.set_ros_time_override(ros(now))  # each round takes ten periods
            await rate.sleep()
        assert others >= 20
        task.cancel()

    run(main)


@pytest.mark.parametrize("activate", [True, False])
@pytest.mark.parametrize("kind", ["until", "for"])
async def test_time_source_change_ends_a_sleep_with_false(activate: bool, kind: str) -> None:
    simulation = Simulation(None if activate else 10)
    clock = simulation.clock
    now = clock.now()
    sleep = clock.sleep_until(now + Duration(seconds=3600)) if kind == "until" else clock.sleep_for(3600)
    task = await simulation.start(sleep)
    assert not task.done()
    if activate:
        clock.enable_ros_time_override()
    else:
        clock.disable_ros_time_override()
    assert await asyncio.wait_for(task, 20) is False
    assert list(clock._jump_callbacks) == []


@pytest.mark.every_transport
def test_sleep_started_before_use_sim_time_ends_when_sim_time_is_activated(world: World) -> None:
    async def main() -> None:
        node, source = world.node("n"), world.node("source").create_sim_time_publisher()
        sleep = asyncio.ensure_future(node.clock.sleep_for(60))
        rate, rounds = node.create_rate(10), 0

        async def loop() -> None:
            nonlocal rounds
            while True:
                await rate.sleep()
                rounds += 1

        task = asyncio.ensure_future(loop())
        await asyncio.sleep(0)  # both are sleeping now
        node.set_parameter("use_sim_time", True)
        assert await asyncio.wait_for(sleep, 20) is False
        assert await source.wait_for_subscribers(20)
        source.set_time(ros(100))
        await until(lambda: node.clock.now() == ros(100))
        before = rounds
        for _ in range(3):
            source.advance(0.1)
            now = source.now
            await until(lambda now=now: node.clock.now() == now)  # type: ignore[misc]
            await Simulation.settle()
        assert rounds - before >= 2
        task.cancel()

    run(main)


async def test_sleep_for_restarts_after_backward_jump() -> None:
    simulation = Simulation(100)
    for_task = await simulation.start(simulation.clock.sleep_for(0.3))
    until_task = await simulation.start(simulation.clock.sleep_until(ros(100.3)))
    await simulation.at(100.2, 10, 10.2)
    assert not for_task.done()
    await simulation.at(10.3)
    assert for_task.result() is True
    assert not until_task.done()  # sleep_until waits for the absolute time, as in rclpy
    await simulation.at(100.3)
    assert until_task.result() is True


async def test_no_sleep_ends_before_simulated_time_starts() -> None:
    simulation = Simulation(0)
    clock = simulation.clock
    sleeps = clock.sleep_until(ros(110)), clock.sleep_for(5), clock.sleep_until(ros(0))
    tasks = [await simulation.start(sleep) for sleep in sleeps]
    for now, done in ((0, []), (100, [2]), (106, [1, 2]), (50, [1, 2])):
        await simulation.at(now)
        assert [number for number, task in enumerate(tasks) if task.done()] == done
    clock.disable_ros_time_override()
    assert await asyncio.wait_for(tasks[0], 20) is False
    assert list(clock._jump_callbacks) == []


async def test_sleep_ends_if_its_time_was_reached_before_a_backward_jump() -> None:
    simulation = Simulation(10)
    tasks = [await simulation.start(sleep) for sleep in (simulation.clock.sleep_for(1), simulation.clock.sleep_for(9))]
    simulation.clock.set_ros_time_override(ros(11))
    simulation.clock.set_ros_time_override(ros(2))
    await simulation.settle()
    assert [task.done() for task in tasks] == [True, False]
    assert tasks[0].result() is True
    tasks[1].cancel()
    await simulation.settle()
    assert list(simulation.clock._jump_callbacks) == []


async def test_sleeps_refuse_invalid_arguments() -> None:
    clock = Clock(ClockType.STEADY_TIME)
    with pytest.raises(TypeError, match=r"^until must be a Time such as .*, got 5"):
        await clock.sleep_until(5)  # type: ignore[arg-type]
    with pytest.raises(ClockTypeError, match="cannot sleep until a ROS_TIME"):
        await clock.sleep_until(ros(1))
    for wrong in ("1", None, True):
        with pytest.raises(TypeError, match=r"^duration must be a number of seconds"):
            await clock.sleep_for(wrong)  # type: ignore[arg-type]
    for endless in (math.nan, math.inf):
        with pytest.raises(TimeRangeError, match=r"^duration must be finite"):
            await clock.sleep_for(endless)


@pytest.mark.parametrize(
    ("frequency", "error"),
    [
        ("a", TypeError),
        (None, TypeError),
        (True, TypeError),
        (0, TimeRangeError),
        (-1, TimeRangeError),
        (math.nan, TimeRangeError),
        (math.inf, TimeRangeError),
        (1e10, TimeRangeError),
        (5e-324, TimeRangeError),
    ],
)
def test_rate_refuses_invalid_frequencies(frequency: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match=r"^frequency_hz must be"):
        Rate(Clock(), frequency)
    world = World("memory")
    assert isinstance(world.transport, MemoryTransport)
    with pytest.raises(error, match=r"^frequency_hz must be"):
        world.node("n").create_rate(frequency)
    world.close()
