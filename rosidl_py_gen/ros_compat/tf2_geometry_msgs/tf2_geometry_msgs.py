"""Transformation of geometry_msgs between frames, with `rosidl_py_gen.tf`.

As in the real package, the header of a result is the header object of the transform, and arguments are not changed.
"""

from __future__ import annotations

from typing import Any, TypeVar

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

T = TypeVar("T", bound=Any)


def to_msg_msg(msg: Any) -> Any:
    """Return the message unchanged; registered as conversion to a message, for types that are messages already."""
    return msg


from_msg_msg = to_msg_msg


def do_transform_point(point: PointStamped, transform: TransformStamped) -> PointStamped:
    """Return a point transformed to the frame of the transform."""
    return _transform(PointStamped(point=point.point), transform)


def do_transform_vector3(vector3: Vector3Stamped, transform: TransformStamped) -> Vector3Stamped:
    """Return a vector transformed to the frame of the transform; as a direction, it is only rotated."""
    return _transform(Vector3Stamped(vector=vector3.vector), transform)


def do_transform_pose(pose: Pose, transform: TransformStamped) -> Pose:
    """Return a pose transformed to the frame of the transform; w of the resulting orientation is not negative."""
    change, position, result = _to_transform(transform), pose.position, Pose()
    x, y, z = change.apply((position.x, position.y, position.z)).tolist()
    result.position.x, result.position.y, result.position.z = x, y, z
    rotation = quaternion_to_matrix(change.rotation) @ quaternion_to_matrix(_quaternion_or_identity(pose.orientation))
    new = result.orientation
    new.x, new.y, new.z, new.w = matrix_to_quaternion(rotation).tolist()
    return result


def do_transform_pose_stamped(pose: PoseStamped, transform: TransformStamped) -> PoseStamped:
    """Return a pose with header transformed to the frame of the transform."""
    return PoseStamped(header=transform.header, pose=do_transform_pose(pose.pose, transform))


def do_transform_pose_with_covariance_stamped(
    pose: PoseWithCovarianceStamped, transform: TransformStamped
) -> PoseWithCovarianceStamped:
    """Return a pose and its covariance transformed to the frame of the transform."""
    result = PoseWithCovarianceStamped(header=transform.header)
    result.pose.pose = do_transform_pose(pose.pose.pose, transform)
    result.pose.covariance = transform_covariance(pose.pose.covariance, transform)
    return result


def do_transform_polygon_stamped(polygon: PolygonStamped, transform: TransformStamped) -> PolygonStamped:
    """Return a polygon transformed to the frame of the transform."""
    return _transform(PolygonStamped(polygon=polygon.polygon), transform)


def transform_covariance(cov_in: Any, transform: TransformStamped) -> Any:
    """Return the transformed covariance (36 numbers) of a position and three angles."""
    message = PoseWithCovarianceStamped()
    message.pose.covariance = cov_in
    return _transform(message, transform).pose.covariance


def _transform(message: T, transform: TransformStamped) -> T:
    result: Any = _to_transform(transform).transform(message)
    result.header = transform.header
    return result  # type: ignore[no-any-return]


def _to_transform(stamped: TransformStamped) -> _tf.Transform:
    """Return a TransformStamped message as a `Transform` of `rosidl_py_gen.tf` that can be applied to objects without a
    frame.
    """
    move, rotation = stamped.transform.translation, _quaternion_or_identity(stamped.transform.rotation)
    return _tf.Transform(stamped.header.frame_id, "", 0, np.array((move.x, move.y, move.z)), rotation)


def _quaternion_or_identity(quaternion: Any) -> Any:
    """Return a quaternion message as an array; zeros, which are not a rotation, become the identity."""
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
