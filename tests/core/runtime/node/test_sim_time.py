"""Simulated time by the parameter (docs/internals/protocol.md 9.6); only tests of real time sleep."""

from __future__ import annotations

import asyncio
import math
import time
from functools import partial
from typing import Any

import pytest
from support.inner_state import scope_of
from support.waiting import until
from support.worlds import World, entity

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.clocks import Clock
from rosidl_py_gen.runtime.parameters.values import InvalidParameterValueError
from rosidl_py_gen.runtime.time_values import ClockType, ClockTypeError, Duration, Time, TimeRangeError

pytestmark = pytest.mark.on_zenoh


def ros(seconds: float) -> Time:
    return Time(seconds=seconds, clock_type=ClockType.ROS_TIME)


def has_time(clock: Clock, seconds: float) -> bool:
    return clock.now() == ros(seconds)


async def run_ready_callbacks() -> None:
    """Run all callbacks that are ready."""
    for _ in range(10):
        await asyncio.sleep(0)


@pytest.mark.every_transport
async def test_use_sim_time_can_be_switched_at_run_time(world: World) -> None:
    node, source = world.node("n"), world.node("source").create_sim_time_publisher()
    remote = world.node("other").create_parameter_client("/n")
    assert node.clock.now() > ros(1_000_000_000)
    assert (await remote.set({"use_sim_time": True}, 20))[0].successful
    assert node.clock.now() == ros(0)  # until the first /clock
    assert await source.wait_for_subscribers(20)
    source.set_time(ros(100))
    await until(lambda: node.clock.now() == ros(100))
    source.advance(2.5)
    await until(lambda: node.clock.now() == ros(102.5))
    source.advance(-50)
    await until(lambda: node.clock.now() == ros(52.5))
    assert (await remote.set({"use_sim_time": False}, 20))[0].successful
    assert node.clock.now() > ros(1_000_000_000)
    await until(lambda: entity(source, "/clock").subscription_count == 0)
    assert (await remote.set({"use_sim_time": True}, 20))[0].successful
    assert node.clock.now() == ros(0)


def test_node_without_time_source_ignores_use_sim_time(world: World) -> None:
    node = world.node("n", args="--ros-args -p use_sim_time:=true", time_source=False)
    assert not node.has_parameter("use_sim_time")
    assert node.declare_parameter("use_sim_time", False) is True  # a parameter as any other
    assert node.count_subscribers("/clock") == 0 and node.clock.now() > ros(1_000_000_000)
    node.clock.set_ros_time_override(ros(5))
    node.clock.enable_ros_time_override()
    assert has_time(node.clock, 5)
    other = world.node("other", context=node.context, args="")
    assert other.count_subscribers("/clock") == 1


@pytest.mark.parametrize("value", [1, "true", 1.0, [True]])
def test_use_sim_time_must_be_a_bool(world: World, value: object) -> None:
    node = world.node("n")
    assert not node.set_parameters({"use_sim_time": value})[0].successful
    assert node.get_parameter("use_sim_time", bool) is False
    node.undeclare_parameter("use_sim_time")
    with pytest.raises(InvalidParameterValueError, match="use_sim_time parameter set to something besides a bool"):
        node.declare_parameter("use_sim_time", value)


def test_time_source_changes_only_when_use_sim_time_changes(world: World) -> None:
    node = world.node("n")
    changes: list[str] = []
    node.clock.create_jump_callback(post=lambda jump: changes.append(jump.clock_change.name), on_clock_change=True)
    node.declare_parameter("other", True)
    for value in (False, True, True, False, False):
        node.set_parameter("use_sim_time", value)
    assert changes == ["ROS_TIME_ACTIVATED", "ROS_TIME_DEACTIVATED"]


