"""Conversion of ``sensor_msgs/msg/LaserScan`` to points."""

from __future__ import annotations

from typing import Any

import numpy as np

from rosidl_py_gen.numpy.common import ConversionError, as_float64, reads_message


@reads_message("a sensor_msgs/msg/LaserScan")
def laserscan_to_points(scan: Any, *, skip_invalid: bool = True) -> np.ndarray[Any, np.dtype[np.void]]:
    """Return the points that a ``sensor_msgs/msg/LaserScan`` measured, in its own frame: z is 0.

    The scanner is assumed not to move while it turns.

    Args:
        skip_invalid: exclude ranges below `range_min`, above `range_max`, or NaN; otherwise these are points of NaN,
            and the point of ``ranges[i]`` is ``points[i]``.

    Returns:
        Structured array, as of `pointcloud_to_array` and for `array_to_pointcloud`: x, y and z of float32, and
        intensity if the scan has intensities. `points_to_xyz` returns its plain columns.

    Raises:
        ConversionError: a field is not a number, or the numbers of intensities and ranges differ.
    """
    ranges, intensities = _numbers(scan, "ranges"), _numbers(scan, "intensities")
    if intensities.size not in (0, ranges.size):
        raise ConversionError(f"intensities: {intensities.size}, but there are {ranges.size} ranges")
    first, step, low, high = (
        _number(scan, name) for name in ("angle_min", "angle_increment", "range_min", "range_max")
    )
    for name, value in (("angle_min", first), ("angle_increment", step)):
        if not np.isfinite(value):
            raise ConversionError(f"{name}: expected a number of radians, got {value}")
    with np.errstate(invalid="ignore"):
        is_seen = (ranges >= low) & (ranges <= high) & np.isfinite(ranges)
    angles = first + step * np.arange(ranges.size, dtype=np.float64)
    names = ["x", "y", "z", *(["intensity"] if intensities.size else [])]
    points = np.zeros(ranges.size, [(name, np.float32) for name in names])
    distance = np.where(is_seen, ranges, np.nan)
    points["x"], points["y"] = distance * np.cos(angles), distance * np.sin(angles)
    points["z"][~is_seen] = np.nan
    if intensities.size:
        points["intensity"] = intensities
    return points[is_seen] if skip_invalid else points


def _numbers(scan: Any, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    values = as_float64(getattr(scan, name), "numbers", f"{name}: ")
    if values.ndim != 1:
        raise ConversionError(f"{name}: expected a row of numbers, got shape {values.shape}")
    return values


def _number(scan: Any, name: str) -> float:
    value = getattr(scan, name)
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ConversionError(f"{name}: expected a number, got {value!r:.50}") from None
