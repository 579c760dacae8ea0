"""Transformation of geometry_msgs, with `rosidl_py_gen.tf`.

As in the real package, the header of a result is the header object of the transform, and arguments are not changed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import tf2_ros
from geometry_msgs.msg import (
    Point,
    Point32,
    PointStamped,
    PolygonStamped,
    Pose,
    PoseStamped,
    PoseWithCovarianceStamped,
    TransformStamped,
    Vector3Stamped,
)

from rosidl_py_gen import tf as _tf
from rosidl_py_gen.numpy import matrix_to_quaternion, quaternion_to_matrix


def to_msg_msg(msg: Any) -> Any:
    """Return the message."""
    return msg


from_msg_msg = to_msg_msg


def do_transform_point(point: PointStamped, transform: TransformStamped) -> PointStamped:
    """Transform a point."""
    x, y, z = _to_transform(transform).apply((point.point.x, point.point.y, point.point.z)).tolist()
    return PointStamped(header=transform.header, point=Point(x=x, y=y, z=z))


def do_transform_vector3(vector3: Vector3Stamped, transform: TransformStamped) -> Vector3Stamped:
    """Transform a direction, which is only rotated."""
    result = Vector3Stamped(header=transform.header)
    vector = vector3.vector
    result.vector.x, result.vector.y, result.vector.z = (
        _to_transform(transform).rotate((vector.x, vector.y, vector.z)).tolist()
    )
    return result


def do_transform_pose(pose: Pose, transform: TransformStamped) -> Pose:
    """Transform a pose; w of the resulting orientation is not negative."""
    change, position, result = _to_transform(transform), pose.position, Pose()
    x, y, z = change.apply((position.x, position.y, position.z)).tolist()
    result.position.x, result.position.y, result.position.z = x, y, z
    rotation = quaternion_to_matrix(change.rotation) @ quaternion_to_matrix(_quaternion_or_identity(pose.orientation))
    new = result.orientation
    new.x, new.y, new.z, new.w = matrix_to_quaternion(rotation).tolist()
    return result


def do_transform_pose_stamped(pose: PoseStamped, transform: TransformStamped) -> PoseStamped:
    """Transform a pose with a header."""
    return PoseStamped(header=transform.header, pose=do_transform_pose(pose.pose, transform))


def do_transform_pose_with_covariance_stamped(
    pose: PoseWithCovarianceStamped, transform: TransformStamped
) -> PoseWithCovarianceStamped:
    """Transform a pose and its covariance."""
    result = PoseWithCovarianceStamped(header=transform.header)
    result.pose.pose = do_transform_pose(pose.pose.pose, transform)
    result.pose.covariance = transform_covariance(pose.pose.covariance, transform)
    return result


def do_transform_polygon_stamped(polygon: PolygonStamped, transform: TransformStamped) -> PolygonStamped:
    """Transform a polygon."""
    points = np.array([(point.x, point.y, point.z) for point in polygon.polygon.points]).reshape(-1, 3)
    result = PolygonStamped(header=transform.header)
    result.polygon.points = [Point32(x=x, y=y, z=z) for x, y, z in _to_transform(transform).apply(points).tolist()]
    return result


def transform_covariance(cov_in: Any, transform: TransformStamped) -> Any:
    """Transform the 36 numbers of a covariance of position and angles."""
    rotation = np.kron(np.eye(2), quaternion_to_matrix(_to_transform(transform).rotation))
    result = PoseWithCovarianceStamped()
    result.pose.covariance = (rotation @ np.reshape(cov_in, (6, 6)) @ rotation.T).reshape(36)
    return result.pose.covariance


def _to_transform(stamped: TransformStamped) -> _tf.Transform:
    move = stamped.transform.translation
    frames = stamped.header.frame_id, stamped.child_frame_id
    return _tf.Transform(
        *frames, 0, np.array((move.x, move.y, move.z)), _quaternion_or_identity(stamped.transform.rotation)
    )


def _quaternion_or_identity(quaternion: Any) -> Any:
    """Return a quaternion; a zero one, which is not a rotation, becomes the identity."""
    values = np.array((quaternion.x, quaternion.y, quaternion.z, quaternion.w))
    return values if values @ values >= np.finfo(np.float64).eps else np.array((0.0, 0.0, 0.0, 1.0))


for _type in (Vector3Stamped, PoseStamped, PointStamped):
    tf2_ros.ConvertRegistration().add_to_msg(_type, to_msg_msg)
    tf2_ros.ConvertRegistration().add_from_msg(_type, from_msg_msg)
for _type, _function in (
    (PointStamped, do_transform_point),
    (Vector3Stamped, do_transform_vector3),
    (PoseStamped, do_transform_pose_stamped),
    (PoseWithCovarianceStamped, do_transform_pose_with_covariance_stamped),
    (PolygonStamped, do_transform_polygon_stamped),
):
    tf2_ros.TransformRegistration().add(_type, _function)
