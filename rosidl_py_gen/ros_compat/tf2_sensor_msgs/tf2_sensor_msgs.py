"""Transformation of point clouds between frames."""

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
    """Return the message unchanged; registered as conversion to a message, for types that are messages already."""
    return msg


from_msg_msg = to_msg_msg


def transform_points(point_cloud: Any, transform: Transform) -> np.ndarray[Any, np.dtype[Any]]:
    """Return points, an array of shape ``(n, 3)``, rotated and translated by a transform."""
    translation, rotation = transform.translation, transform.rotation
    points = np.asarray(point_cloud)
    if rotation.x or rotation.y or rotation.z or rotation.w:  # a zero quaternion is not a rotation
        points = points @ quaternion_to_matrix(rotation).T
    result: np.ndarray[Any, np.dtype[Any]] = points + np.array((translation.x, translation.y, translation.z))
    return result


def do_transform_cloud(cloud: PointCloud2, transform: Transform | TransformStamped) -> PointCloud2:
    """Return a transformed cloud, which has a single row; fields other than x, y and z, and the stamp, are unchanged.

    A TransformStamped sets the frame of the result; a Transform does not change the frame.

    Raises:
        AssertionError: the cloud has no fields x, y and z.
    """
    header = Header(stamp=cloud.header.stamp, frame_id=cloud.header.frame_id)
    if isinstance(transform, TransformStamped):
        header.frame_id, transform = transform.header.frame_id, transform.transform
    names = {field.name for field in cloud.fields}
    assert {"x", "y", "z"} <= names, f"the cloud must have the fields x, y and z, got {sorted(names)}"
    points = read_points(cloud)
    transformed = transform_points(structured_to_unstructured(points[["x", "y", "z"]]), transform)
    if names == {"x", "y", "z"}:
        return create_cloud(header, cloud.fields, transformed)
    points = points.copy()
    for column, name in zip(transformed.T, "xyz", strict=True):
        points[name] = column
    return create_cloud(header, cloud.fields, points, cloud.point_step)


tf2_ros.ConvertRegistration().add_to_msg(PointCloud2, to_msg_msg)
tf2_ros.ConvertRegistration().add_from_msg(PointCloud2, from_msg_msg)
tf2_ros.TransformRegistration().add(PointCloud2, do_transform_cloud)
