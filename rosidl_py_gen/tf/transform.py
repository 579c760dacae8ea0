"""Transform between two frames: numpy arrays and methods that apply them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.numpy import ConversionError, quaternion_to_matrix
from rosidl_py_gen.numpy.common import message_class
from rosidl_py_gen.tf.message_transforms import T, transformed
from rosidl_py_gen.tf.quaternion_math import product

if TYPE_CHECKING:
    from rosidl_py_gen.numpy.common import M

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """Transform of coordinates in `source` to coordinates in `target`.

    Attributes:
        target: ``header.frame_id`` of a TransformStamped.
        source: ``child_frame_id``.
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
        """Homogeneous matrix of shape ``(4, 4)``."""
        matrix = np.eye(4)
        matrix[:3, :3] = quaternion_to_matrix(self.rotation)
        matrix[:3, 3] = self.translation
        return matrix

    def apply(self, points: Any) -> Array:
        """Return points of shape ``(..., 3)``, given in `source`, in `target`; raises `ConversionError` for others."""
        result: Array = self.rotate(points) + self.translation
        return result

    def rotate(self, vectors: Any) -> Array:
        """Return directions, velocities or normals of shape ``(..., 3)``: as `apply`, without the translation."""
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
        return transformed(self, message)

    def inverse(self) -> Transform:
        """Return the transform from `target` to `source`."""
        rotation = self.rotation * (-1, -1, -1, 1)
        moved = -(quaternion_to_matrix(rotation) @ self.translation)
        return Transform(self.source, self.target, self.stamp, moved, rotation)

    def __matmul__(self, first: Transform) -> Transform:
        """Return the transform that applies `first`, whose target must be the source of this one, then this one."""
        if self.source != first.target:
            raise ConversionError(f'cannot join: "{first.source}" to "{first.target}", then "{self.source}"')
        rotation = product(tuple(self.rotation.tolist()), tuple(first.rotation.tolist()))
        return Transform(self.target, first.source, self.stamp, self.apply(first.translation), np.array(rotation))

    def to_message(self, *, cls: type[M] | None = None) -> M:
        """Return a ``geometry_msgs/msg/TransformStamped``; `cls` is its class, None means that of `get_message`."""
        message: Any = message_class(cls, "geometry_msgs/msg/TransformStamped")()
        message.header.frame_id, message.child_frame_id = self.target, self.source
        set_stamp(message.header.stamp, self.stamp)
        move, turn = message.transform.translation, message.transform.rotation
        move.x, move.y, move.z = self.translation.tolist()
        turn.x, turn.y, turn.z, turn.w = self.rotation.tolist()
        return cast("M", message)
