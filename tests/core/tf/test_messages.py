"""Transformed messages, compared with homogeneous matrices."""

from __future__ import annotations

import asyncio
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.transform_frames import LEVEL, QUARTER, S, filled, message, moved
from support.worlds import World

from rosidl_py_gen import decode, encode, get_message
from rosidl_py_gen.base.stamps import set_stamp, stamp_ns
from rosidl_py_gen.numpy import ConversionError, array_to_pointcloud, pointcloud_to_array, quaternion_to_matrix
from rosidl_py_gen.tf import (
    ExtrapolationError,
    StaticTransformBroadcaster,
    Transform,
    TransformBroadcaster,
    TransformBuffer,
    TransformTimeoutError,
    UnknownFrameError,
)

NUMBERS = st.floats(-100, 100, width=32)
ROTATIONS = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(x * x for x in q) > 0.01)


def xyz(value: Any) -> list[float]:
    return [value.x, value.y, value.z]


@st.composite
def transforms(draw: st.DrawFn) -> Transform:
    turn = np.array(draw(ROTATIONS))
    place = np.array([draw(NUMBERS) for _ in range(3)])
    return Transform("map", "lidar", 7 * S, place, turn / np.linalg.norm(turn))


@given(transforms(), st.tuples(NUMBERS, NUMBERS, NUMBERS), ROTATIONS)
def test_points_vectors_and_poses_are_transformed_like_by_a_matrix(
    transform: Transform, place: tuple[float, ...], turn: tuple[float, ...]
) -> None:
    unit = np.array(turn) / np.linalg.norm(turn)
    point, vector, pose = message("PointStamped"), message("Vector3Stamped"), message("PoseStamped")
    rotated = message("QuaternionStamped")
    for value in (point.point, vector.vector, pose.pose.position):
        value.x, value.y, value.z = place
    for value in (pose.pose.orientation, rotated.quaternion):
        value.x, value.y, value.z, value.w = unit.tolist()
    before = [encode(one) for one in (point, vector, pose, rotated)]
    wanted = (transform.matrix @ (*place, 1))[:3]
    made = [transform.transform(one) for one in (point, vector, pose, rotated)]
    assert np.allclose(xyz(made[0].point), wanted) and np.allclose(xyz(made[2].pose.position), wanted)
    assert np.allclose(xyz(made[1].vector), (transform.matrix @ (*place, 0))[:3])
    for orientation in (made[2].pose.orientation, made[3].quaternion):
        assert np.allclose(
            quaternion_to_matrix(orientation), transform.matrix[:3, :3] @ quaternion_to_matrix(unit), atol=1e-6
        )
    assert {(one.header.frame_id, stamp_ns(one.header.stamp)) for one in made} == {("map", 7 * S)}
    assert [encode(one) for one in (point, vector, pose, rotated)] == before
    assert all(type(decode(type(one), encode(one))) is type(one) for one in made)


@given(transforms(), st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), max_size=5))
def test_all_poses_and_points_of_a_message_are_transformed(
    transform: Transform, places: list[tuple[float, ...]]
) -> None:
    poses, polygon = message("PoseArray"), message("PolygonStamped")
    pose_class, point_class = (get_message(f"geometry_msgs/msg/{name}") for name in ("Pose", "Point32"))
    for place in places:
        pose, point = pose_class(), point_class()
        for value in (pose.position, point):
            value.x, value.y, value.z = place
        poses.poses.append(pose)
        polygon.polygon.points.append(point)
    wanted = transform.apply(np.array(places).reshape(-1, 3))
    made = [xyz(pose.position) for pose in transform.transform(poses).poses]
    assert np.allclose(np.reshape(made, (-1, 3)), wanted)
    made = [xyz(point) for point in transform.transform(polygon).polygon.points]
    assert np.allclose(np.reshape(made, (-1, 3)), wanted, rtol=1e-6)


def test_covariance_is_rotated_with_the_pose() -> None:
    pose = message("PoseWithCovarianceStamped")
    pose.pose.covariance = np.diag([1.0, 2, 3, 4, 5, 6]).reshape(36)
    turned = Transform("map", "lidar", 0, np.ones(3), QUARTER).transform(pose)
    assert np.allclose(np.diag(turned.pose.covariance.reshape(6, 6)), [2, 1, 3, 5, 4, 6])
    assert xyz(turned.pose.pose.position) == [1, 1, 1] and np.diag(pose.pose.covariance.reshape(6, 6))[0] == 1
    assert stamp_ns(turned.header.stamp) == 3 * S  # a transform of all times leaves the time


def cloud_of(points: Any, **changes: Any) -> Any:
    cloud: Any = array_to_pointcloud(points)
    cloud.header.frame_id = "lidar"
    for name, value in changes.items():
        setattr(cloud, name, value)
    return cloud


