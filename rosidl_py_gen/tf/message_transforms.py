"""Transformed copies of messages: positions and directions change, all else stays.

As in tf2, the copy has the frame and the time of the transform. The name of the message's class selects the function,
so classes of any library work.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.errors import printable
from rosidl_py_gen.message_filters.header_stamp import header_stamp
from rosidl_py_gen.numpy import ConversionError, pointcloud_to_array, quaternion_to_matrix
from rosidl_py_gen.numpy.common import flat_bytes
from rosidl_py_gen.tf.frame_tree import without_slash
from rosidl_py_gen.tf.quaternion_math import product

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.tf.transform import Transform

T = TypeVar("T")


def transformed(transform: Transform, message: T) -> T:
    """Return a copy in the target frame; raises `ConversionError` if the message has another frame or no known type."""
    name = type(message).__name__.rpartition("__")[2]  # some libraries put the package in front
    if name not in _TRANSFORMERS:
        raise ConversionError(f"cannot transform {type(message).__name__}; expected one of {', '.join(_TRANSFORMERS)}")
    frame, _ = frame_and_stamp(message)
    if frame != transform.source:
        quoted = printable(frame, 100)
        raise ConversionError(f'header.frame_id: "{quoted}", but the transform is from "{transform.source}"')
    result: Any = copy(message)
    result.header = copy(result.header)
    result.header.frame_id = transform.target
    if transform.stamp:
        result.header.stamp = copy(result.header.stamp)
        set_stamp(result.header.stamp, transform.stamp)
    _TRANSFORMERS[name](transform, result)
    return result  # type: ignore[no-any-return]


def frame_and_stamp(message: Any) -> tuple[str, int]:
    """Return frame and stamp of the header; raises `ConversionError` if the message has none."""
    stamp = header_stamp(message)
    frame = getattr(getattr(message, "header", None), "frame_id", None)
    if stamp is None or not isinstance(frame, str):
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


def _transformed_pose(transform: Transform, pose: Any) -> Any:
    changed = copy(pose)
    changed.position = _with_xyz(pose.position, transform.apply(_xyz(pose.position)))
    changed.orientation = _rotated(transform, pose.orientation)
    return changed


def _point(transform: Transform, message: Any) -> None:
    message.point = _with_xyz(message.point, transform.apply(_xyz(message.point)))


def _vector(transform: Transform, message: Any) -> None:
    message.vector = _with_xyz(message.vector, transform.rotate(_xyz(message.vector)))


def _quaternion(transform: Transform, message: Any) -> None:
    message.quaternion = _rotated(transform, message.quaternion)


def _pose(transform: Transform, message: Any) -> None:
    message.pose = _transformed_pose(transform, message.pose)


def _pose_with_covariance(transform: Transform, message: Any) -> None:
    inner = message.pose = copy(message.pose)
    inner.pose = _transformed_pose(transform, inner.pose)
    turn = np.kron(np.eye(2), quaternion_to_matrix(transform.rotation))  # position and angles
    inner.covariance = (turn @ np.reshape(inner.covariance, (6, 6)) @ turn.T).reshape(36)


def _pose_array(transform: Transform, message: Any) -> None:
    message.poses = [_transformed_pose(transform, pose) for pose in message.poses]


def _polygon(transform: Transform, message: Any) -> None:
    polygon = message.polygon = copy(message.polygon)
    points = transform.apply(np.array([_xyz(point) for point in polygon.points]).reshape(-1, 3))
    polygon.points = [_with_xyz(*pair) for pair in zip(polygon.points, points, strict=True)]


def _cloud(transform: Transform, message: Any) -> None:
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


_TRANSFORMERS: dict[str, Callable[[Transform, Any], None]] = {
    "PointStamped": _point,
    "Vector3Stamped": _vector,
    "QuaternionStamped": _quaternion,
    "PoseStamped": _pose,
    "PoseWithCovarianceStamped": _pose_with_covariance,
    "PoseArray": _pose_array,
    "PolygonStamped": _polygon,
    "PointCloud2": _cloud,
}
