"""Arithmetic of single rotations and translations with plain floats, which is faster than numpy for so few numbers.

Quaternions are (x, y, z, w) of length 1, as everywhere in ROS.
"""

from __future__ import annotations

from math import acos, sin, sqrt

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)
ORIGIN: Vector = (0.0, 0.0, 0.0)


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation that applies first `b`, then `a`; both are quaternions."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by + ay * bw + az * bx - ax * bz,
        aw * bz + az * bw + ax * by - ay * bx,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """Return the inverse of a rotation, which is the conjugate of its quaternion."""
    return (-q[0], -q[1], -q[2], q[3])


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Return the vector `v` rotated by the quaternion `q`."""
    x, y, z, w = q
    a, b, c = v
    # twice the cross product of the axis with v, then v + w t + axis x t
    tx, ty, tz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return (a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx)


def add(a: Vector, b: Vector) -> Vector:
    """Return the sum of two vectors."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vector, b: Vector) -> Vector:
    """Return the difference of two vectors."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def lerp(a: Vector, b: Vector, ratio: float) -> Vector:
    """Return the point on the line from `a` (ratio 0) to `b` (ratio 1)."""
    rest = 1 - ratio
    return (a[0] * rest + b[0] * ratio, a[1] * rest + b[1] * ratio, a[2] * rest + b[2] * ratio)


def slerp(a: Quaternion, b: Quaternion, ratio: float) -> Quaternion:
    """Return the rotation on the shorter arc from `a` (ratio 0) to `b` (ratio 1), at constant angular speed."""
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    sign = -1.0 if cosine < 0 else 1.0
    angle = acos(min(1.0, abs(cosine)))
    if angle < 1e-9:
        return a
    one, two = sin((1 - ratio) * angle) / sin(angle), sign * sin(ratio * angle) / sin(angle)
    x, y, z, w = (start * one + end * two for start, end in zip(a, b, strict=True))
    return normalized((x, y, z, w))


def normalized(q: Quaternion) -> Quaternion:
    """Return the quaternion scaled to length 1."""
    length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)
