"""Messages that wait until they can be transformed."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

import pytest
from std_msgs.msg import String
from support.transform_frames import S, message, moved
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import get_message
from rosidl_py_gen.message_filters import Cache, MessageFilter, StampError, Subscriber
from rosidl_py_gen.runtime import ClockType, Time
from rosidl_py_gen.tf import InvalidTransformError, TransformBroadcaster, TransformBuffer, TransformFilter

PointStamped: Any = get_message("geometry_msgs/msg/PointStamped")


def make_filter(**options: Any) -> tuple[MessageFilter, TransformBuffer, TransformFilter, list[Any]]:
    """Make a filter without nodes; the list contains the stamps of passed messages, in seconds."""
    source, buffer, seen = MessageFilter(), TransformBuffer(), []
    made = TransformFilter(source, buffer, options.pop("target", "map"), **options)
    made.register_callback(lambda one: seen.append(one.header.stamp.sec))
    return source, buffer, made, seen


def test_message_is_passed_when_its_transform_is_available() -> None:
    source, buffer, made, seen = make_filter()
    source.signal_message(message("PointStamped", "base", 2))
    source.signal_message(message("PointStamped", "base", 1))
    assert seen == [] and made.waiting == 2
    buffer.set_transform(moved("map", "base", 1))
    assert seen == [1]
    buffer.set_transform(moved("map", "base", 3))
    assert seen == [1, 2] and made.waiting == 0
    source.signal_message(message("PointStamped", "/base", 2.5))
    source.signal_message(message("PointStamped", "base", 0))
    assert seen == [1, 2, 2, 0]


def test_message_waits_for_all_targets_and_the_tolerance_interval() -> None:
    source, buffer, _, seen = make_filter(target=["map", "odom"], tolerance_s=0.5)
    for frame in ("map", "odom"):
        for second in (1, 2):
            buffer.set_transform(moved(frame, f"{frame}_base", second))
    buffer.set_transform(moved("map_base", "base", 0), static=True)
    source.signal_message(message("PointStamped", "base", 1.5))
    assert seen == []
    buffer.set_transform(moved("map", "odom", 0), static=True)
    assert seen == [1]
    source.signal_message(message("PointStamped", "base", 1.75))
    assert seen == [1]
    buffer.set_transform(moved("map", "map_base", 2.3))
    assert seen == [1, 1]


def test_dropped_messages_are_reported_with_the_missing_transform() -> None:
    lost: list[Any] = []
    source, buffer, made, seen = make_filter(
        queue_size=2, on_drop=lambda one, why: lost.append((one.header.stamp.sec, str(why)))
    )
    for second in (1, 2, 3):
        source.signal_message(message("PointStamped", "base", second))
    source.signal_message(message("PointStamped", "", 4))
    assert [second for second, _ in lost] == [1, 4] and made.dropped == 2
    assert (
        lost[0][1].startswith('the target frame "map" is not known') and "frame of the message is empty" in lost[1][1]
    )
    buffer.set_transform(moved("map", "base", 3))
    assert seen == [3] and made.waiting == 1


async def test_async_callbacks_may_wait_for_other_transforms(memory: World) -> None:
    robot, viewer = memory.pair()
    buffer, seen = TransformBuffer(viewer), []

    async def show(one: Any) -> None:
        later = await buffer.wait_for_transform("map", "base", one.header.stamp.sec * S + S, timeout_s=30)
        seen.append(later.translation[0])

    TransformFilter(Subscriber(viewer, PointStamped, "points"), buffer, "map", show, queue_size=5)
    moving, points = TransformBroadcaster(robot), robot.create_publisher(PointStamped, "points")
    for second in (1, 2, 3):
        points.publish(message("PointStamped", "base", second))
    for second in range(1, 5):
        moving.send(moved("map", "base", second, second))
        await asyncio.sleep(0.1)
    await until(lambda: len(seen) == 3)
    assert seen == [2, 3, 4]


async def test_async_callback_is_called_for_a_transform_set_directly(memory: World) -> None:
    source, buffer, _, _ = make_filter()
    seen: list[Any] = []
    made = TransformFilter(source, buffer, "map")

    async def show(one: Any) -> None:
        await asyncio.sleep(1)
        seen.append(one)

    made.register_callback(show)
    source.signal_message(message("PointStamped", "base", 1))
    buffer.set_transform(moved("map", "base", 1))
    await until(lambda: seen)


@pytest.mark.every_transport
async def test_filter_chain_from_topic_to_cache_passes_transformable_messages(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    robot, viewer = world.pair()
    points = Subscriber(viewer, PointStamped, "points")
    ready = TransformFilter(points, TransformBuffer(viewer), "map", queue_size=1)
    cache = Cache(ready, 10)
    publisher, moving = robot.create_publisher(PointStamped, "points"), TransformBroadcaster(robot)
    await publisher.wait_for_subscribers(20)
    await until(lambda: robot.count_subscribers("/tf") == 1)
    with caplog.at_level(logging.WARNING):
        for second in (1, 2):
            publisher.publish(message("PointStamped", "base", second))
        await until(lambda: ready.dropped == 1)
    assert 'dropped a message of frame "base" at 1.000000000 that waited for its transform (1 so far): ' in caplog.text
    deadline = 400
    while len(cache) < 1 and deadline:
        moving.send(moved("map", "base", 2))
        await asyncio.sleep(0.05)
        deadline -= 1
    assert cache.latest_stamp == 2 * S


async def test_backward_time_jump_discards_waiting_messages(memory: World) -> None:
    robot, viewer = memory.node("robot"), memory.node("viewer", args="--ros-args -p use_sim_time:=true")
    made = TransformFilter(Subscriber(viewer, PointStamped, "points"), TransformBuffer(viewer), "map")
    clock, publisher = robot.create_sim_time_publisher(), robot.create_publisher(PointStamped, "points")
    clock.set_time(Time(seconds=100, clock_type=ClockType.ROS_TIME))
    await until(lambda: viewer.clock.now().nanoseconds == 100 * S)
    publisher.publish(message("PointStamped", "base", 99))
    await until(lambda: made.waiting == 1)
    clock.set_time(Time(seconds=1, clock_type=ClockType.ROS_TIME))
    await until(lambda: made.waiting == 0)


async def test_invalid_arguments_are_refused(memory: World) -> None:
    source, buffer = MessageFilter(), TransformBuffer()
    for target in ("", "/map", ["map", 3]):
        with pytest.raises(InvalidTransformError, match="expected a target frame, without / in front, got "):
            TransformFilter(source, buffer, target)
    with pytest.raises(TypeError, match="source must be a filter"):
        TransformFilter("/points", buffer, "map")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="tolerance_s must be 0 or more"):
        TransformFilter(source, buffer, "map", tolerance_s=-1)
    with pytest.raises(StampError, match="has no header"):
        TransformFilter(Subscriber(memory.node(), String, "text"), buffer, "map")
    made = TransformFilter(source, buffer, "map")
    with pytest.raises(StampError, match="String"):
        source.signal_message(String())
    made.close()
    source.signal_message(message("PointStamped"))
    assert made.waiting == 0
