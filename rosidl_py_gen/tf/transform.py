"""Transform between two frames, which can be applied to arrays of points and to messages.

A transformed message is a copy with other positions and directions. As in tf2, the copy has the frame and the time of
the transform. The name of the message's class selects the function, so classes of any library can be transformed.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import nanoseconds, set_stamp
from rosidl_py_gen.errors import printable
from rosidl_py_gen.numpy import ConversionError, flat_bytes, pointcloud_to_array, quaternion_to_matrix
from rosidl_py_gen.tf.frame_tree import product, without_slash

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.numpy import M

T = TypeVar("T")
Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """Transform that converts coordinates in the frame `source` to coordinates in the frame `target`.

    Attributes:
        target: ``header.frame_id`` of a TransformStamped.
        source: ``child_frame_id`` of a TransformStamped.
        stamp: nanoseconds; 0 if all transforms between the frames are static.
        translation: origin of `source` in `target`, in metres, shape ``(3,)``.
        rotation: quaternion x, y, z, w, shape ``(4,)``.
    """

    target: str
    source: str
    stamp: int
    translation: Array
    rotation: Array

    @property
    def matrix(self) -> Array:
        """Homogeneous matrix of the transform, of shape ``(4, 4)``."""
        matrix = np.eye(4)
        matrix[:3, :3] = quaternion_to_matrix(self.rotation)
        matrix[:3, 3] = self.translation
        return matrix

    def apply(self, points: Any) -> Array:
        """Return points of shape ``(..., 3)`` converted from `source` to `target`.

        Raises `ConversionError` for another shape.
        """
        result: Array = self.rotate(points) + self.translation
        return result

    def rotate(self, vectors: Any) -> Array:
        """Return directions, velocities or normals of shape ``(..., 3)`` rotated from `source` to `target`.

        Raises `ConversionError` for another shape.
        """
        values = np.asarray(vectors, np.float64)
        if not values.ndim or values.shape[-1] != 3:
            raise ConversionError(f"expected points or vectors of shape (..., 3), got {values.shape}")
        result: Array = values @ quaternion_to_matrix(self.rotation).T
        return result

    def transform(self, message: T) -> T:
        """Return a copy of a message in `target`: its header has that frame, and the time of this transform.

        Args:
            message: a PointStamped, Vector3Stamped, QuaternionStamped, PoseStamped, PoseWithCovarianceStamped,
                PoseArray, PolygonStamped or PointCloud2, in `source`. Only x, y, z and normals of a cloud change.

        Raises:
            ConversionError: the message has another type or frame, or the cloud no x, y and z of floats.
        """
        name = type(message).__name__.rpartition("__")[2]  # some libraries put the package in front
        if name not in _FIELDS and name != "PointCloud2":
            known = ", ".join([*_FIELDS, "PointCloud2"])
            raise ConversionError(f"cannot transform {type(message).__name__}; expected one of {known}")
        frame, _ = frame_and_stamp(message)
        if frame != self.source:
            quoted = printable(frame, 100)
            raise ConversionError(f'header.frame_id: "{quoted}", but the transform is from "{self.source}"')
        result: Any = copy(message)
        result.header = copy(result.header)
        result.header.frame_id = self.target
        if self.stamp:
            result.header.stamp = copy(result.header.stamp)
            set_stamp(result.header.stamp, self.stamp)
        if name == "PointCloud2":
            _transform_cloud(self, result)
        else:
            field, transformed = _FIELDS[name]
            setattr(result, field, transformed(self, getattr(result, field)))
        return cast("T", result)

    def inverse(self) -> Transform:
        """Return the inverse transform, from `target` to `source`."""
        rotation = self.rotation * (-1, -1, -1, 1)
        moved = -(quaternion_to_matrix(rotation) @ self.translation)
        return Transform(self.source, self.target, self.stamp, moved, rotation)

    def __matmul__(self, first: Transform) -> Transform:
        """Return the transform that applies first `first`, then this transform.

        The target of `first` must be the source of this transform, else `ConversionError` is raised.
        """
        if self.source != first.target:
            raise ConversionError(f'cannot join: "{first.source}" to "{first.target}", then "{self.source}"')
        rotation = product(tuple(self.rotation.tolist()), tuple(first.rotation.tolist()))
        return Transform(self.target, first.source, self.stamp, self.apply(first.translation), np.array(rotation))

    def to_message(self, *, cls: type[M] | None = None) -> M:
        """Return the transform as a ``geometry_msgs/msg/TransformStamped``.

        Args:
            cls: class of the message; None uses `get_message`.
        """
        message: Any = (get_message("geometry_msgs/msg/TransformStamped") if cls is None else cls)()
        message.header.frame_id, message.child_frame_id = self.target, self.source
        set_stamp(message.header.stamp, self.stamp)
        move, turn = message.transform.translation, message.transform.rotation
        move.x, move.y, move.z = self.translation.tolist()
        turn.x, turn.y, turn.z, turn.w = self.rotation.tolist()
        return cast("M", message)


# ------------------------------------------------------------------------------------------------------------- messages


def frame_and_stamp(message: Any) -> tuple[str, int]:
    """Return the frame of a message's header, without leading slash, and its stamp.

    Raises `ConversionError` without a header.
    """
    try:
        frame, stamp = message.header.frame_id, nanoseconds(message.header.stamp)
    except (AttributeError, TypeError):
        frame, stamp = None, 0
    if not isinstance(frame, str):
        raise ConversionError(f"cannot transform {type(message).__name__}: it has no header")
    return without_slash(frame), stamp


def _xyz(value: Any) -> tuple[float, float, float]:
    return value.x, value.y, value.z


def _with_xyz(value: Any, numbers: Any) -> Any:
    changed = copy(value)
    changed.x, changed.y, changed.z = numbers.tolist()
    return changed


def _rotated(transform: Transform, value: Any) -> Any:
    changed = copy(value)
    rotation = tuple(transform.rotation.tolist())
    changed.x, changed.y, changed.z, changed.w = product(rotation, (value.x, value.y, value.z, value.w))
    return changed


def _moved(transform: Transform, point: Any) -> Any:
    return _with_xyz(point, transform.apply(_xyz(point)))


def _turned(transform: Transform, vector: Any) -> Any:
    return _with_xyz(vector, transform.rotate(_xyz(vector)))


def _transformed_pose(transform: Transform, pose: Any) -> Any:
    changed = copy(pose)
    changed.position = _moved(transform, pose.position)
    changed.orientation = _rotated(transform, pose.orientation)
    return changed


def _pose_with_covariance(transform: Transform, pose: Any) -> Any:
    changed = copy(pose)
    changed.pose = _transformed_pose(transform, pose.pose)
    turn = np.kron(np.eye(2), quaternion_to_matrix(transform.rotation))  # position and angles
    changed.covariance = (turn @ np.reshape(pose.covariance, (6, 6)) @ turn.T).reshape(36)
    return changed


def _poses(transform: Transform, poses: Any) -> list[Any]:
    return [_transformed_pose(transform, pose) for pose in poses]


def _polygon(transform: Transform, polygon: Any) -> Any:
    changed = copy(polygon)
    points = transform.apply(np.array([_xyz(point) for point in polygon.points]).reshape(-1, 3))
    changed.points = [_with_xyz(*pair) for pair in zip(polygon.points, points, strict=True)]
    return changed


def _transform_cloud(transform: Transform, message: Any) -> None:
    source = pointcloud_to_array(message)
    message.data = flat_bytes(message.data, "data").copy()
    result = pointcloud_to_array(message)
    _transform_columns(source, result, ("x", "y", "z"), transform.apply)
    if {"normal_x", "normal_y", "normal_z"} <= {*(result.dtype.names or ())}:
        _transform_columns(source, result, ("normal_x", "normal_y", "normal_z"), transform.rotate)


def _transform_columns(
    source: np.ndarray[Any, Any], points: np.ndarray[Any, Any], names: tuple[str, ...], apply: Callable[[Any], Any]
) -> None:
    for name in names:
        kind = points.dtype[name] if name in (points.dtype.names or ()) else None
        if kind is None or kind.kind != "f" or kind.shape:
            raise ConversionError(f'fields: transforming needs "{name}" as FLOAT32 or FLOAT64, got {kind or "none"}')
    with np.errstate(all="ignore"):  # numbers may be infinite, NaN or too large for float32
        columns = apply(np.stack([source[name] for name in names], -1))
        for number, name in enumerate(names):
            points[name] = columns[..., number]


_FIELDS: dict[str, tuple[str, Callable[[Transform, Any], Any]]] = {
    "PointStamped": ("point", _moved),
    "Vector3Stamped": ("vector", _turned),
    "QuaternionStamped": ("quaternion", _rotated),
    "PoseStamped": ("pose", _transformed_pose),
    "PoseWithCovarianceStamped": ("pose", _pose_with_covariance),
    "PoseArray": ("poses", _poses),
    "PolygonStamped": ("polygon", _polygon),
}
"""Fields that a transform changes, by message class. Each has the field's name and the function that returns the
transformed value."""
