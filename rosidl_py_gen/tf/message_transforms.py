"""Messages given in another frame: copies of which only what has a place or a direction is another one.

Decides, as tf2 does, that the copy has the frame and the time of the transform. Which message it is, the name of its
class says, whoever made that.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.errors import printable
from rosidl_py_gen.message_filters.stamps import header_stamp
from rosidl_py_gen.numpy import ConversionError, pointcloud_to_array, quaternion_to_matrix
from rosidl_py_gen.tf.frame_tree import without_slash
from rosidl_py_gen.tf.quaternion_math import product

if TYPE_CHECKING:
    from collections.abc import Callable

T = TypeVar("T")


class AppliesTransform(Protocol):
    """What is asked of the class of this name, which itself uses this file."""

    @property
    def target(self) -> str: ...
    @property
    def source(self) -> str: ...
    @property
    def stamp(self) -> int: ...
    @property
    def rotation(self) -> np.ndarray[Any, np.dtype[np.float64]]: ...
    def apply(self, points: Any) -> np.ndarray[Any, np.dtype[np.float64]]: ...
    def rotate(self, vectors: Any) -> np.ndarray[Any, np.dtype[np.float64]]: ...


def transformed(transform: AppliesTransform, message: T) -> T:
    """A copy in the target frame; raises `ConversionError` for what has no place in a frame, or is in another one."""
    name = type(message).__name__.rpartition("__")[2]  # some libraries put the package in front
    if name not in _TRANSFORMERS:
        raise ConversionError(f"cannot transform {type(message).__name__}; expected one of {', '.join(_TRANSFORMERS)}")
    given: Any = message
    frame, _ = frame_and_stamp(message)
    if frame != transform.source:
        found = printable(frame, 100)
        raise ConversionError(f'header.frame_id: "{found}", but the transform is from "{transform.source}"')
    moved = copy(given)
    moved.header = copy(given.header)
    moved.header.frame_id = transform.target
    if transform.stamp:
        moved.header.stamp = copy(given.header.stamp)
        set_stamp(moved.header.stamp, transform.stamp)
    _TRANSFORMERS[name](transform, moved)
    return moved  # type: ignore[no-any-return]


def frame_and_stamp(message: Any) -> tuple[str, int]:
    """What the header says; raises `ConversionError` without one."""
    stamp = header_stamp(message)
    frame = getattr(getattr(message, "header", None), "frame_id", None)
    if stamp is None or not isinstance(frame, str):
        raise ConversionError(f"cannot transform {type(message).__name__}: it has no header")
    return without_slash(frame), stamp


def _with_xyz(value: Any, numbers: Any) -> Any:
    changed = copy(value)
    changed.x, changed.y, changed.z = numbers.tolist()
    return changed


def _rotated(transform: AppliesTransform, value: Any) -> Any:
    changed = copy(value)
    rotation = tuple(transform.rotation.tolist())
    changed.x, changed.y, changed.z, changed.w = product(rotation, (value.x, value.y, value.z, value.w))
    return changed


def _transformed_pose(transform: AppliesTransform, pose: Any) -> Any:
    changed = copy(pose)
    at = pose.position
    changed.position = _with_xyz(at, transform.apply((at.x, at.y, at.z)))
    changed.orientation = _rotated(transform, pose.orientation)
    return changed


def _point(transform: AppliesTransform, message: Any) -> None:
    at = message.point
    message.point = _with_xyz(at, transform.apply((at.x, at.y, at.z)))


def _vector(transform: AppliesTransform, message: Any) -> None:
    to = message.vector
    message.vector = _with_xyz(to, transform.rotate((to.x, to.y, to.z)))


def _quaternion(transform: AppliesTransform, message: Any) -> None:
    message.quaternion = _rotated(transform, message.quaternion)


def _pose(transform: AppliesTransform, message: Any) -> None:
    message.pose = _transformed_pose(transform, message.pose)


def _pose_with_covariance(transform: AppliesTransform, message: Any) -> None:
    inner = message.pose = copy(message.pose)
    inner.pose = _transformed_pose(transform, inner.pose)
    turn = np.kron(np.eye(2), quaternion_to_matrix(transform.rotation))  # of the place, and of the angles
    inner.covariance = (turn @ np.reshape(inner.covariance, (6, 6)) @ turn.T).reshape(36)


def _pose_array(transform: AppliesTransform, message: Any) -> None:
    message.poses = [_transformed_pose(transform, pose) for pose in message.poses]


def _polygon(transform: AppliesTransform, message: Any) -> None:
    polygon = message.polygon = copy(message.polygon)
    places = transform.apply(np.array([(one.x, one.y, one.z) for one in polygon.points]).reshape(-1, 3))
    polygon.points = [_with_xyz(one, place) for one, place in zip(polygon.points, places, strict=True)]


def _cloud(transform: AppliesTransform, message: Any) -> None:
    """Columns of numbers: x, y and z, and normals where there are some; all other bytes stay as they are."""
    kept = pointcloud_to_array(message)
    message.data = np.array(
        np.frombuffer(message.data, np.uint8) if _is_bytes(message.data) else message.data, np.uint8
    )
    points = pointcloud_to_array(message)
    _move(kept, points, ("x", "y", "z"), transform.apply)
    if {"normal_x", "normal_y", "normal_z"} <= {*(points.dtype.names or ())}:
        _move(kept, points, ("normal_x", "normal_y", "normal_z"), transform.rotate)


def _is_bytes(data: Any) -> bool:
    return isinstance(data, bytes | bytearray | memoryview)


def _move(
    kept: np.ndarray[Any, Any], points: np.ndarray[Any, Any], names: tuple[str, ...], act: Callable[[Any], Any]
) -> None:
    for name in names:
        kind = points.dtype[name] if name in (points.dtype.names or ()) else None
        if kind is None or kind.kind != "f" or kind.shape:
            raise ConversionError(f'fields: transforming needs "{name}" as FLOAT32 or FLOAT64, got {kind or "none"}')
    with np.errstate(all="ignore"):  # what is not finite, or beyond float32, stays or becomes so
        moved = act(np.stack([kept[name] for name in names], -1))
        for number, name in enumerate(names):
            points[name] = moved[..., number]


_TRANSFORMERS: dict[str, Callable[[AppliesTransform, Any], None]] = {
    "PointStamped": _point,
    "Vector3Stamped": _vector,
    "QuaternionStamped": _quaternion,
    "PoseStamped": _pose,
    "PoseWithCovarianceStamped": _pose_with_covariance,
    "PoseArray": _pose_array,
    "PolygonStamped": _polygon,
    "PointCloud2": _cloud,
}
