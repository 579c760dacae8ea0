"""Homogeneous matrices of 4 x 4: made of what they do, and taken apart again."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tf_transformations.rotations import (
    _homogeneous,
    _parts,
    euler_from_matrix,
    euler_matrix,
    quaternion_about_axis,
    quaternion_matrix,
)
from tf_transformations.vectors import _EPS, Array, unit_vector

TRANSLATION_IDENTITY = [0.0, 0.0, 0.0]
ROTATION_IDENTITY = np.identity(3, dtype=np.float64)
ZOOM_IDENTITY = [1.0, 1.0, 1.0]
SHEAR_IDENTITY = TRANSLATION_IDENTITY
_NEAR = 1e-8


def _three(values: Any) -> Array:
    return np.asarray(values, np.float64)[:3]


def _eigenvectors(matrix: Array, value: float, near: float = _NEAR) -> Array:
    """Those of an eigenvalue, as rows; none where there is no such eigenvalue."""
    values, vectors = np.linalg.eig(matrix)
    found: Array = vectors[:, np.abs(values.real - value) < near].real.T
    return found


def _fixed_point(matrix: Array) -> Array:
    """Homogeneous, of length 4; raises ValueError without one."""
    found = _eigenvectors(matrix, 1.0)
    if not len(found):
        raise ValueError("no eigenvector corresponding to eigenvalue 1")
    point: Array = found[-1] / found[-1][3]
    return point


# --- simple ones ------------------------------------------------------------------------------------------------------


def identity_matrix() -> Array:
    """What changes nothing."""
    return np.eye(4)


def inverse_matrix(matrix: Any) -> Array:
    """The inverse of a square matrix."""
    inverse: Array = np.linalg.inv(matrix)
    return inverse


def concatenate_matrices(*matrices: Any) -> Array:
    """Their product; the last one acts first."""
    joined = np.eye(4)
    for matrix in matrices:
        joined = np.dot(joined, matrix)
    return joined


def is_same_transform(matrix0: Any, matrix1: Any) -> bool:
    """Whether they do the same, nearly."""
    one, two = (np.array(matrix, np.float64) for matrix in (matrix0, matrix1))
    return bool(np.allclose(one / one[3, 3], two / two[3, 3]))


def translation_matrix(direction: Any) -> Array:
    """What moves."""
    made = np.eye(4)
    made[:3, 3] = direction
    return made


def translation_from_matrix(matrix: Any) -> Array:
    """How far it moves."""
    return np.asarray(matrix)[:-1, -1]


def reflection_matrix(point: Any, normal: Any) -> Array:
    """What mirrors at the plane of a point and its normal."""
    unit = unit_vector(_three(normal))
    made = _homogeneous(np.eye(3) - 2.0 * np.outer(unit, unit))
    made[:3, 3] = 2.0 * np.dot(_three(point), unit) * unit
    return made


def reflection_from_matrix(matrix: Any) -> tuple[Array, Array]:
    """Point and normal of the plane; raises ValueError for what does not mirror."""
    given = np.asarray(matrix, np.float64)
    normals = _eigenvectors(given[:3, :3], -1.0)
    if not len(normals):
        raise ValueError("no eigenvector corresponding to eigenvalue -1")
    if abs(np.linalg.det(given[:3, :3]) + 1.0) >= _NEAR:
        raise ValueError("the determinant is not -1")
    return _fixed_point(given)[:3], normals[0]


def rotation_matrix(angle: float, direction: Any, point: Any = None) -> Array:
    """What turns about an axis, through a point."""
    made = quaternion_matrix(quaternion_about_axis(angle, _three(direction)))
    if point is not None:
        made[:3, 3] = _three(point) - made[:3, :3] @ _three(point)
    return made


def rotation_from_matrix(matrix: Any) -> tuple[float, Array, Array]:
    """Angle, axis, and a point of length 4; raises ValueError for what does not turn."""
    given = np.asarray(matrix, np.float64)
    turn = given[:3, :3]
    axes = _eigenvectors(turn.T, 1.0, 1e-5)
    if not len(axes):
        raise ValueError("no eigenvector corresponding to eigenvalue 1")
    axis = axes[-1]
    across = np.array((turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]))
    angle = math.atan2(np.dot(across, axis), np.trace(turn) - 1.0)
    return angle, axis, _fixed_point(given)


def scale_matrix(factor: float, origin: Any = None, direction: Any = None) -> Array:
    """What makes larger, seen from `origin`; with a direction only along that."""
    if direction is None:
        change = (1.0 - factor) * np.eye(3)
    else:
        unit = unit_vector(_three(direction))
        change = (1.0 - factor) * np.outer(unit, unit)
    made = _homogeneous(np.eye(3) - change)
    if origin is not None:
        made[:3, 3] = change @ _three(origin)
    return made


def scale_from_matrix(matrix: Any) -> tuple[float, Array, Array | None]:
    """Factor, origin, direction; None is all directions."""
    given = np.asarray(matrix, np.float64)
    factor = float(np.trace(given[:3, :3])) - 2.0
    found = _eigenvectors(given[:3, :3], factor)
    direction: Array | None = unit_vector(found[0]) if len(found) else None
    if direction is None:
        factor = (factor + 2.0) / 3.0
    return factor, _fixed_point(given)[:3], direction


def shear_matrix(angle: float, direction: Any, point: Any, normal: Any) -> Array:
    """What shears along a direction in the plane of a point and its normal."""
    unit, along = unit_vector(_three(normal)), unit_vector(_three(direction))
    made = _homogeneous(np.eye(3) + math.tan(angle) * np.outer(along, unit))
    if point is not None:
        made[:3, 3] = -math.tan(angle) * np.dot(_three(point), unit) * along
    return made


def shear_from_matrix(matrix: Any) -> tuple[float, Array, Array, Array]:
    """Angle, direction, point, normal."""
    given = np.asarray(matrix, np.float64)
    left, lengths, right = np.linalg.svd(given[:3, :3] - np.eye(3))
    direction, normal = left[:, 0], right[0]
    at = int(np.argmax(np.abs(direction)))
    point = -given[at, 3] / (lengths[0] * direction[at]) * normal
    return math.atan(lengths[0]), direction, point, normal


# --- projections ------------------------------------------------------------------------------------------------------


def projection_matrix(
    point: Any, normal: Any, direction: Any = None, perspective: Any = None, pseudo: bool = False
) -> Array:
    """What projects on the plane of a point and its normal: at right angles, along `direction`, or to `perspective`.

    With `pseudo` a perspective one keeps depths apart.
    """
    place, unit = _three(point), unit_vector(_three(normal))
    height = np.dot(place, unit)
    if perspective is not None:
        eye = _three(perspective)
        made = _homogeneous(np.dot(eye - place, unit) * np.eye(3) - np.outer(eye, unit))
        made[:3, 3] = height * eye
        if pseudo:
            made[:3, :3] -= np.outer(unit, unit)
            made[:3, 3] = height * (eye + unit)
        made[3] = (*-unit, np.dot(eye, unit))
        return made
    along = unit if direction is None else _three(direction) / np.dot(_three(direction), unit)
    made = _homogeneous(np.eye(3) - np.outer(along, unit))
    made[:3, 3] = height * along
    return made


def projection_from_matrix(matrix: Any, pseudo: bool = False) -> tuple[Array, Array, Array | None, Array | None, bool]:
    """What `projection_matrix` takes; raises ValueError for what does not project."""
    given = np.asarray(matrix, np.float64)
    points = _eigenvectors(given, 1.0)
    if len(points) and not pseudo:
        directions, normals = (_eigenvectors(part, 0.0) for part in (given[:3, :3], given[:3, :3].T))
        if not len(directions):
            raise ValueError("no eigenvector corresponding to eigenvalue 0")
        point, direction = points[-1] / points[-1][3], unit_vector(directions[0])
        if not len(normals):
            return point, direction, None, None, False
        return point, unit_vector(normals[0]), direction, None, False
    values, vectors = np.linalg.eig(given)
    others = np.flatnonzero(np.abs(values.real) > _NEAR)
    if not len(others):
        raise ValueError("no eigenvector not corresponding to eigenvalue 0")
    last = vectors[:, others[-1]].real
    point, normal = last / last[3], -given[3, :3]
    perspective = given[:3, 3] / np.dot(point[:3], normal)
    return point, normal, None, perspective - normal if pseudo else perspective, pseudo


def clip_matrix(
    left: float, right: float, bottom: float, top: float, near: float, far: float, perspective: bool = False
) -> Array:
    """What turns a box, or with `perspective` a pyramid without its tip, into the cube from -1 to 1.

    Raises ValueError when it has no inside.
    """
    if left >= right or bottom >= top or near >= far:
        raise ValueError("invalid frustum: left, bottom and near must be less than right, top and far")
    low, high = np.array((left, bottom, near)), np.array((right, top, far))
    size, middle = high - low, high + low
    if not perspective:
        made = _homogeneous(np.diag(2.0 / size))
        made[:3, 3] = -middle / size
        return made
    if near <= _EPS:
        raise ValueError("invalid frustum: near <= 0")
    made = np.zeros((4, 4))
    made[0, 0], made[1, 1] = -2.0 * near / size[:2]
    made[:3, 2] = middle / size * (1.0, 1.0, -1.0)
    made[2, 3] = 2.0 * near * far / size[2]
    made[3, 2] = -1.0
    return made


# --- several at once --------------------------------------------------------------------------------------------------


def decompose_matrix(matrix: Any) -> tuple[Array, Array, tuple[float, float, float], Array, None]:
    """Scales, shears, angles, translation, and None for a perspective; raises LinAlgError for what has no inverse."""
    given = np.asarray(matrix, np.float64)
    rotation, scales, shears = _parts(given[:3, :3])
    return scales, shears, euler_from_matrix(rotation), given[:3, 3], None


def compose_matrix(
    scale: Any = None, shear: Any = None, angles: Any = None, translate: Any = None, perspective: Any = None
) -> Array:
    """What shears, scales, turns by angles about x, y, z, and moves, in that order; `perspective` does not count."""
    inner = np.eye(3)
    if shear is not None:
        inner[np.triu_indices(3, 1)] = shear
    made = euler_matrix(*angles) if angles is not None else np.eye(4)
    made[:3, :3] = made[:3, :3] @ np.diag(ZOOM_IDENTITY if scale is None else scale) @ inner
    made[:3, 3] = TRANSLATION_IDENTITY if translate is None else translate
    return made


def orthogonalization_matrix(lengths: Any, angles: Any) -> Array:
    """Coordinates of a crystal's cell, of edges and angles in degrees, at right angles to each other."""
    a, b, c = lengths
    (sin_a, sin_b, _), (cos_a, cos_b, cos_g) = np.sin(np.radians(angles)), np.cos(np.radians(angles))
    slant = (cos_a * cos_b - cos_g) / (sin_a * sin_b)
    rows = (a * sin_b * math.sqrt(1.0 - slant * slant), 0.0, 0.0), (-a * sin_b * slant, b * sin_a, 0.0)
    return _homogeneous(np.array((*rows, (a * cos_b, b * cos_a, c))))


