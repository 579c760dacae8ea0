"""Euler angles and quaternions; these are x, y, z, w."""

from __future__ import annotations

import math
from itertools import permutations, product
from typing import Any

import numpy as np

from rosidl_py_gen.numpy import matrix_to_quaternion, quaternion_to_matrix
from tf_transformations.vectors import _EPS, Array, unit_vector

_XYZ = "xyz"
_NEXT_AXIS = [1, 2, 0, 1]


def _encoded(axes: str) -> tuple[int, int, int, int]:
    """Innermost axis, whether the order is odd, whether the first axis comes again, whether axes turn along."""
    order = axes[1:] if axes[0] == "s" else axes[:0:-1]
    first, second = _XYZ.index(order[0]), _XYZ.index(order[1])
    return first, int((first + 1) % 3 != second), int(order[0] == order[2]), int(axes[0] == "r")


_AXES2TUPLE = {
    name: _encoded(name)
    for frame, (one, two, three) in product("sr", permutations(_XYZ))
    for name in (f"{frame}{one}{two}{three}", f"{frame}{one}{two}{one}")
}
"""The 24 orders of axes, by names: s are fixed ones, r turn along."""
_TUPLE2AXES = {encoded: name for name, encoded in _AXES2TUPLE.items()}


def _order(axes: Any) -> tuple[bool, list[int]]:
    """Whether axes turn along, and their numbers as they are written; raises KeyError for what is no order."""
    name = axes.lower() if isinstance(axes, str) else _TUPLE2AXES[tuple(axes)]
    _AXES2TUPLE[name]
    return name[0] == "r", [_XYZ.index(letter) for letter in name[1:]]


def _homogeneous(rotation: Array) -> Array:
    made = np.eye(4)
    made[:3, :3] = rotation
    return made


# --- Euler angles -----------------------------------------------------------------------------------------------------


