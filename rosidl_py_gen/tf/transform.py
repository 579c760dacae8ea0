"""One transform, as it is asked for: numpy arrays, and methods to use it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.numpy import ConversionError, quaternion_to_matrix
from rosidl_py_gen.tf.message_transforms import T, transformed
from rosidl_py_gen.tf.quaternion_math import product

if TYPE_CHECKING:
    from rosidl_py_gen.numpy.common import M

Array = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """Turns coordinates in `source` into coordinates in `target`.

    Attributes:
        target: ``header.frame_id`` of a TransformStamped.
        source: ``child_frame_id``.
        stamp: nanoseconds; 0 when only static transforms are in it.
        translation: metres, shape ``(3,)``: where the origin of `source` is in `target`.
        rotation: quaternion x, y, z, w, shape ``(4,)``.
    """

    target: str
    source: str
    stamp: int
    translation: Array
    rotation: Array

    @property
    def matrix(self) -> Array:
        """Homogeneous, shape ``(4, 4)``."""
        matrix = np.eye(4)
        matrix[:3, :3] = quaternion_to_matrix(self.rotation)
        matrix[:3, 3] = self.translation
        return matrix

    def apply(self, points: Any) -> Array:
        """Points of shape ``(..., 3)`` in `target` that are given in `source`; raises `ConversionError` for others."""
        given = np.asarray(points, np.float64)
        if not given.ndim or given.shape[-1] != 3:
            raise ConversionError(f"expected points of shape (..., 3), got {given.shape}")
        turned: Array = given @ quaternion_to_matrix(self.rotation).T + self.translation
        return turned

    def rotate(self, vectors: Any) -> Array:
        """Directions, velocities, normals of shape ``(..., 3)``: as `apply`, without the translation."""
        given = np.asarray(vectors, np.float64)
        if not given.ndim or given.shape[-1] != 3:
            raise ConversionError(f"expected vectors of shape (..., 3), got {given.shape}")
        turned: Array = given @ quaternion_to_matrix(self.rotation).T
        return turned

    def transform(self, message: T) -> T:
        """A message of `source`, in `target`: a copy whose header has that frame, and the time of this transform.

        Args:
            message: a PointStamped, Vector3Stamped, QuaternionStamped, PoseStamped, PoseWithCovarianceStamped,
                PoseArray, PolygonStamped or PointCloud2. Of a cloud only x, y and z change, and normals, as columns of
                numbers.

        Raises:
            ConversionError: another message; its frame is not `source`; the cloud has no x, y and z of floats.
        """
        return transformed(self, message)

    def inverse(self) -> Transform:
        """From `target` to `source`."""
        rotation = self.rotation * (-1, -1, -1, 1)
        moved = -(quaternion_to_matrix(rotation) @ self.translation)
        return Transform(self.source, self.target, self.stamp, moved, rotation)

    def __matmul__(self, first: Transform) -> Transform:
        """First `first`, then this one, whose source has to be the target of `first`."""
        if self.source != first.target:
            raise ConversionError(f'cannot join: "{first.source}" to "{first.target}", then "{self.source}"')
        rotation = product(tuple(self.rotation.tolist()), tuple(first.rotation.tolist()))
        return Transform(self.target, first.source, self.stamp, self.apply(first.translation), np.array(rotation))

    @overload
    def to_message(self, *, cls: type[M]) -> M: ...
    @overload
    def to_message(self, *, cls: None = None) -> Any: ...
    def to_message(self, *, cls: type[M] | None = None) -> Any:
        """A ``geometry_msgs/msg/TransformStamped``; `cls` is its class, None means the one of `get_message`."""
        maker: Any = get_message("geometry_msgs/msg/TransformStamped") if cls is None else cls
        message = maker()
        message.header.frame_id, message.child_frame_id = self.target, self.source
        set_stamp(message.header.stamp, self.stamp)
        move, turn = message.transform.translation, message.transform.rotation
        move.x, move.y, move.z = self.translation.tolist()
        turn.x, turn.y, turn.z, turn.w = self.rotation.tolist()
        return message