@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8", ">f8"])
@pytest.mark.parametrize("shape", [(7,), (3, 5), (0,)])
def test_only_the_coordinates_of_a_cloud_are_transformed(kind: str, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    dtype = np.dtype(
        {
            "names": ["intensity", "z", "y", "x", "ring"],
            "formats": ["u1", kind, kind, kind, kind.replace("f8", "u2").replace("f4", "u2")],
            "offsets": [0, 8, 16, 24, 34],
            "itemsize": 40,
        }
    )
    made = np.zeros(shape, dtype)
    for name in dtype.names or ():
        made[name] = rng.uniform(0, 90, shape)
    cloud = cloud_of(made)
    if len(shape) == 2 and kind[0] == "<":  # rows with something behind them
        rows = np.full((3, 5 * 40 + 3), 9, np.uint8)
        rows[:, :-3] = np.asarray(cloud.data).reshape(3, -1)
        cloud.data, cloud.row_step = rows.reshape(-1), 203
    transform = Transform("map", "lidar", 0, np.array([1.0, -2, 3]), QUARTER)
    kept = bytes(cloud.data)
    turned = transform.transform(cloud)
    before, after = pointcloud_to_array(cloud), pointcloud_to_array(turned)
    assert after.dtype == before.dtype and after.shape == before.shape == shape
    for index in np.ndindex(shape):
        wanted = transform.matrix @ (*(float(before[name][index]) for name in "xyz"), 1)
        assert np.allclose([after[name][index] for name in "xyz"], wanted[:3], rtol=1e-6)
    for name in ("x", "y", "z"):
        after[name] = before[name]
    assert bytes(turned.data) == bytes(cloud.data) == kept
    assert (turned.row_step, turned.point_step, turned.header.frame_id) == (cloud.row_step, cloud.point_step, "map")


def test_nan_and_infinity_are_preserved_and_normals_are_only_rotated() -> None:
    names = ["x", "y", "z", "normal_x", "normal_y", "normal_z"]
    made = np.zeros(3, [(name, "f4") for name in names])
    made["normal_x"] = 1
    made["x"] = [math.nan, math.inf, 1]
    transform = Transform("map", "lidar", 0, np.array([5.0, 0, 0]), QUARTER)
    points = pointcloud_to_array(transform.transform(cloud_of(made)))
    assert np.isnan(points["x"][0]) and np.isinf(points["y"][1]) and points["y"][2] == pytest.approx(1)
    assert np.allclose(points["normal_y"], 1) and np.allclose(points["normal_x"], 0, atol=1e-6)


def test_a_received_cloud_whose_bytes_are_read_only_is_copied() -> None:
    cloud = cloud_of(np.ones((4, 3), np.float32))
    received = decode(type(cloud), encode(cloud))
    turned = Transform("map", "lidar", 0, np.zeros(3), LEVEL).transform(received)
    assert pointcloud_to_array(turned)["x"].tolist() == [1] * 4
    assert not np.shares_memory(turned.data, received.data)


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        (message("PointStamped", "camera"), 'header.frame_id: "camera", but the transform is from "lidar"'),
        (get_message("geometry_msgs/msg/Pose")(), "cannot transform Pose; expected one of PointStamped, "),
        ({"header": {}}, "cannot transform dict; expected"),
        (type("PoseStamped", (), {})(), "cannot transform PoseStamped: it has no header"),
        (
            cloud_of(np.zeros(3, [("x", "f4"), ("y", "f4")])),
            'fields: transforming needs "z" as FLOAT32 or FLOAT64, got none',
        ),
        (cloud_of(np.zeros(3, [(name, "i4") for name in "xyz"])), 'needs "x" as FLOAT32 or FLOAT64, got int32'),
        (cloud_of(np.zeros(3, [("x", "f4", 2), ("y", "f4"), ("z", "f4")])), 'needs "x" as FLOAT32'),
        (cloud_of(np.zeros(3, [(name, "f4") for name in "xyz"]), width=10**9), "points need"),
        (cloud_of(np.zeros(3, [(name, "f4") for name in "xyz"]), data=b""), "0 bytes, but"),
    ],
)
def test_messages_that_cannot_be_transformed_are_refused_with_reason(wrong: Any, text: str) -> None:
    with pytest.raises(ConversionError, match=text):
        Transform("map", "lidar", 0, np.zeros(3), LEVEL).transform(wrong)


def test_buffer_transforms_a_message_at_the_time_of_its_stamp() -> None:
    buffer = filled()
    point = message("PointStamped", "base_link", 1.5)
    there = buffer.transform(point, "odom")
    assert xyz(there.point) == [1.5, 0, 0] and stamp_ns(there.header.stamp) == round(1.5 * S)
    newest = buffer.transform(message("PointStamped", "base_link", 0), "odom")
    assert xyz(newest.point) == [3, 0, 0] and stamp_ns(newest.header.stamp) == 3 * S
    assert xyz(buffer.transform(message("PointStamped", "/base_link", 2), "odom").point) == [2, 0, 0]
    now = buffer.transform_at(message("PointStamped", "base_link", 1), "base_link", 3 * S, "map")
    assert xyz(now.point) == [-2, 0, 0] and stamp_ns(now.header.stamp) == 3 * S
    with pytest.raises(ExtrapolationError):
        buffer.transform(message("PointStamped", "base_link", 4), "odom")
    with pytest.raises(UnknownFrameError):
        buffer.transform(point, "odm")
    for wrong in (get_message("geometry_msgs/msg/Pose")(), SimpleNamespace(header=1), None):
        with pytest.raises(ConversionError, match=r"cannot transform \w+: it has no header"):
            buffer.transform(wrong, "odom")


@pytest.mark.every_transport
async def test_wait_and_transform_waits_for_the_transform_of_a_cloud(world: World) -> None:
    robot, viewer = world.pair()
    buffer = TransformBuffer(viewer)
    StaticTransformBroadcaster(robot).send(moved("base_link", "lidar", 0, 2))
    cloud = cloud_of(np.zeros((2, 3), np.float32))
    set_stamp(cloud.header.stamp, 5 * S)
    with pytest.raises(TransformTimeoutError):
        await buffer.wait_and_transform(cloud, "map", timeout_s=0.05)
    moving = TransformBroadcaster(robot)
    await robot.wait_for_node("bob", 20)
    waiting = asyncio.ensure_future(buffer.wait_and_transform(cloud, "map", timeout_s=20))
    for second in range(4, 60):
        moving.send(moved("map", "base_link", second, second))
        await asyncio.sleep(0.05)
        if waiting.done():
            break
    assert pointcloud_to_array(await waiting)["x"].tolist() == [7, 7]
