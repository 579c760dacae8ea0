"""Turning by a pointer on a ball."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tf_transformations.rotations import (
    quaternion_from_matrix,
    quaternion_matrix,
    quaternion_multiply,
    quaternion_slerp,
)
from tf_transformations.vectors import _EPS, Array, unit_vector, vector_norm


class Arcball:
    """A ball that `down` takes hold of and `drag` turns; `initial` is a quaternion or a 4 x 4 matrix."""

    def __init__(self, initial: Any = None) -> None:
        start: Any = np.array((0.0, 0.0, 0.0, 1.0) if initial is None else initial, np.float64)
        if start.shape == (4, 4):
            start = quaternion_from_matrix(start)
        elif start.shape != (4,):
            raise ValueError("initial not a quaternion or matrix.")
        self._radius = 1.0
        self._center = [0.0, 0.0]
        self._axes: list[Array] | None = None
        self._axis: Any = None
        self._constrain = False
        self._vdown: Any = np.array((0.0, 0.0, 1.0))
        self._qdown: Any = unit_vector(start)
        self._qnow = self._qpre = self._qdown

    def place(self, center: Any, radius: float) -> None:
        """Where it is in the window, and how large."""
        self._radius = float(radius)
        self._center = [center[0], center[1]]

    def setaxes(self, *axes: Any) -> None:
        """The axes about which it turns when it is constrained."""
        self._axes = [unit_vector(axis) for axis in axes]

    def setconstrain(self, constrain: bool) -> None:
        """Whether it turns about one of the axes only."""
        self._constrain = constrain is True

    def getconstrain(self) -> bool:
        """Whether it turns about one of the axes only."""
        return self._constrain

    def down(self, point: Any) -> None:
        """Take hold of it there, and choose the axis."""
        self._vdown = arcball_map_to_sphere(point, self._center, self._radius)
        self._qdown = self._qpre = self._qnow
        self._axis = None
        if self._constrain and self._axes is not None:
            self._axis = arcball_nearest_axis(self._vdown, self._axes)
            self._vdown = arcball_constrain_to_axis(self._vdown, self._axis)

    def drag(self, point: Any) -> None:
        """Turn it so that what was taken hold of is there."""
        now = arcball_map_to_sphere(point, self._center, self._radius)
        if self._axis is not None:
            now = arcball_constrain_to_axis(now, self._axis)
        self._qpre = self._qnow
        turn = np.cross(self._vdown, now)
        if np.dot(turn, turn) < _EPS:
            self._qnow = self._qdown
        else:
            self._qnow = quaternion_multiply((*turn, np.dot(self._vdown, now)), self._qdown)

    def next(self, acceleration: float = 0.0) -> None:
        """Turn on in the direction of the last drag."""
        following = quaternion_slerp(self._qpre, self._qnow, 2.0 + acceleration, 0)
        self._qpre, self._qnow = self._qnow, following

    def matrix(self) -> Array:
        """How it has turned, 4 x 4."""
        return quaternion_matrix(self._qnow)


def arcball_map_to_sphere(point: Any, center: Any, radius: float) -> Array:
    """The place on a ball of radius 1 of one in the window."""
    x, y = (point[0] - center[0]) / radius, (center[1] - point[1]) / radius
    square = x * x + y * y
    if square > 1.0:
        return np.array((x, y, 0.0)) / math.sqrt(square)
    return np.array((x, y, math.sqrt(1.0 - square)))


def arcball_constrain_to_axis(point: Any, axis: Any) -> Array:
    """The place on the ball's upper half at right angles to an axis."""
    place, about = np.array(point, np.float64), np.array(axis, np.float64)
    place -= about * np.dot(about, place)
    length = vector_norm(place)
    if length > _EPS:
        flat: Array = place / (-length if place[2] < 0.0 else length)
        return flat
    if about[2] == 1.0:
        return np.array((1.0, 0.0, 0.0))
    beside: Array = unit_vector((-about[1], about[0], 0.0))
    return beside


def arcball_nearest_axis(point: Any, axes: Any) -> Any:
    """The axis whose arc is nearest to a place."""
    return max(axes, key=lambda axis: np.dot(arcball_constrain_to_axis(point, axis), point), default=None)
