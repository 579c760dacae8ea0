"""Simulated time through the parameter, without real sleeping (protocol.md 9.6)."""

from __future__ import annotations

import asyncio
from functools import partial

import pytest
from parameter_worlds import World, run, until

from rosidl_py_gen.runtime.clock import Clock, ClockType, ClockTypeError, Duration, Time, TimeRangeError
from rosidl_py_gen.runtime.clock_sleep import Rate


def ros(seconds: float) -> Time:
    return Time(seconds=seconds, clock_type=ClockType.ROS_TIME)


def reads(clock: Clock, seconds: float) -> bool:
    return clock.now() == ros(seconds)


def test_use_sim_time_is_live(world: World) -> None:
    """r2r reads it once and never again (r2r.md A8)."""

    async def main() -> None:
        node, source = world.node("n"), world.node("source").create_sim_time_publisher()
        remote = world.node("other").create_parameter_client("/n")
        assert node.clock.now() > ros(1_000_000_000)
        assert (await remote.set({"use_sim_time": True}, 5))[0].successful
        assert node.clock.now() == ros(0)  # until the first /clock
        assert await source.wait_for_subscribers(5)
        source.set_time(ros(100))
        await until(lambda: node.clock.now() == ros(100))
        source.advance(2.5)
        await until(lambda: node.clock.now() == ros(102.5))
        source.advance(-50)
        await until(lambda: node.clock.now() == ros(52.5))
        assert (await remote.set({"use_sim_time": False}, 5))[0].successful
        assert node.clock.now() > ros(1_000_000_000)
        await until(lambda: source._publisher.subscription_count == 0)
        assert (await remote.set({"use_sim_time": True}, 5))[0].successful
        assert node.clock.now() == ros(0)

    run(main)


@pytest.mark.parametrize("value", [1, "true", 1.0])
def test_something_else_than_a_bool_is_refused(world: World, value: object) -> None:
    node = world.node("n")
    assert not node.set_parameters({"use_sim_time": value})[0].successful
    assert node.get_parameter("use_sim_time", bool) is False


def test_it_can_be_given_at_the_start(world: World) -> None:
    node = world.node("n", args="--ros-args -p use_sim_time:=true")
    assert node.clock.ros_time_is_active and node.clock.now_ns() == 0


def test_timers_follow_simulated_time(world: World) -> None:
    async def main() -> None:
        node = world.node("n", args="--ros-args -p use_sim_time:=true")
        source = world.node("source").create_sim_time_publisher()
        assert await source.wait_for_subscribers(5)
        calls: list[float] = []
        timer = node.create_timer(10.0, lambda: calls.append(node.clock.now().seconds))
        await asyncio.sleep(0.02)
        assert calls == []
        for now in (100, 105, 111, 155):
            source.set_time(ros(now))
            await until(partial(reads, node.clock, now))
            await asyncio.sleep(0)
            await asyncio.sleep(0)
        # Created at 0: due at the first time, then on the grid of that one, missed periods skipped.
        assert calls == [100, 111, 155] and timer.missed == 9 + 3

    run(main)


def test_sleeping_by_simulated_time(world: World) -> None:
    async def main() -> None:
        node = world.node("n", args="--ros-args -p use_sim_time:=true")
        source = world.node("source").create_sim_time_publisher()
        assert await source.wait_for_subscribers(5)
        until_task = asyncio.ensure_future(node.clock.sleep_until(ros(110)))
        for_task = asyncio.ensure_future(node.clock.sleep_for(5))
        zero_task = asyncio.ensure_future(node.clock.sleep_until(ros(0)))
        await asyncio.sleep(0.02)
        assert not (until_task.done() or for_task.done() or zero_task.done())
        source.set_time(ros(100))
        await zero_task
        await asyncio.sleep(0.02)
        assert not (until_task.done() or for_task.done())
        source.set_time(ros(106))
        await for_task
        source.set_time(ros(50))
        await asyncio.sleep(0.02)
        assert not until_task.done()
        source.set_time(ros(110))
        await until_task
        assert node.clock._handles == []

    run(main)


def test_a_rate_stays_on_its_grid(world: World) -> None:
    async def main() -> None:
        clock = Clock(ClockType.ROS_TIME)
        clock.enable_ros_time_override()
        clock.set_ros_time_override(ros(10))
        rate = Rate(clock, 1)
        rounds: list[float] = []

        async def loop() -> None:
            while True:
                await rate.sleep()
                rounds.append(clock.now().seconds)

        task = asyncio.ensure_future(loop())
        for now in (10.5, 11.2, 11.9, 12.0, 14.7, 14.9, 15.1, 5.0, 5.9, 6.0):
            await asyncio.sleep(0.005)
            clock.set_ros_time_override(ros(now))
        await asyncio.sleep(0.005)
        task.cancel()
        assert rounds == [11.2, 12.0, 14.7, 15.1]
        with pytest.raises(TimeRangeError):
            Rate(clock, 0)

    run(main)


def test_sleeping_by_real_clocks(world: World) -> None:
    async def main() -> None:
        for kind in ClockType:
            clock = Clock(kind)
            start = clock.now()
            await clock.sleep_for(0.02)
            assert clock.now() - start >= Duration(seconds=0.02)
            await clock.sleep_until(start)
            await clock.sleep_for(Duration(seconds=-1))
        with pytest.raises(ClockTypeError, match="cannot sleep until a ROS_TIME"):
            await Clock(ClockType.STEADY_TIME).sleep_until(ros(1))

    run(main)


def test_activation_ends_a_sleep_only_when_its_time_has_come(world: World) -> None:
    async def main() -> None:
        node = world.node("n")
        task = asyncio.ensure_future(node.clock.sleep_for(3600))
        await asyncio.sleep(0.01)
        node.set_parameter("use_sim_time", True)
        node.clock.set_ros_time_override(ros(2_000_000_000_0))
        await asyncio.wait_for(task, 5)

    run(main)


def test_a_publisher_with_a_rate_runs_by_itself(world: World) -> None:
    async def main() -> None:
        node = world.node("n", args="--ros-args -p use_sim_time:=true")
        source = world.node("source").create_sim_time_publisher(rate=1000.0, start=ros(50), period_s=0.002)
        await until(lambda: node.clock.now() > ros(55))
        source.rate = 0
        await asyncio.sleep(0.02)
        stopped = source.now
        await asyncio.sleep(0.02)
        assert source.now == stopped
        source.close()
        source.close()

    run(main)