def euler_matrix(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> Array:
    """The rotation, 4 x 4, of three angles; `axes` is one of 24 orders, a name or a tuple."""
    return quaternion_matrix(quaternion_from_euler(ai, aj, ak, axes))


def euler_from_matrix(matrix: Any, axes: Any = "sxyz") -> tuple[float, float, float]:
    """Three angles of a rotation, 3 x 3 or 4 x 4; where the first and last axis coincide, one of them is 0."""
    turns_along, order = _order(axes)
    i, j, last = order[::-1] if turns_along else order
    k = 3 - i - j
    sign = 1.0 if (i + 1) % 3 == j else -1.0
    m = np.asarray(matrix, np.float64)[:3, :3]
    if last == i:
        across = math.hypot(m[i, j], m[i, k])
        middle = math.atan2(across, m[i, i])
        outer = (m[i, j], m[i, k]), (m[j, i], -m[k, i])
    else:
        across = math.hypot(m[i, i], m[j, i])
        middle = math.atan2(-m[k, i], across)
        outer = (m[k, j], m[k, k]), (m[j, i], m[i, i])
    if across > _EPS:
        first, third = math.atan2(*outer[0]), math.atan2(*outer[1])
    else:
        first, third = math.atan2(-m[j, k], m[j, j]), 0.0
    first, middle, third = sign * first, sign * middle, sign * third
    return (third, middle, first) if turns_along else (first, middle, third)


def euler_from_quaternion(quaternion: Any, axes: Any = "sxyz") -> tuple[float, float, float]:
    """Three angles of a quaternion."""
    return euler_from_matrix(quaternion_matrix(quaternion), axes)


def quaternion_from_euler(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> tuple[Any, Any, Any, Any]:
    """The quaternion of three angles in radians."""
    turns_along, order = _order(axes)
    turns = []
    for axis, angle in zip(order, (ai, aj, ak), strict=True):
        turn = [0.0, 0.0, 0.0, math.cos(angle / 2.0)]
        turn[axis] = math.sin(angle / 2.0)
        turns.append(turn)
    first, second, third = turns if turns_along else turns[::-1]
    return quaternion_multiply(quaternion_multiply(first, second), third)


# --- quaternions ------------------------------------------------------------------------------------------------------


def quaternion_about_axis(angle: float, axis: Any) -> tuple[Any, Any, Any, Any]:
    """The quaternion of an angle about an axis of any length."""
    x, y, z = unit_vector(axis) * math.sin(angle / 2.0)
    return x, y, z, np.float64(math.cos(angle / 2.0))


def quaternion_matrix(quaternion: Any) -> Array:
    """The rotation, 4 x 4, of a quaternion of any length; no rotation for zero, NaN for what is not finite."""
    values = np.asarray(quaternion, np.float64)
    if not np.isfinite(values).all():
        return _homogeneous(np.full((3, 3), np.nan))
    if np.dot(values, values) < np.finfo(np.float64).eps:
        return np.eye(4)
    return _homogeneous(quaternion_to_matrix(values))


def quaternion_from_matrix(matrix: Any) -> tuple[Any, Any, Any, Any]:
    """The quaternion of what turns in a 4 x 4 matrix, whose scale and shear do not count; w is not negative."""
    x, y, z, w = matrix_to_quaternion(_parts(np.asarray(matrix, np.float64)[:3, :3])[0])
    return x, y, z, w


def _parts(matrix: Array) -> tuple[Array, Array, Array]:
    """Rotation, scales and shears of 3 x 3: ``rotation @ diag(scales) @ [[1, xy, xz], [0, 1, yz], [0, 0, 1]]``.

    Raises LinAlgError for what has no inverse.
    """
    upper = np.linalg.cholesky(matrix.T @ matrix).T
    if np.linalg.det(matrix) < 0:
        upper[0] *= -1
    scales = np.diag(upper).copy()
    shears = (upper / scales[:, None])[np.triu_indices(3, 1)]
    return matrix @ np.linalg.inv(upper), scales, shears


def quaternion_multiply(quaternion1: Any, quaternion0: Any) -> tuple[Any, Any, Any, Any]:
    """Their product: first `quaternion0`, then `quaternion1`."""
    ax, ay, az, aw = map(np.float64, quaternion1)
    bx, by, bz, bw = map(np.float64, quaternion0)
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def quaternion_conjugate(quaternion: Any) -> Array:
    """The rotation back of a quaternion of length 1."""
    return np.asarray(quaternion, np.float64) * (-1.0, -1.0, -1.0, 1.0)


def quaternion_inverse(quaternion: Any) -> Array:
    """What it is multiplied with to give 0, 0, 0, 1."""
    inverse: Array = quaternion_conjugate(quaternion) / np.dot(quaternion, quaternion)
    return inverse


def quaternion_slerp(quat0: Any, quat1: Any, fraction: float, spin: int = 0, shortestpath: bool = True) -> Array:
    """What is between two quaternions, at a fraction of the way; `spin` adds half turns."""
    start: Array = unit_vector(quat0[:4])
    end: Array = unit_vector(quat1[:4])
    if fraction == 1.0:
        return end
    cosine = float(np.dot(start, end))
    if fraction == 0.0 or abs(abs(cosine) - 1.0) < _EPS:
        return start
    if shortestpath and cosine < 0.0:
        cosine, end = -cosine, -end
    angle = math.acos(cosine) + spin * math.pi
    if abs(angle) < _EPS:
        return start
    mixed: Array = (math.sin((1.0 - fraction) * angle) * start + math.sin(fraction * angle) * end) / math.sin(angle)
    return mixed


def random_quaternion(rand: Any = None) -> Array:
    """Any rotation as likely as any other; `rand` are three numbers from 0 to 1."""
    if rand is None:
        rand = np.random.rand(3)
    assert len(rand) == 3, f"expected three numbers, got {len(rand)}"
    one, two = 2.0 * math.pi * rand[1], 2.0 * math.pi * rand[2]
    near, far = math.sqrt(1.0 - rand[0]), math.sqrt(rand[0])
    return np.array((math.sin(one) * near, math.cos(one) * near, math.sin(two) * far, math.cos(two) * far))


def random_rotation_matrix(rand: Any = None) -> Array:
    """The 4 x 4 matrix of `random_quaternion`."""
    return quaternion_matrix(random_quaternion(rand))