@pytest.mark.every_transport
async def test_timers_follow_simulated_time(world: World) -> None:
    node = world.node("n", args="--ros-args -p use_sim_time:=true")
    source = world.node("source").create_sim_time_publisher()
    assert await source.wait_for_subscribers(20)
    calls: list[float] = []
    timer = node.create_timer(10.0, lambda: calls.append(node.clock.now().seconds))
    await run_ready_callbacks()
    assert calls == []
    for now in (100, 105, 111, 155):
        source.set_time(ros(now))
        await until(partial(has_time, node.clock, now))
        await run_ready_callbacks()
    # Created at 0: due at the first time, then on the grid of that one, missed periods skipped.
    assert calls == [100, 111, 155] and timer.missed == 9 + 3


async def test_clock_sleeps_in_real_time_without_sim_time(world: World) -> None:
    for kind in ClockType:
        clock = Clock(kind)
        start = clock.now()
        assert await clock.sleep_for(0.02)
        assert clock.now() - start >= Duration(seconds=0.02)
        assert await clock.sleep_until(start)
        assert await clock.sleep_for(Duration(seconds=-1))
    with pytest.raises(ClockTypeError, match="cannot sleep until a ROS_TIME"):
        await Clock(ClockType.STEADY_TIME).sleep_until(ros(1))


async def test_sim_time_publisher_rate_can_be_changed(world: World) -> None:
    node = world.node("n", args="--ros-args -p use_sim_time:=true")
    assert node.clock.ros_time_is_active and node.clock.now_ns() == 0
    source = world.node("source").create_sim_time_publisher(start=ros(50), period_s=0.002)
    await asyncio.sleep(0.1)
    assert source.now == ros(50)
    begin_s = time.monotonic()
    source.rate = 1.0
    await until(lambda: source.now > ros(50))
    ran = source.now - ros(50)
    assert ran < Duration(seconds=time.monotonic() - begin_s + 0.05)  # the 0.1 s before it ran do not count
    source.rate = 10_000.0
    await until(lambda: source.now > ros(70) and node.clock.now() > ros(70))
    source.rate = 0
    stopped = source.now
    await asyncio.sleep(0.02)
    assert source.now == stopped and source.rate == 0
    source.close()
    source.close()
    with pytest.raises(ClosedError):
        source.rate = 1


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"rate": math.nan}, TimeRangeError, "^rate.* must be finite, got nan"),
        ({"rate": math.inf}, TimeRangeError, "^rate.* must be finite"),
        ({"rate": -1}, TimeRangeError, "^rate.* must be 0 or more, got -1"),
        ({"rate": "fast"}, TypeError, "^rate must be a number of simulated seconds per second, got 'fast'"),
        ({"rate": None}, TypeError, "^rate must be a number"),
        ({"start": 5}, TypeError, "^start must be a Time such as .*, got 5"),
        ({"period_s": 0}, TimeRangeError, "^period_s.* must be more than 0"),
    ],
)
def test_sim_time_publisher_refuses_invalid_options(
    world: World, options: dict[str, Any], error: type[Exception], words: str
) -> None:
    node = world.node("source")
    before = len(scope_of(node).owned)
    with pytest.raises(error, match=words):
        node.create_sim_time_publisher(**options)
    assert len(scope_of(node).owned) == before
    if "rate" in options:
        source = node.create_sim_time_publisher(rate=1.0)
        with pytest.raises(error, match=words):
            source.rate = options["rate"]
        assert source.rate == 1.0


def test_sim_time_publisher_refuses_invalid_times_and_keeps_its_time(world: World) -> None:
    source = world.node("source").create_sim_time_publisher(start=ros(5))
    with pytest.raises(TypeError, match=r"^now must be a Time such as .*, got 5"):
        source.set_time(5)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^duration must be a number of seconds, got 'a'"):
        source.advance("a")  # type: ignore[arg-type]
    with pytest.raises(TimeRangeError, match=r"^duration must be finite"):
        source.advance(math.nan)
    with pytest.raises(TimeRangeError, match="int32"):
        source.set_time(ros(2**31))
    with pytest.raises(TimeRangeError, match="negative"):
        source.advance(-6)
    assert source.now == ros(5)
