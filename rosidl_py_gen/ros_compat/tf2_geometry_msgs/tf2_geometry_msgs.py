"""Messages of geometry_msgs in other frames, over `rosidl_py_gen.tf`.

The header of a result is that of the transform, the same object, as with the real one; its argument is left as it was.
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

from rosidl_py_gen import tf
from rosidl_py_gen.numpy import matrix_to_quaternion, quaternion_to_matrix

__all__ = [
    "Point",
    "Point32",
    "PointStamped",
    "PolygonStamped",
    "Pose",
    "PoseStamped",
    "PoseWithCovarianceStamped",
    "TransformStamped",
    "Vector3Stamped",
    "do_transform_point",
    "do_transform_polygon_stamped",
    "do_transform_pose",
    "do_transform_pose_stamped",
    "do_transform_pose_with_covariance_stamped",
    "do_transform_vector3",
    "from_msg_msg",
    "to_msg_msg",
    "transform_covariance",
]


def to_msg_msg(msg: Any) -> Any:
    """The message itself."""
    return msg


def from_msg_msg(msg: Any) -> Any:
    """The message itself."""
    return msg


def do_transform_point(point: PointStamped, transform: TransformStamped) -> PointStamped:
    """A point in the frame of the transform."""
    x, y, z = _transform(transform).apply((point.point.x, point.point.y, point.point.z)).tolist()
    return PointStamped(header=transform.header, point=Point(x=x, y=y, z=z))


def do_transform_vector3(vector3: Vector3Stamped, transform: TransformStamped) -> Vector3Stamped:
    """A direction in the frame of the transform, which only turns it."""
    made = Vector3Stamped(header=transform.header)
    vector = vector3.vector
    made.vector.x, made.vector.y, made.vector.z = _transform(transform).rotate((vector.x, vector.y, vector.z)).tolist()
    return made


def do_transform_pose(pose: Pose, transform: TransformStamped) -> Pose:
    """A pose in the frame of the transform; w of its orientation is not negative."""
    how, at, to = _transform(transform), pose.position, pose.orientation
    made = Pose()
    made.position.x, made.position.y, made.position.z = how.apply((at.x, at.y, at.z)).tolist()
    turned = matrix_to_quaternion(quaternion_to_matrix(how.rotation) @ quaternion_to_matrix(_rotation(to)))
    to = made.orientation
    to.x, to.y, to.z, to.w = turned.tolist()
    return made


def do_transform_pose_stamped(pose: PoseStamped, transform: TransformStamped) -> PoseStamped:
    """The same with a header."""
    return PoseStamped(header=transform.header, pose=do_transform_pose(pose.pose, transform))


def do_transform_pose_with_covariance_stamped(
    pose: PoseWithCovarianceStamped, transform: TransformStamped
) -> PoseWithCovarianceStamped:
    """The same, and the covariance turned with it."""
    made = PoseWithCovarianceStamped(header=transform.header)
    made.pose.pose = do_transform_pose(pose.pose.pose, transform)
    made.pose.covariance = transform_covariance(pose.pose.covariance, transform)
    return made


def do_transform_polygon_stamped(polygon: PolygonStamped, transform: TransformStamped) -> PolygonStamped:
    """A polygon in the frame of the transform."""
    places = np.array([(point.x, point.y, point.z) for point in polygon.polygon.points]).reshape(-1, 3)
    made = PolygonStamped(header=transform.header)
    made.polygon.points = [Point32(x=x, y=y, z=z) for x, y, z in _transform(transform).apply(places).tolist()]
    return made


def transform_covariance(cov_in: Any, transform: TransformStamped) -> Any:
    """36 numbers of place and angles in the frame of the transform."""
    turn = np.kron(np.eye(2), quaternion_to_matrix(_transform(transform).rotation))
    made = PoseWithCovarianceStamped()
    made.pose.covariance = (turn @ np.reshape(cov_in, (6, 6)) @ turn.T).reshape(36)
    return made.pose.covariance


def _transform(stamped: TransformStamped) -> tf.Transform:
    move = stamped.transform.translation
    frames = stamped.header.frame_id, stamped.child_frame_id
    return tf.Transform(*frames, 0, np.array((move.x, move.y, move.z)), _rotation(stamped.transform.rotation))


def _rotation(turn: Any) -> Any:
    """Zero, which is no rotation, turns nothing."""
    values = np.array((turn.x, turn.y, turn.z, turn.w))
    return values if values @ values >= np.finfo(np.float64).eps else np.array((0.0, 0.0, 0.0, 1.0))


for _type in (Vector3Stamped, PoseStamped, PointStamped):
    tf2_ros.ConvertRegistration().add_to_msg(_type, to_msg_msg)
    tf2_ros.ConvertRegistration().add_from_msg(_type, from_msg_msg)
for _type, _act in (
    (PointStamped, do_transform_point),
    (Vector3Stamped, do_transform_vector3),
    (PoseStamped, do_transform_pose_stamped),
    (PoseWithCovarianceStamped, do_transform_pose_with_covariance_stamped),
    (PolygonStamped, do_transform_polygon_stamped),
):
    tf2_ros.TransformRegistration().add(_type, _act)
