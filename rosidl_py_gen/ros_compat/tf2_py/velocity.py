"""Velocity of a frame from its transforms at two times, with the steps of tf2."""

import math
from typing import Any

import numpy as np

from rosidl_py_gen import tf
from rosidl_py_gen.numpy import matrix_to_quaternion

Triple = tuple[float, float, float]
_EARLIEST_TIME_S = 0.00001
"""Earliest time to look up, in seconds. Not 0, because tf2 reads time 0 as "latest"."""


def velocity(
    buffer: tf.TransformBuffer,
    frames: tuple[str, str, str],
    point: Any,
    point_frame: str,
    time_s: float,
    interval_s: float,
) -> tuple[Triple, Triple]:
    """Return the linear and angular velocity in m/s and rad/s.

    Args:
        frames: the moving frame, the frame in which it is observed, and the frame of the result.
        point: point to which the linear velocity applies, in `point_frame`.
        time_s: middle of the interval; earlier if the latest transform is too old.
    """
    tracking_frame, observation_frame, reference_frame = frames
    end = min(time_s + interval_s * 0.5, buffer.lookup_transform(observation_frame, tracking_frame).stamp / 1e9)
    start = max(_EARLIEST_TIME_S + interval_s, end) - interval_s
    before, after = (
        buffer.lookup_transform(observation_frame, tracking_frame, round(time * 1e9)) for time in (start, end)
    )
    now = round(time_s * 1e9)
    result = buffer.lookup_transform(reference_frame, tracking_frame, now)
    with np.errstate(all="ignore"):  # as in tf2, an interval of zero results in NaN
        angular = result.rotate(
            before.rotate(_rotation_vector(before.matrix[:3, :3].T @ after.matrix[:3, :3])) / np.float64(end - start)
        )
        linear = result.rotate((after.translation - before.translation) / np.float64(end - start))
    linear += np.cross(result.translation, angular)
    # An elementwise product, as in tf2, not a cross product.
    linear += angular * (buffer.lookup_transform(reference_frame, point_frame, now).apply(point) - result.translation)
    return _to_triple(linear), _to_triple(angular)


def _rotation_vector(rotation: Any) -> Any:
    """Return axis times angle, which exceeds half a turn if that of tf2 does."""
    x, y, z, w = quaternion = matrix_to_quaternion(rotation)
    if np.trace(rotation) <= 0 and quaternion[np.argmax(np.diag(rotation))] < 0:
        x, y, z, w = -quaternion
    length = math.sqrt(max(0.0, 1.0 - w * w))
    return np.array((x, y, z)) / length * 2.0 * math.acos(min(max(w, -1.0), 1.0)) if length > 1e-15 else np.zeros(3)


def _to_triple(values: Any) -> Triple:
    x, y, z = values.tolist()
    return x, y, z
