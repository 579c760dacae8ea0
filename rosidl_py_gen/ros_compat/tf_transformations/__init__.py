"""Rotations and homogeneous matrices of tf_transformations, calculated by transforms3d (extra ``transformations``).

Quaternions are x, y, z, w; quaternions of transforms3d are w, x, y, z. Angles are in radians.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rosidl_py_gen.base.extras import Extra

try:
    # The private module has the functions that the public ones leave out; therefore the extra excludes the next minor
    # version of transforms3d. With numpy 2, some of its functions take arrays of float64 only.
    from transforms3d import _gohlketransforms as _gohlke
    from transforms3d import affines, axangles, euler, quaternions, reflections, shears, zooms
except ModuleNotFoundError as missing:
    raise Extra.missing_error(missing) or missing from None

_Quaternion = tuple[Any, Any, Any, Any]

TRANSLATION_IDENTITY = [0.0, 0.0, 0.0]
ROTATION_IDENTITY = np.identity(3, dtype=np.float64)
ZOOM_IDENTITY = [1.0, 1.0, 1.0]
SHEAR_IDENTITY = TRANSLATION_IDENTITY
_AXES2TUPLE = _gohlke._AXES2TUPLE
_EPS = _gohlke._EPS
_NEXT_AXIS = _gohlke._NEXT_AXIS
_TUPLE2AXES = _gohlke._TUPLE2AXES
arcball_constrain_to_axis = _gohlke.arcball_constrain_to_axis
arcball_map_to_sphere = _gohlke.arcball_map_to_sphere
clip_matrix = _gohlke.clip_matrix
concatenate_matrices = _gohlke.concatenate_matrices
inverse_matrix = _gohlke.inverse_matrix
is_same_transform = _gohlke.is_same_transform
orthogonalization_matrix = _gohlke.orthogonalization_matrix
quaternion_slerp = _gohlke.quaternion_slerp
random_rotation_matrix = _gohlke.random_rotation_matrix
random_vector = _gohlke.random_vector
unit_vector = _gohlke.unit_vector
vector_norm = _gohlke.vector_norm


def _array(values: Any) -> Any:
    return None if values is None else np.asarray(values, np.float64)


def _homogeneous(rotation: Any) -> Any:
    return affines.compose(TRANSLATION_IDENTITY, rotation, ZOOM_IDENTITY)


def _wxyz(quaternion: Any) -> _Quaternion:
    x, y, z, w = quaternion
    return w, x, y, z


def _xyzw(quaternion: Any) -> _Quaternion:
    w, x, y, z = quaternion
    return x, y, z, w


def identity_matrix() -> Any:
    """Return the 4 x 4 matrix that changes nothing."""
    return np.identity(4)


def translation_matrix(direction: Any) -> Any:
    """Return the 4 x 4 matrix that moves points by a vector."""
    return affines.compose(direction, ROTATION_IDENTITY, ZOOM_IDENTITY)


def translation_from_matrix(matrix: Any) -> Any:
    """Return the vector by which a 4 x 4 matrix moves points."""
    return _array(matrix)[:-1, -1]


def reflection_matrix(point: Any, normal: Any) -> Any:
    """Return the 4 x 4 matrix that mirrors at a plane, given by a point and its normal."""
    return reflections.rfnorm2aff(normal, point[:3])


def reflection_from_matrix(matrix: Any) -> tuple[Any, Any]:
    """Return point and normal of the plane at which a matrix mirrors; raise ValueError if it does not mirror."""
    normal, point = reflections.aff2rfnorm(matrix)
    return point, normal


def rotation_matrix(angle: float, direction: Any, point: Any = None) -> Any:
    """Return the 4 x 4 matrix that rotates by an angle about an axis, which passes through a point."""
    return axangles.axangle2aff(direction, angle, point=point)


def rotation_from_matrix(matrix: Any) -> tuple[float, Any, Any]:
    """Return angle, axis and a point of the axis (4 numbers) of a rotation matrix.

    Raise ValueError if it is not a rotation.
    """
    direction, angle, point = axangles.aff2axangle(matrix)
    return angle, direction, point


def scale_matrix(factor: float, origin: Any = None, direction: Any = None) -> Any:
    """Return the 4 x 4 matrix that scales from an origin, along one direction or along all directions."""
    return zooms.zfdir2aff(factor, direction=direction, origin=origin)


def scale_from_matrix(matrix: Any) -> tuple[float, Any, Any]:
    """Return factor, origin and direction of a scaling matrix; the direction is None for all directions."""
    factor, direction, origin = zooms.aff2zfdir(matrix)
    return factor, origin, direction


def shear_matrix(angle: float, direction: Any, point: Any, normal: Any) -> Any:
    """Return the 4 x 4 matrix that shears by an angle along a direction, in a plane given by a point and its normal."""
    return shears.sadn2aff(angle, direction, normal, point)


def shear_from_matrix(matrix: Any) -> tuple[float, Any, Any, Any]:
    """Return angle, direction, point and normal of a shearing matrix."""
    angle, direction, normal, point = shears.aff2sadn(matrix)
    return angle, direction, point, normal


def projection_matrix(
    point: Any, normal: Any, direction: Any = None, perspective: Any = None, pseudo: bool = False
) -> Any:
    """Return the 4 x 4 matrix that projects on a plane: at right angles, along `direction`, or to `perspective`.

    With `pseudo`, a perspective projection retains relative depths.
    """
    return _gohlke.projection_matrix(_array(point), _array(normal), _array(direction), _array(perspective), pseudo)


def projection_from_matrix(matrix: Any, pseudo: bool = False) -> tuple[Any, Any, Any, Any, bool]:
    """Return the arguments of `projection_matrix`; raise ValueError for a matrix that does not project."""
    point, normal, direction, perspective, pseudo = _gohlke.projection_from_matrix(_array(matrix), pseudo)
    return point, normal, direction, perspective, pseudo


def decompose_matrix(matrix: Any) -> tuple[Any, Any, tuple[float, float, float], Any, None]:
    """Return scales, shears, angles, translation, and None (perspective) of a matrix; raise LinAlgError if singular."""
    translation, rotation, scales, shear = affines.decompose(matrix)
    return scales, shear, euler_from_matrix(rotation), translation, None


def compose_matrix(
    scale: Any = None, shear: Any = None, angles: Any = None, translate: Any = None, perspective: Any = None
) -> Any:
    """Return the 4 x 4 matrix that shears, scales, rotates about x, y and z, and moves; `perspective` is ignored."""
    return affines.compose(
        TRANSLATION_IDENTITY if translate is None else translate,
        ROTATION_IDENTITY if angles is None else euler.euler2mat(*angles),
        ZOOM_IDENTITY if scale is None else scale,
        SHEAR_IDENTITY if shear is None else shear,
    )


def superimposition_matrix(v0: Any, v1: Any, scaling: bool = False, usesvd: bool = True) -> Any:
    """Return the 4 x 4 matrix that rotates and moves points onto other points as nearly as possible.

    With `scaling` it also scales. Points are arrays of shape (3, n) or (4, n) with n at least 3; other shapes raise
    ValueError.
    """
    return _gohlke.superimposition_matrix(_array(v0), _array(v1), scaling, usesvd)


def euler_matrix(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> Any:
    """Return the 4 x 4 rotation by three angles; `axes` is one of 24 sequences of axes, as a string or tuple."""
    return _homogeneous(euler.euler2mat(ai, aj, ak, axes=axes))


def euler_from_matrix(matrix: Any, axes: Any = "sxyz") -> tuple[float, float, float]:
    """Return the three angles of a rotation matrix, 3 x 3 or 4 x 4."""
    first, second, third = euler.mat2euler(_array(matrix), axes=axes)
    return first, second, third


def euler_from_quaternion(quaternion: Any, axes: Any = "sxyz") -> tuple[float, float, float]:
    """Return the three angles of the rotation of a quaternion."""
    return euler_from_matrix(quaternion_matrix(quaternion), axes)


def quaternion_from_euler(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> _Quaternion:
    """Return the quaternion of the rotation by three angles."""
    return _xyzw(euler.euler2quat(ai, aj, ak, axes=axes))


def quaternion_about_axis(angle: float, axis: Any) -> _Quaternion:
    """Return the quaternion of the rotation by an angle about an axis of any length."""
    return _xyzw(quaternions.axangle2quat(axis, angle))


def quaternion_matrix(quaternion: Any) -> Any:
    """Return the 4 x 4 rotation matrix of a quaternion of any length."""
    return _homogeneous(quaternions.quat2mat(_wxyz(quaternion)))


def quaternion_from_matrix(matrix: Any) -> _Quaternion:
    """Return the quaternion of the rotation in a 4 x 4 matrix; w is not negative."""
    return _xyzw(quaternions.mat2quat(affines.decompose(matrix)[1]))


def quaternion_multiply(quaternion1: Any, quaternion0: Any) -> _Quaternion:
    """Return the product of two quaternions: the rotation `quaternion0`, followed by `quaternion1`."""
    return _xyzw(quaternions.qmult(_wxyz(quaternion1), _wxyz(quaternion0)))


def quaternion_conjugate(quaternion: Any) -> Any:
    """Return the conjugate of a quaternion, which is the inverse rotation if its length is 1."""
    return _array(quaternion) * (-1.0, -1.0, -1.0, 1.0)


def quaternion_inverse(quaternion: Any) -> Any:
    """Return the inverse of a quaternion of any length."""
    return quaternion_conjugate(quaternion) / np.dot(quaternion, quaternion)


def random_quaternion(rand: Any = None) -> Any:
    """Return a random rotation, uniformly distributed; `rand` are three numbers from 0 to 1."""
    return np.roll(_gohlke.random_quaternion(rand), -1)


class Arcball(_gohlke.Arcball):  # type: ignore[misc]
    """Virtual trackball, with which a pointer rotates objects.

    The `initial` orientation is a quaternion or a 4 x 4 matrix.
    """

    def __init__(self, initial: Any = None) -> None:
        if np.shape(initial) == (4,):
            initial = _wxyz(initial)
        super().__init__(initial)

    def setconstrain(self, constrain: bool) -> None:
        """Allow rotations about one of the trackball's axes only, or all rotations."""
        self.constrain = constrain is True

    def getconstrain(self) -> bool:
        """Return True if only rotations about one of the trackball's axes are allowed."""
        return bool(self.constrain)


def arcball_nearest_axis(point: Any, axes: Any) -> Any:
    """Return the axis whose arc on the trackball is nearest to a point."""
    return _gohlke.arcball_nearest_axis(_array(point), axes)
