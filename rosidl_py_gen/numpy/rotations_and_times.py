"""Conversions between quaternions, rotation matrices, Euler angles and homogeneous transforms, and of times.

Quaternions have the order x, y, z, w, as in ``geometry_msgs``. Euler angles are roll, pitch, yaw in radians about the
fixed axes x, y, z (REP 103). Every function is vectorized: the last axes are one quaternion or matrix.

``builtin_interfaces`` Time and Duration become Python's `datetime` and `timedelta`, and the reverse. Python counts
microseconds: converting to it drops the last three digits of the nanoseconds, rounding down.
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from typing import Any, cast

import numpy as np

from rosidl_py_gen.base.stamps import sec_nanosec, stamp_ns
from rosidl_py_gen.numpy.common import ConversionError, M, as_float64, message_class, reads_message

Array = np.ndarray[Any, np.dtype[np.float64]]
_TOLERANCE = 1e-3
"""Maximum deviation of a matrix from a rotation matrix that is accepted: enough for float32 and for values printed with
four digits."""


def _quaternions(value: Any) -> Array:
    if hasattr(value, "x") and hasattr(value, "w"):
        value = (value.x, value.y, value.z, value.w)
    quaternion = as_float64(value, "quaternions x, y, z, w")
    if not quaternion.ndim or quaternion.shape[-1] != 4:
        raise ConversionError(f"expected quaternions x, y, z, w, got shape {quaternion.shape}")
    norm = np.linalg.norm(quaternion, axis=-1, keepdims=True)
    if not (np.isfinite(norm).all() and (norm > 0).all()):
        raise ConversionError(f"expected quaternions that are rotations, got {quaternion.tolist()!r:.200}")
    unit: Array = quaternion / norm
    return unit


def quaternion_to_matrix(quaternion: Any) -> Array:
    """Return rotation matrices of shape ``(..., 3, 3)`` for a Quaternion message, or for an array ``(..., 4)``.

    Quaternions need not have length 1.

    Raises:
        ConversionError: the shape is another, or a quaternion is zero or not finite.
    """
    x, y, z, w = np.moveaxis(_quaternions(quaternion), -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def matrix_to_quaternion(matrix: Any) -> Array:
    """Return quaternions of shape ``(..., 4)`` with w >= 0 for rotation matrices of shape ``(..., 3, 3)``.

    Raises:
        ConversionError: the shape is another, or a matrix is not a rotation: its columns are not perpendicular and of
            length 1, or it mirrors.
    """
    rotation = as_float64(matrix, "matrices of 3 x 3")
    if rotation.shape[-2:] != (3, 3):
        raise ConversionError(f"expected matrices of 3 x 3, got shape {rotation.shape}")
    error = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3))
    if not ((error < _TOLERANCE).all() and (np.linalg.det(rotation) > 0).all()):
        raise ConversionError(f"expected matrices that are rotations, got {rotation.tolist()!r:.200}")
    xx, yy, zz = (rotation[..., axis, axis] for axis in range(3))
    # Four times the squares of x, y, z and w. Dividing by the largest of them loses no precision.
    squares = np.stack([1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz], axis=-1)
    products = np.empty((*rotation.shape[:-2], 4, 4))
    products[..., range(4), range(4)] = squares
    for one, two in ((0, 1), (0, 2), (1, 2)):
        products[..., one, two] = products[..., two, one] = rotation[..., one, two] + rotation[..., two, one]
    for axis, (one, two) in enumerate(((2, 1), (0, 2), (1, 0))):
        products[..., axis, 3] = products[..., 3, axis] = rotation[..., one, two] - rotation[..., two, one]
    largest = np.argmax(squares, axis=-1)[..., None, None]
    rows = np.take_along_axis(products, largest, axis=-2)[..., 0, :]
    unit: Array = rows / np.linalg.norm(rows, axis=-1, keepdims=True)
    return np.where(unit[..., 3:] < 0, -unit, unit)


def euler_to_quaternion(roll: Any, pitch: Any, yaw: Any) -> Array:
    """Return quaternions of shape ``(..., 4)`` for Euler angles in radians.

    Raises:
        ConversionError: an argument is not made of numbers.
    """
    halves = np.broadcast_arrays(*(as_float64(angle, "angles in radians") / 2 for angle in (roll, pitch, yaw)))
    (sr, sp, sy), (cr, cp, cy) = np.sin(halves), np.cos(halves)
    return np.stack(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ],
        axis=-1,
    )


def quaternion_to_euler(quaternion: Any) -> Array:
    """Return roll, pitch, yaw in radians, with shape ``(..., 3)``, for a Quaternion message or an array ``(..., 4)``.

    Pitch is from -pi/2 to pi/2; at both ends of that range, roll is 0.

    Raises:
        ConversionError: the shape is another, or a quaternion is zero or not finite.
    """
    x, y, z, w = np.moveaxis(_quaternions(quaternion), -1, 0)
    sine = 2 * (w * y - x * z)
    pitch = np.arcsin(np.clip(sine, -1, 1))
    is_vertical = np.abs(sine) > 1 - 1e-12
    roll = np.where(is_vertical, 0.0, np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))
    yaw = np.where(
        is_vertical,
        np.arctan2(2 * (w * z - x * y), 1 - 2 * (x * x + z * z)),
        np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )
    return np.stack([roll, pitch, yaw], axis=-1)


@reads_message("a transform or a pose")
def transform_to_matrix(transform: Any) -> Array:
    """Return the 4 x 4 matrix of a Transform (translation, rotation) or Pose (position, orientation) message, stamped
    or not.

    Raises:
        ConversionError: the message is neither of these, or its rotation is zero or not finite.
    """
    for inner in ("transform", "pose"):
        transform = getattr(transform, inner, transform)
    move = getattr(transform, "translation", getattr(transform, "position", None))
    turn = getattr(transform, "rotation", getattr(transform, "orientation", None))
    if move is None or turn is None:
        raise ConversionError(f"expected a transform or a pose, got {type(transform).__name__}")
    matrix = np.eye(4)
    matrix[:3, :3] = quaternion_to_matrix(turn)
    matrix[:3, 3] = (move.x, move.y, move.z)
    return matrix


def matrix_to_transform(matrix: Any, *, cls: type[M] | None = None) -> M:
    """Return a Transform or Pose message with the translation and rotation of a 4 x 4 matrix.

    Args:
        cls: class of the message; None means Transform.

    Raises:
        ConversionError: the matrix has another shape or last row, or is not a rotation.
    """
    values = as_float64(matrix, "a matrix of 4 x 4")
    if values.shape != (4, 4) or not np.allclose(values[3], (0, 0, 0, 1)):
        raise ConversionError(f"expected a matrix of 4 x 4 with the last row 0, 0, 0, 1, got {values.tolist()!r:.200}")
    message: Any = message_class(cls, "geometry_msgs/msg/Transform")()
    move = message.translation if hasattr(message, "translation") else message.position
    turn = message.rotation if hasattr(message, "rotation") else message.orientation
    move.x, move.y, move.z = values[:3, 3].tolist()
    turn.x, turn.y, turn.z, turn.w = matrix_to_quaternion(values[:3, :3]).tolist()
    return cast("M", message)


# ---------------------------------------------------------------------------------------------------------------- times


_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_MICROSECOND = timedelta(microseconds=1)


def _nanoseconds(message: Any) -> int:
    try:
        return stamp_ns(message)
    except (AttributeError, TypeError, ValueError):
        raise ConversionError(f"expected sec and nanosec, got {message!r:.100}") from None


def time_to_datetime(stamp: Any) -> datetime:
    """Return the moment of a Time message as a datetime with the time zone UTC."""
    return _EPOCH + timedelta(microseconds=_nanoseconds(stamp) // 1000)


def datetime_to_time(moment: datetime, *, cls: type[M] | None = None) -> M:
    """Return a Time message for a datetime.

    Raises:
        ConversionError: `moment` is not a datetime; has no time zone, so that it means another moment on another
            machine; or is not from 1901 to 2038.
    """
    if not isinstance(moment, datetime):
        raise ConversionError(f"expected a datetime, got {moment!r:.100}")
    if moment.tzinfo is None:
        raise ConversionError(f"{moment} has no time zone; local time is moment.astimezone()")
    return _from_nanoseconds((moment - _EPOCH) // _MICROSECOND * 1000, cls, "builtin_interfaces/msg/Time")


def duration_to_timedelta(duration: Any) -> timedelta:
    """Return the length of a Duration message as a timedelta."""
    return timedelta(microseconds=_nanoseconds(duration) // 1000)


def timedelta_to_duration(length: timedelta, *, cls: type[M] | None = None) -> M:
    """Return a Duration message for a timedelta.

    Raises:
        ConversionError: `length` is not a timedelta, or exceeds 68 years.
    """
    if not isinstance(length, timedelta):
        raise ConversionError(f"expected a timedelta, got {length!r:.100}")
    return _from_nanoseconds(length // _MICROSECOND * 1000, cls, "builtin_interfaces/msg/Duration")


def _from_nanoseconds(nanoseconds: int, cls: type[M] | None, name: str) -> M:
    sec, nanosec = sec_nanosec(nanoseconds)
    if not -(2**31) <= sec < 2**31:
        raise ConversionError(f"{sec} seconds do not fit the int32 of {name}")
    return message_class(cls, name)(sec=sec, nanosec=nanosec)
