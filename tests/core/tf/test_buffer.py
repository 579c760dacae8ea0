"""Transform buffer: lookups, errors, and nodes that feed it."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import numpy as np
import pytest
from support.transform_frames import LEVEL, QUARTER, S, filled, moved
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import EncodeError, get_message
from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.tf import (
    ConnectivityError,
    ExtrapolationError,
    InvalidTransformError,
    StaticTransformBroadcaster,
    Transform,
    TransformBroadcaster,
    TransformBuffer,
    TransformError,
    TransformTimeoutError,
    UnknownFrameError,
)

pytestmark = pytest.mark.on_zenoh

TransformStamped: Any = get_message("geometry_msgs/msg/TransformStamped")
TFMessage: Any = get_message("tf2_msgs/msg/TFMessage")


def test_lookup_composes_transforms_through_the_tree() -> None:
    found = filled().lookup_transform("map", "lidar")
    assert (found.target, found.source, found.stamp) == ("map", "lidar", 3 * S)
    assert np.allclose(found.apply([[1, 0, 0], [0, 0, 2]]), [[13.5, 1, 0], [13.5, 0, 2]])
    assert np.allclose(found.rotate([1, 0, 0]), [0, 1, 0])
    assert np.allclose(found.matrix @ (1, 0, 0, 1), (13.5, 1, 0, 1))
    assert np.allclose(found.inverse().apply([13.5, 1, 0]), [1, 0, 0])
    assert np.allclose((found.inverse() @ found).matrix, np.eye(4))


def test_lookup_between_two_stamps_is_interpolated() -> None:
    buffer = filled()
    found = buffer.lookup_transform("odom", "base_link", round(1.25 * S))
    assert np.allclose(found.translation, [1.25, 0, 0]) and found.stamp == round(1.25 * S)
    for sign in (1, -1):  # the same rotation, by the shorter arc
        buffer.set_transform(moved("base_link", f"arm{sign}", 1))
        buffer.set_transform(moved("base_link", f"arm{sign}", 2, rotation=sign * QUARTER))
        turned = buffer.lookup_transform("base_link", f"arm{sign}", round(1.5 * S)).apply([1, 0, 0])
        assert np.allclose(turned, [math.sqrt(0.5), math.sqrt(0.5), 0])


def test_full_lookup_relates_two_times_through_a_fixed_frame() -> None:
    found = filled().lookup_transform_full("base_link", 3 * S, "base_link", 1 * S, "map")
    assert np.allclose(found.translation, [-2, 0, 0])
    assert found.stamp == 3 * S


LATE = (
    'from "lidar" to "map": the transform of "base_link" in "odom" needs extrapolation into the future: '
    "requested 4.0*, 1 s after the latest, 3.0*"
)


@pytest.mark.parametrize(
    ("question", "error", "text"),
    [
        (("map", "base_lnk"), UnknownFrameError, 'the source frame "base_lnk" is not known; did you mean "base_link"'),
        (("nowhere", "map"), UnknownFrameError, "known: base_link, camera, lidar, map, odom, tool"),
        (("map", "camera"), ConnectivityError, '"map" and "camera" are not connected.*trees of "map" and "tool"'),
        (("map", "lidar", 4 * S), ExtrapolationError, LATE),
        (("map", "lidar", S // 2), ExtrapolationError, "0.5 s before the earliest, 1.000000000"),
        (("tool", "camera", 2 * S), ExtrapolationError, "only 1.000000000 is in the buffer"),
        (("", "map"), InvalidTransformError, "the target frame is empty"),
        (("map", "/odom"), InvalidTransformError, "begins with /"),
    ],
)
def test_lookup_errors_state_missing_and_known_frames(question: Any, error: type[Exception], text: str) -> None:
    buffer = filled()
    with pytest.raises(error, match=text):
        buffer.lookup_transform(*question)
    assert not buffer.can_transform(*question)


def test_extrapolation_error_states_a_transform_between_the_two_frames() -> None:
    buffer = TransformBuffer()
    for stamp in (1, 2):  # odom lacks the time, too, but nothing between camera and lidar needs it
        buffer.set_transform(moved("odom", "base", stamp))
        buffer.set_transform(moved("base", "lidar", stamp))
    for stamp in (1, 2, 3, 4):
        buffer.set_transform(moved("base", "camera", stamp))
        buffer.set_transform(moved("base", "wheel", stamp + 4))
    for target, source, time, frame, direction in (
        ("camera", "lidar", 3 * S, "lidar", "future"),
        ("lidar", "camera", 3 * S, "lidar", "future"),
        ("camera", "lidar", S // 2, "lidar", "past"),
        ("wheel", "camera", 4 * S, "wheel", "past"),
        ("odom", "camera", 3 * S, "base", "future"),
        ("base", "wheel", 3 * S, "wheel", "past"),
    ):
        with pytest.raises(ExtrapolationError, match=f'of "{frame}" in .* into the {direction}') as raised:
            buffer.lookup_transform(target, source, time)
        assert (raised.value.frame, raised.value.direction) == (frame, direction)


def test_a_stamp_far_in_the_future_blocks_no_more_than_two_later_transforms() -> None:
    buffer = TransformBuffer()
    buffer.set_transform(moved("map", "base", 1))
    buffer.set_transform(moved("map", "base", 2**31 - 1))
    for stamp in (2, 3):
        with pytest.raises(InvalidTransformError, match="before the latest"):
            buffer.set_transform(moved("map", "base", stamp))
    buffer.set_transform(moved("map", "base", 4, 7))
    assert buffer.lookup_transform("map", "base").stamp == 4 * S and buffer.can_transform("map", "base", 2 * S)
    buffer.set_transform(moved("map", "base", 100))
    for _ in range(9):  # the same again, or by turns with what is right: still refused
        with pytest.raises(InvalidTransformError):
            buffer.set_transform(moved("map", "base", 4))
    for stamp in range(5, 10):
        with pytest.raises(InvalidTransformError):
            buffer.set_transform(moved("map", "base", stamp))
        buffer.set_transform(moved("map", "base", 100 + stamp))


def test_frame_names_in_errors_are_truncated_and_printable() -> None:
    long = "\x1b[31m" * 100_000
    buffer = filled()
    for child in ("a", "b"):
        buffer.set_transform(moved(long + child, child, 1))
    buffer.set_transform(moved("a", "c", 1))
    buffer.set_transform(moved("a", "c", 2))
    for target, source, time in (
        ("nowhere", "map", 0), ("a", "b", 0), (long + "a", long + "b", 0), (long + "a", "c", 9 * S), (long, "map", 0),
    ):  # fmt: skip
        with pytest.raises((TransformError, InvalidTransformError)) as raised:
            buffer.lookup_transform(target, source, time)
        assert len(str(raised.value)) < 3000 and "\x1b" not in str(raised.value)
    for parent, child in ((long, long), (long, ""), (long, "map"), ("map", long)):
        with pytest.raises(InvalidTransformError) as refused:
            buffer.set_transform(moved(parent, child, 1, rotation=9 * QUARTER))
        assert len(str(refused.value)) < 500 and "\x1b" not in str(refused.value)


def test_lookup_in_an_empty_buffer_states_that_no_frame_is_known() -> None:
    with pytest.raises(UnknownFrameError, match="known: none"):
        TransformBuffer().lookup_transform("map", "odom")
    assert TransformBuffer().lookup_transform("map", "map").translation.tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("transform", "text"),
    [
        (moved("a", "a"), "the same"),
        (moved("", "a"), "must not be empty"),
        (moved("a", ""), "must not be empty"),
        (moved("/a", "a"), '"a": frame_id and child_frame_id are the same'),
        (moved("a", "/a"), "the same"),
        (moved("/", "a"), "must not be empty"),
        (moved("a", "/"), "must not be empty"),
        (moved("a", "b", x=math.nan), '"b": not finite'),
        (moved("a", "b", x=math.inf), "not finite"),
        (moved("a", "b", rotation=LEVEL * math.nan), "not finite"),
        (moved("a", "b", rotation=LEVEL * 0), "not a rotation: its length is 0, not 1"),
        (moved("a", "b", rotation=LEVEL * 1.1), "its length is 1.1"),
    ],
)
def test_invalid_transform_is_refused_and_leaves_the_buffer_unchanged(transform: Transform, text: str) -> None:
    buffer = TransformBuffer()
    with pytest.raises(InvalidTransformError, match=text):
        buffer.set_transform(transform)
    assert buffer.frames() == {}


async def test_message_that_is_not_a_transform_is_refused(memory: World) -> None:
    half: Any = get_message("geometry_msgs/msg/TransformStamped")()
    half.header.stamp = "now"
    for wrong, text in ((get_message("sensor_msgs/msg/Imu")(), "got Imu"), (half, "'now'"), (None, "got NoneType")):
        buffer = TransformBuffer()
        with pytest.raises(InvalidTransformError, match=f"expected a geometry_msgs/msg/TransformStamped.*{text}"):
            buffer.set_transform(wrong)
        assert buffer.frames() == {}

    robot = memory.node("robot")
    for broadcaster in (TransformBroadcaster(robot), StaticTransformBroadcaster(robot)):
        with pytest.raises(EncodeError, match=r"transforms\[1\]: expected geometry_msgs/msg/TransformStamped"):
            broadcaster.send([moved("base", "lidar"), get_message("sensor_msgs/msg/Imu")()])


def test_leading_slash_of_an_inserted_frame_is_removed() -> None:
    buffer = TransformBuffer()
    buffer.set_transform(moved("/map", "/base", x=2))
    buffer.set_transform(moved("/base", "lidar", x=1), static=True)
    assert list(buffer.frames()) == ["base", "lidar", "map"]
    assert buffer.lookup_transform("map", "lidar").translation.tolist() == [3, 0, 0]
    with pytest.raises(InvalidTransformError, match=r"the target frame .*begins with /"):
        buffer.lookup_transform("/map", "lidar")


def test_loop_of_frames_is_reported() -> None:
    buffer = TransformBuffer()
    for parent, child in (("a", "b"), ("b", "c"), ("c", "a")):
        buffer.set_transform(moved(parent, child))
    buffer.set_transform(moved("x", "y"))
    with pytest.raises(UnknownFrameError, match="form a loop: a -> c -> b -> a"):
        buffer.lookup_transform("x", "a")
    with pytest.raises(UnknownFrameError, match="loop"):
        buffer.lookup_transform("x", "a", S)
    buffer.set_transform(moved("x", "a", 2))  # the loop is past
    with pytest.raises(UnknownFrameError, match="a -> c -> b -> a"):
        buffer.lookup_transform("x", "a", S)


def test_frame_with_a_new_parent_keeps_the_old_parent_for_earlier_times() -> None:
    buffer = TransformBuffer()
    buffer.set_transform(moved("left", "ball", 1, 1))
    buffer.set_transform(moved("right", "ball", 3, 2))
    assert buffer.lookup_transform("left", "ball", 2 * S).translation.tolist() == [1, 0, 0]
    assert buffer.lookup_transform("right", "ball").translation.tolist() == [2, 0, 0]
    with pytest.raises(ConnectivityError):
        buffer.lookup_transform("right", "ball", 2 * S)


def test_static_frame_becomes_dynamic_with_a_dynamic_transform() -> None:
    buffer = TransformBuffer()
    buffer.set_transform(moved("a", "b", 1, 1), static=True)
    assert buffer.frames()["b"].is_static
    buffer.set_transform(moved("a", "b", 5, 2))
    assert not buffer.frames()["b"].is_static
    with pytest.raises(ExtrapolationError):
        buffer.lookup_transform("a", "b", S)


def test_transforms_older_than_the_cache_time_are_discarded() -> None:
    buffer = TransformBuffer(cache_time_s=2)
    for second in range(1, 100):
        buffer.set_transform(moved("a", "b", second))
    info = buffer.frames()["b"]
    assert (info.oldest, info.newest) == (97 * S, 99 * S) and info.count == 3
    with pytest.raises(InvalidTransformError, match="9 s before the latest; expected at most the cache time, 2 s"):
        buffer.set_transform(moved("a", "b", 90))
    buffer.set_transform(moved("a", "b", 98.5, 7))  # late, but not too late
    assert buffer.lookup_transform("a", "b", round(98.5 * S)).translation.tolist() == [7, 0, 0]


def test_clear_discards_dynamic_but_not_static_transforms() -> None:
    buffer = filled()
    buffer.clear()
    assert buffer.can_transform("base_link", "lidar")
    assert not buffer.can_transform("map", "odom")
    buffer.set_transform(moved("map", "odom", 0.5))
    assert buffer.can_transform("map", "odom")


def test_transform_round_trips_through_a_message() -> None:
    buffer = filled()
    message = buffer.lookup_transform("map", "lidar").to_message(cls=TransformStamped)
    assert (message.header.frame_id, message.child_frame_id, message.header.stamp.sec) == ("map", "lidar", 3)
    other = TransformBuffer()
    other.set_transform(message)
    assert np.allclose(other.lookup_transform("map", "lidar").matrix, buffer.lookup_transform("map", "lidar").matrix)
    with pytest.raises(TypeError, match="a Time message or nanoseconds"):
        buffer.lookup_transform("map", "lidar", "now")


# ------------------------------------------------------------------------------------------------------------- nodes


@pytest.mark.every_transport
async def test_transforms_of_broadcasters_arrive_in_buffers(world: World) -> None:
    robot, viewer = world.node("robot"), world.node("viewer")
    statics = StaticTransformBroadcaster(robot)
    statics.send(moved("base_link", "lidar", 0, 1))
    statics.send([moved("base_link", "camera", 0, 2)])
    moving = TransformBroadcaster(robot)
    buffer = TransformBuffer(viewer)
    waiting = asyncio.ensure_future(buffer.wait_for_transform("odom", "camera", timeout_s=20))
    await until(lambda: robot.count_subscribers("/tf") == 1)
    while not waiting.done():
        moving.send([moved("odom", "base_link", 4, 10)])
        await asyncio.sleep(0.02)
    found = await waiting
    assert found.translation.tolist() == [12, 0, 0] and found.stamp == 4 * S
    assert buffer.can_transform("odom", "lidar")  # sent before there was a buffer


async def test_static_transform_sent_again_without_slash_replaces_the_first(memory: World) -> None:
    robot, viewer = memory.node("robot"), memory.node("viewer")
    statics = StaticTransformBroadcaster(robot)
    statics.send(moved("base", "/lidar", 0, 1))
    statics.send(moved("base", "lidar", 0, 2))
    subscription = viewer.create_subscription(TFMessage, "/tf_static", qos=QoSProfile().transient_local())
    message = await subscription.receive(timeout_s=10)
    assert [one.transform.translation.x for one in message.transforms] == [2]


async def test_wait_timeout_error_states_the_missing_frame(memory: World) -> None:
    viewer = memory.node("viewer")
    buffer = TransformBuffer(viewer)
    with pytest.raises(TransformTimeoutError, match=r'after 0\.05 s: the target frame "map" is not known'):
        await buffer.wait_for_transform("map", "odom", timeout_s=0.05)
    with pytest.raises(InvalidTransformError, match="empty"):
        await buffer.wait_for_transform("", "odom", timeout_s=5)


async def test_invalid_received_transform_is_logged_and_valid_ones_are_used(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    robot, viewer = memory.node("robot"), memory.node("viewer")
    buffer = TransformBuffer(viewer)
    moving = TransformBroadcaster(robot)
    await until(lambda: robot.count_subscribers("/tf") == 1)
    moving.send([moved("a", "a"), moved("a", "b", x=math.nan), moved("a", "c", 1, 5)])
    assert (await buffer.wait_for_transform("a", "c", timeout_s=10)).translation.tolist() == [5, 0, 0]
    assert list(buffer.frames()) == ["a", "c"]
    assert 'ignored a transform: "a": frame_id and child_frame_id are the same' in caplog.text


def test_times_before_1970_are_displayed_as_negative_seconds() -> None:
    buffer = TransformBuffer()
    buffer.set_transform(Transform("map", "base", 10, np.zeros(3), np.array([0.0, 0, 0, 1])))
    with pytest.raises(ExtrapolationError, match=r"requested -0\.000000005, but"):
        buffer.lookup_transform("map", "base", -5)
    with pytest.raises(ExtrapolationError, match=r"requested -1\.500000000, but"):
        buffer.lookup_transform("map", "base", -1_500_000_000)
