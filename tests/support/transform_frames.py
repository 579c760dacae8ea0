"""Frames that tests of transforms share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.tf import Transform, TransformBuffer

S = 10**9
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
QUARTER = np.array([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])


def moved(parent: str, child: str, stamp_s: float = 1, x: float = 0, rotation: Any = LEVEL) -> Transform:
    return Transform(parent, child, round(stamp_s * S), np.array([x, 0.0, 0.0]), rotation)


def filled() -> TransformBuffer:
    """Return a buffer with map <- odom <- base_link <- lidar (static, turned left), and another tree."""
    buffer = TransformBuffer()
    for second in (1, 2, 3):
        buffer.set_transform(moved("map", "odom", second, 10))
        buffer.set_transform(moved("odom", "base_link", second, second))
    buffer.set_transform(moved("base_link", "lidar", 0, 0.5, QUARTER), static=True)
    buffer.set_transform(moved("tool", "camera", 1))
    return buffer


def message(name: str, frame: str = "lidar", stamp_s: float = 3, **values: Any) -> Any:
    """Return a message with a header."""
    made: Any = get_message(f"{'sensor' if name == 'PointCloud2' else 'geometry'}_msgs/msg/{name}")(**values)
    made.header.frame_id = frame
    set_stamp(made.header.stamp, round(stamp_s * S))
    return made
