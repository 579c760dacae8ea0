"""How fast a frame moves in another, by where it is at two times; as tf2 reckons it, step by step."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rosidl_py_gen import tf
from rosidl_py_gen.numpy import matrix_to_quaternion

Triple = tuple[float, float, float]
_FIRST_S = 0.00001
"""Nothing is looked up before: 0 would ask for the newest."""


def velocity(
    buffer: tf.TransformBuffer,
    frames: tuple[str, str, str],
    point: Any,
    point_frame: str,
    time_s: float,
    interval_s: float,
) -> tuple[Triple, Triple]:
    """Linear and angular velocity in m/s and rad/s.

    Args:
        frames: which moves, in which that is seen, and in which it is told.
        point: which the linear one is of, in `point_frame`.
        time_s: the middle of the interval, if that much is known.
    """
    tracked, observed, told = frames
    end = min(time_s + interval_s * 0.5, buffer.lookup_transform(observed, tracked).stamp / 1e9)
    start = max(_FIRST_S + interval_s, end) - interval_s
    before, after = (buffer.lookup_transform(observed, tracked, round(at * 1e9)) for at in (start, end))
    now = round(time_s * 1e9)
    shown = buffer.lookup_transform(told, tracked, now)
    with np.errstate(all="ignore"):  # an interval of zero gives what is no number, as there
        angular = shown.rotate(
            before.rotate(_turn(before.matrix[:3, :3].T @ after.matrix[:3, :3])) / np.float64(end - start)
        )
        linear = shown.rotate((after.translation - before.translation) / np.float64(end - start))
    linear += np.cross(shown.translation, angular)
    # Not a cross product: tf2 multiplies one by one here.
    linear += angular * (buffer.lookup_transform(told, point_frame, now).apply(point) - shown.translation)
    return _triple(linear), _triple(angular)


def _turn(rotation: Any) -> Any:
    """Axis times angle, which is beyond half a turn where tf2's is."""
    x, y, z, w = quaternion = matrix_to_quaternion(rotation)
    if np.trace(rotation) <= 0 and quaternion[np.argmax(np.diag(rotation))] < 0:
        x, y, z, w = -quaternion
    length = math.sqrt(max(0.0, 1.0 - w * w))
    return np.array((x, y, z)) / length * 2.0 * math.acos(min(max(w, -1.0), 1.0)) if length > 1e-15 else np.zeros(3)


def _triple(values: Any) -> Triple:
    x, y, z = values.tolist()
    return x, y, z
