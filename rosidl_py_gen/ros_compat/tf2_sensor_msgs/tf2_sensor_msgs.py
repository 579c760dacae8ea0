"""Point clouds in other frames, over `rosidl_py_gen.tf`."""

from __future__ import annotations

from typing import Any

import numpy as np
import tf2_ros
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import PointCloud2
from sensor_msgs_py.numpy_compat import structured_to_unstructured
from sensor_msgs_py.point_cloud2 import create_cloud, read_points
from std_msgs.msg import Header

from rosidl_py_gen.numpy import quaternion_to_matrix


def to_msg_msg(msg: Any) -> Any:
    """The message itself."""
    return msg


def from_msg_msg(msg: Any) -> Any:
    """The message itself."""
    return msg


def transform_points(point_cloud: Any, transform: Transform) -> np.ndarray[Any, np.dtype[Any]]:
    """Points of shape ``(n, 3)``, turned and moved."""
    move, turn = transform.translation, transform.rotation
    turned = np.asarray(point_cloud)
    if turn.x or turn.y or turn.z or turn.w:  # else it is no rotation
        turned = turned @ quaternion_to_matrix(turn).T
    moved: np.ndarray[Any, np.dtype[Any]] = turned + np.array((move.x, move.y, move.z))
    return moved


def do_transform_cloud(cloud: PointCloud2, transform: Transform | TransformStamped) -> PointCloud2:
    """A cloud of one row with x, y and z in another frame; what else it has stays, and so does its time.

    Its frame is that of a TransformStamped; a Transform leaves it.

    Raises:
        AssertionError: the cloud has no fields x, y and z.
    """
    header = Header(stamp=cloud.header.stamp, frame_id=cloud.header.frame_id)
    if isinstance(transform, TransformStamped):
        header.frame_id, transform = transform.header.frame_id, transform.transform
    names = {field.name for field in cloud.fields}
    assert {"x", "y", "z"} <= names, f"a cloud needs the fields x, y and z, this one has {sorted(names)}"
    points = read_points(cloud)
    moved = transform_points(structured_to_unstructured(points[["x", "y", "z"]]), transform)
    if names == {"x", "y", "z"}:
        return create_cloud(header, cloud.fields, moved)
    points = points.copy()
    for column, name in zip(moved.T, "xyz", strict=True):
        points[name] = column
    return create_cloud(header, cloud.fields, points, cloud.point_step)


tf2_ros.ConvertRegistration().add_to_msg(PointCloud2, to_msg_msg)
tf2_ros.ConvertRegistration().add_from_msg(PointCloud2, from_msg_msg)
tf2_ros.TransformRegistration().add(PointCloud2, do_transform_cloud)