def superimposition_matrix(v0: Any, v1: Any, scaling: bool = False, usesvd: bool = True) -> Array:
    """What turns and moves points into others, as nearly as can be: arrays of shape (3, n) or (4, n), n at least 3.

    `scaling` scales as well. Raises ValueError for other shapes.
    """
    one, two = (np.asarray(points, np.float64)[:3] for points in (v0, v1))
    if one.shape != two.shape or one.shape[1] < 3:
        raise ValueError(f"expected as many vectors in both, and at least 3, got {one.shape} and {two.shape}")
    middles = one.mean(axis=1), two.mean(axis=1)
    one, two = one - middles[0][:, None], two - middles[1][:, None]
    made = _turned_by_svd(one, two) if usesvd else _turned_by_quaternion(one, two)
    if scaling:
        made[:3, :3] *= math.sqrt(np.sum(two * two) / np.sum(one * one))
    made[:3, 3] = middles[1]
    return made @ translation_matrix(-middles[0])


def _turned_by_svd(one: Array, two: Array) -> Array:
    """The best rotation, as Kabsch found it."""
    left, _, right = np.linalg.svd(two @ one.T)
    if np.linalg.det(left @ right) < 0.0:  # it would mirror
        right[2] *= -1.0
    return _homogeneous(left @ right)


def _turned_by_quaternion(one: Array, two: Array) -> Array:
    """The best rotation, as Horn found it: the eigenvector of the largest eigenvalue."""
    s = one @ two.T
    across = s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]
    matrix = np.zeros((4, 4))
    matrix[0, 0] = np.trace(s)
    matrix[0, 1:] = matrix[1:, 0] = across
    matrix[1:, 1:] = s + s.T - np.trace(s) * np.eye(3)
    values, vectors = np.linalg.eigh(matrix)
    w, x, y, z = vectors[:, np.argmax(values)]
    return quaternion_matrix((x, y, z, w))
