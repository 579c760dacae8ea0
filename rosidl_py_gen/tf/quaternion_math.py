"""Rotations and translations of one transform, with plain floats: for so few numbers numpy is the slower way.

Quaternions are (x, y, z, w) of length 1, as everywhere in ROS.
"""

from __future__ import annotations

from math import acos, sin, sqrt

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)
ORIGIN: Vector = (0.0, 0.0, 0.0)


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """First `b`, then `a`."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by + ay * bw + az * bx - ax * bz,
        aw * bz + az * bw + ax * by - ay * bx,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """The rotation back."""
    return (-q[0], -q[1], -q[2], q[3])


def rotate(q: Quaternion, v: Vector) -> Vector:
    """The vector after the rotation."""
    x, y, z, w = q
    a, b, c = v
    # twice the cross product of the axis with v, then v + w t + axis x t
    tx, ty, tz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return (a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx)


def add(a: Vector, b: Vector) -> Vector:
    """The sum."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def negate(v: Vector) -> Vector:
    """The opposite."""
    return (-v[0], -v[1], -v[2])


def lerp(a: Vector, b: Vector, ratio: float) -> Vector:
    """On the line from `a` (0) to `b` (1)."""
    rest = 1 - ratio
    return (a[0] * rest + b[0] * ratio, a[1] * rest + b[1] * ratio, a[2] * rest + b[2] * ratio)


def slerp(a: Quaternion, b: Quaternion, ratio: float) -> Quaternion:
    """On the shorter arc from `a` (0) to `b` (1), with constant speed."""
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign = -1.0 if cosine < 0 else 1.0
    angle = acos(min(1.0, abs(cosine)))
    if angle < 1e-9:
        return a
    one, two = sin((1 - ratio) * angle) / sin(angle), sign * sin(ratio * angle) / sin(angle)
    return normalized(
        (a[0] * one + b[0] * two, a[1] * one + b[1] * two, a[2] * one + b[2] * two, a[3] * one + b[3] * two)
    )


def normalized(q: Quaternion) -> Quaternion:
    """The quaternion made as long as 1."""
    length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)
