"""Errors of conversions for other objects than the expected message."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from sensor_msgs.msg import Image, Imu, PointCloud2

from rosidl_py_gen import numpy as conversions
from rosidl_py_gen import to_dict
from rosidl_py_gen.numpy import ConversionError


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        ("image_to_array", "a sensor_msgs/msg/Image"),
        ("compressedimage_to_array", "a sensor_msgs/msg/CompressedImage"),
        ("pointcloud_dtype", "a sensor_msgs/msg/PointCloud2"),
        ("pointcloud_to_array", "a sensor_msgs/msg/PointCloud2"),
        ("laserscan_to_points", "a sensor_msgs/msg/LaserScan"),
        ("occupancygrid_to_array", "a nav_msgs/msg/OccupancyGrid"),
        ("transform_to_matrix", "a transform or a pose"),
        ("quaternion_to_matrix", "quaternions x, y, z, w"),
        ("quaternion_to_euler", "quaternions x, y, z, w"),
        ("matrix_to_quaternion", "matrices of 3 x 3"),
        ("matrix_to_transform", "a matrix of 4 x 4"),
        ("datetime_to_time", "a datetime"),
        ("timedelta_to_duration", "a timedelta"),
        ("time_to_datetime", "sec and nanosec"),
        ("duration_to_timedelta", "sec and nanosec"),
    ],
)
def test_object_of_another_type_is_reported_with_the_expected_type(function: str, expected: str) -> None:
    for wrong in (Imu(), object()):
        with pytest.raises(ConversionError, match=f"expected {expected}, got <?{type(wrong).__name__}"):
            getattr(conversions, function)(wrong)


@pytest.mark.parametrize("function", ["image_to_array", "pointcloud_to_array", "laserscan_to_points"])
def test_dicts_of_subscriptions_without_class_are_refused_with_advice(function: str) -> None:
    with pytest.raises(ConversionError, match="got dict: subscribe with the class instead of the name"):
        getattr(conversions, function)(to_dict(Image()))


def test_missing_field_is_reported() -> None:
    image = Image(encoding="mono8", height=1, width=1, step=1, data=b"\7")
    assert conversions.image_to_array(image=image).tolist() == [[7]]
    half = SimpleNamespace(encoding="mono8", is_bigendian=0, height=1, width=1)
    with pytest.raises(ConversionError, match=r"expected a sensor_msgs/msg/Image, got SimpleNamespace: .*'step'"):
        conversions.image_to_array(image=half)
    odd = SimpleNamespace(encoding="mono8", is_bigendian=np.zeros(2, np.uint8), height=1, width=1, step=1, data=b"\7")
    with pytest.raises(ConversionError, match=r"is_bigendian: expected 0 or 1, got array\(\[0, 0\]"):
        conversions.image_to_array(odd)
    cloud = PointCloud2(point_step=4)
    cloud.fields = [7]
    with pytest.raises(ConversionError, match="PointCloud2: 'int' object has no attribute 'datatype'"):
        conversions.pointcloud_to_array(cloud)
    with pytest.raises(ConversionError, match=r"a transform or a pose, got SimpleNamespace: .*'x'"):
        conversions.transform_to_matrix(SimpleNamespace(translation=3, rotation=[0, 0, 0, 1]))
    with pytest.raises(ConversionError, match="expected angles in radians, got str"):
        conversions.euler_to_quaternion(0, "up", np.zeros(3))
