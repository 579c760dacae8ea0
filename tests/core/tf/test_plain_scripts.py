"""Transform buffers and filters in programs without an event loop, and in threads next to one."""

from __future__ import annotations

import asyncio
import threading
import time
from typing import Any

import numpy as np
import pytest
from support.inner_state import is_awaited
from support.transform_frames import S, filled, message, moved
from support.waiting import until
from support.worlds import World, entity

from rosidl_py_gen import get_message
from rosidl_py_gen.message_filters import ApproximateTimeSynchronizer, Cache, MessageFilter, Subscriber
from rosidl_py_gen.runtime import CallbackInUseError, ClosedError, WaitTimeoutError, WouldDeadlockError
from rosidl_py_gen.tf import (
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformBuffer,
    TransformFilter,
    TransformTimeoutError,
    UnknownFrameError,
)

pytestmark = pytest.mark.on_zenoh

PointStamped: Any = get_message("geometry_msgs/msg/PointStamped")


@pytest.mark.every_transport
def test_sync_waits_of_a_buffer_work_without_an_event_loop(world: World) -> None:
    robot, viewer = world.pair()
    buffer = TransformBuffer(viewer)
    static, moving = StaticTransformBroadcaster(robot), TransformBroadcaster(robot)
    static.send(moved("base_link", "lidar", x=0.5))
    assert np.allclose(buffer.wait_for_transform_sync("base_link", "lidar", timeout_s=10).translation, [0.5, 0, 0])
    entity(robot, "/tf").wait_for_subscribers_sync(10)
    moving.send([moved("map", "base_link", 1, 1), moved("map", "base_link", 3, 3)])
    point = buffer.wait_and_transform_sync(message("PointStamped", "lidar", 2), "map", timeout_s=10)
    assert point.header.frame_id == "map" and point.point.x == 2.5
    with pytest.raises(TransformTimeoutError, match=r'after 0\.05 s: .* "nowhere" is not known'):
        buffer.wait_for_transform_sync("map", "nowhere", timeout_s=0.05)


@pytest.mark.every_transport
def test_script_that_sleeps_finds_received_transforms(world: World) -> None:
    robot, viewer = world.pair()
    buffer, moving = TransformBuffer(viewer), TransformBroadcaster(robot)
    seen: list[float] = []
    TransformFilter(Subscriber(viewer, PointStamped, "points"), buffer, "map", lambda one: seen.append(one.point.x))
    points = robot.create_publisher(PointStamped, "points")
    entity(robot, "/tf").wait_for_subscribers_sync(10)
    points.wait_for_subscribers_sync(10)
    points.publish(message("PointStamped", "lidar", 1))
    with pytest.raises(UnknownFrameError):
        buffer.lookup_transform("map", "lidar")
    for second in (1, 2):
        moving.send(moved("map", "lidar", second, second))
        end_s = time.monotonic() + 10
        while not buffer.can_transform("map", "lidar", second * S) and time.monotonic() < end_s:
            time.sleep(0.01)
        assert buffer.lookup_transform("map", "lidar").translation[0] == second
    moving.send(moved("map", "camera", 1))
    while "camera" not in buffer.frames() and time.monotonic() < end_s:
        time.sleep(0.01)
    assert buffer.lookup_transform_full("lidar", 2 * S, "camera", 1 * S, "map").translation[0] == -2
    assert seen == [0]


async def test_sync_waits_work_in_threads_and_are_refused_in_the_event_loop(memory: World) -> None:
    robot, viewer = memory.pair()
    buffer, moving = TransformBuffer(viewer), TransformBroadcaster(robot)
    pairs = ApproximateTimeSynchronizer([Subscriber(viewer, PointStamped, topic) for topic in "ab"], slop_s=0.1)
    with pytest.raises(WouldDeadlockError, match=r"wait_for_transform_sync of <TransformBuffer of 0 frames> inside"):
        buffer.wait_for_transform_sync("map", "lidar")
    with pytest.raises(WouldDeadlockError, match="wait_and_transform_sync"):
        buffer.wait_and_transform_sync(PointStamped(), "map")
    with pytest.raises(WouldDeadlockError, match=r"receive_sync of <ApproximateTimeSynchronizer> inside"):
        pairs.receive_sync()
    waiting = asyncio.ensure_future(asyncio.to_thread(buffer.wait_for_transform_sync, "map", "lidar", timeout_s=30))
    receiving = asyncio.ensure_future(asyncio.to_thread(pairs.receive_sync, 30))
    await until(lambda: is_awaited(buffer) and is_awaited(pairs))
    moving.send(moved("map", "lidar", 1, 4))
    for topic in "ab":
        robot.create_publisher(PointStamped, topic).publish(message("PointStamped", stamp_s=1))
    assert (await waiting).translation[0] == 4
    assert len(await receiving) == 2


