"""Rotations and times."""

from __future__ import annotations

import math
from datetime import datetime, timedelta, timezone
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Pose, PoseStamped, Quaternion
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen import get_message
from rosidl_py_gen.numpy import (
    ConversionError,
    datetime_to_time,
    duration_to_timedelta,
    euler_to_quaternion,
    matrix_to_quaternion,
    matrix_to_transform,
    quaternion_to_euler,
    quaternion_to_matrix,
    time_to_datetime,
    timedelta_to_duration,
    transform_to_matrix,
)

Time: Any = get_message("builtin_interfaces/msg/Time")
Duration: Any = get_message("builtin_interfaces/msg/Duration")

ANGLES = st.floats(-4, 4) | st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi, -math.pi])


def about(axis: int, angle: float) -> np.ndarray[Any, Any]:
    """Return a rotation matrix about one axis, from the textbook formula."""
    c, s = math.cos(angle), math.sin(angle)
    one, two = ((1, 2), (2, 0), (0, 1))[axis]
    matrix = np.eye(3)
    matrix[one, one] = matrix[two, two] = c
    matrix[one, two], matrix[two, one] = -s, s
    return matrix


@given(ANGLES, ANGLES, ANGLES)
def test_euler_angles_quaternions_and_matrices_agree(roll: float, pitch: float, yaw: float) -> None:
    matrix = about(2, yaw) @ about(1, pitch) @ about(0, roll)
    quaternion = euler_to_quaternion(roll, pitch, yaw)
    assert np.allclose(quaternion_to_matrix(quaternion), matrix, atol=1e-9)
    back = matrix_to_quaternion(matrix)
    assert back[3] >= 0 and np.allclose(abs(back @ quaternion), 1, atol=1e-9)
    r, p, y = quaternion_to_euler(quaternion)
    assert np.allclose(about(2, y) @ about(1, p) @ about(0, r), matrix, atol=1e-5)


def test_arrays_of_rotations_are_converted_at_once() -> None:
    angles = np.linspace(-3, 3, 60).reshape(2, 10, 3)
    quaternions = euler_to_quaternion(angles[..., 0], angles[..., 1], angles[..., 2])
    matrices = quaternion_to_matrix(quaternions)
    assert matrices.shape == (2, 10, 3, 3)
    single = [[matrix_to_quaternion(matrix) for matrix in row] for row in matrices]
    assert np.allclose(matrix_to_quaternion(matrices), single)


@pytest.mark.parametrize("value", [(0, 0, 0, 0), (math.nan, 0, 0, 1), (math.inf, 0, 0, 1), (0, 0, 1), 3.0])
def test_invalid_quaternions_are_refused(value: object) -> None:
    with pytest.raises(ConversionError):
        quaternion_to_matrix(value)


@pytest.mark.parametrize("value", [np.zeros((3, 3)), -np.eye(3), np.eye(3) * 2, np.eye(4), np.full((3, 3), np.nan)])
def test_matrices_that_are_not_rotations_are_refused(value: Any) -> None:
    with pytest.raises(ConversionError):
        matrix_to_quaternion(value)


def test_transforms_and_poses_are_converted_to_4_by_4_matrices() -> None:
    stamped = PoseStamped()
    stamped.pose.position.x = 2.0
    stamped.pose.orientation = Quaternion(z=math.sin(math.pi / 4), w=math.cos(math.pi / 4))
    matrix = transform_to_matrix(stamped)
    assert np.allclose(matrix @ (1, 0, 0, 1), (2, 1, 0, 1))
    transform = matrix_to_transform(matrix)
    assert transform.translation.x == 2.0 and np.allclose(transform_to_matrix(transform), matrix)
    pose = matrix_to_transform(matrix, cls=Pose)
    assert np.allclose(transform_to_matrix(pose), matrix)
    with pytest.raises(ConversionError, match="a transform or a pose"):
        transform_to_matrix(stamped.header)
    with pytest.raises(ConversionError, match="last row"):
        matrix_to_transform(np.ones((4, 4)))


@given(st.datetimes(datetime(1902, 1, 1), datetime(2038, 1, 1), timezones=st.just(timezone.utc)))
def test_datetimes_round_trip_through_time_messages(moment: datetime) -> None:
    stamp = datetime_to_time(moment, cls=Time)
    assert 0 <= stamp.nanosec < 10**9
    assert time_to_datetime(stamp) == moment


@given(st.timedeltas(timedelta(days=-24000), timedelta(days=24000)))
def test_timedeltas_round_trip_through_duration_messages(length: timedelta) -> None:
    assert duration_to_timedelta(timedelta_to_duration(length, cls=Duration)) == length


def test_datetimes_are_utc_and_nanoseconds_are_rounded_down() -> None:
    assert time_to_datetime(Time(sec=1, nanosec=999_999_999)) == datetime(1970, 1, 1, 0, 0, 1, 999_999, timezone.utc)
    east = timezone(timedelta(hours=2))
    assert datetime_to_time(datetime(1970, 1, 1, 2, tzinfo=east)) == Time()
    with pytest.raises(ConversionError, match="no time zone"):
        datetime_to_time(datetime(2020, 1, 1))
    with pytest.raises(ConversionError, match="int32"):
        datetime_to_time(datetime(2040, 1, 1, tzinfo=timezone.utc))
    with pytest.raises(ConversionError, match="sec and nanosec"):
        time_to_datetime("now")