def test_sync_waits_of_objects_without_a_node_are_ended_by_other_threads() -> None:
    buffer, source = TransformBuffer(), MessageFilter()
    pairs = ApproximateTimeSynchronizer([source], slop_s=1)

    def feed() -> None:
        while not is_awaited(buffer):
            time.sleep(0.01)
        buffer.set_transform(moved("map", "lidar", 1, 4))
        while not is_awaited(pairs):
            time.sleep(0.01)
        source.signal_message(message("PointStamped", stamp_s=1))

    feeding = threading.Thread(target=feed)
    feeding.start()
    assert buffer.wait_for_transform_sync("map", "lidar", timeout_s=30).translation[0] == 4
    assert pairs.receive_sync(30).header.stamp.sec == 1
    feeding.join()
    with pytest.raises(WaitTimeoutError, match=r"passed nothing for 0\.01 s"):
        pairs.receive_sync(0.01)
    assert repr(filled()) == "<TransformBuffer of 6 frames>"

    async def refused() -> None:
        with pytest.raises(WouldDeadlockError):
            buffer.wait_for_transform_sync("map", "lidar")
        with pytest.raises(WouldDeadlockError):
            pairs.receive_sync()

    asyncio.run(refused())


@pytest.mark.every_transport
def test_a_script_receives_pairs_of_nodes_in_several_contexts(world: World) -> None:
    camera, left, right = (world.node(name) for name in ("camera", "left", "right"))
    inputs = [Subscriber(left, PointStamped, "left"), Subscriber(right, PointStamped, "right")]
    pairs, cache = ApproximateTimeSynchronizer(inputs, slop_s=0.1), Cache(inputs[1], 5)
    publishers = [camera.create_publisher(PointStamped, topic) for topic in ("left", "right")]
    for publisher in publishers:
        publisher.wait_for_subscribers_sync(10)
    for second in (1, 2):
        for publisher in publishers:
            publisher.publish(message("PointStamped", stamp_s=second))
        assert [one.header.stamp.sec for one in pairs.receive_sync(10)] == [second, second]
        assert cache.receive_sync(10).header.stamp.sec == second

    async def one_more() -> None:
        for publisher in publishers:
            publisher.publish(message("PointStamped", stamp_s=3))
        assert [one.header.stamp.sec for one in await pairs.receive(10)] == [3, 3]

    asyncio.run(one_more())
    inputs[0].register_callback(print)
    with pytest.raises(CallbackInUseError):
        inputs[0].receive_sync(1)


def test_a_closed_node_ends_the_waits_of_other_threads(memory: World) -> None:
    viewer = memory.node("viewer")
    buffer, errors = TransformBuffer(viewer), []
    subscriber = Subscriber(viewer, PointStamped, "a")
    pairs = ApproximateTimeSynchronizer([subscriber], slop_s=1)

    def wait(method: Any, *arguments: object) -> None:
        with pytest.raises(ClosedError) as raised:
            method(*arguments)
        errors.append(raised.value)

    threads = [
        threading.Thread(target=wait, args=arguments)
        for arguments in ((buffer.wait_for_transform_sync, "map", "lidar"), (pairs.receive_sync,))
    ]
    for thread in threads:
        thread.start()
    while not (is_awaited(buffer) and is_awaited(pairs)):
        time.sleep(0.01)
    viewer.close()
    for thread in threads:
        thread.join(10)
    assert len(errors) == 2
    with pytest.raises(ClosedError, match="node /viewer is closed"):
        buffer.wait_for_transform_sync("map", "lidar")
    assert not buffer.can_transform("map", "lidar")
    with pytest.raises(ClosedError, match="node /viewer is closed"):
        Cache(subscriber)


async def test_a_closed_node_ends_a_wait_on_the_loop(memory: World) -> None:
    viewer = memory.node("viewer")
    buffer = TransformBuffer(viewer)
    waiting = asyncio.ensure_future(buffer.wait_for_transform("map", "lidar"))
    await asyncio.sleep(0.1)
    viewer.close()
    with pytest.raises(ClosedError, match="node /viewer of the transform buffer is closed"):
        await waiting


def test_a_failure_of_a_callback_ends_a_lookup_with_on_error_raise(memory: World) -> None:
    robot = memory.node("robot")
    viewer = memory.node("viewer", on_error="raise")
    buffer, moving = TransformBuffer(viewer), TransformBroadcaster(robot)
    entity(robot, "/tf").wait_for_subscribers_sync(10)

    def fail() -> None:
        raise LookupError("of the callback")

    registration = buffer.register_callback(fail)
    moving.send(moved("map", "lidar", 1, 4))
    with pytest.raises(LookupError, match="of the callback"):
        buffer.lookup_transform("map", "lidar")
    registration.close()
    assert buffer.lookup_transform("map", "lidar").translation[0] == 4
