"""``sensor_msgs/msg/LaserScan`` as points."""

from __future__ import annotations

from typing import Any

import numpy as np

from rosidl_py_gen.numpy.common import ConversionError, reads_message


@reads_message("a sensor_msgs/msg/LaserScan")
def laserscan_to_points(scan: Any, *, skip_invalid: bool = True) -> np.ndarray[Any, np.dtype[np.void]]:
    """The points that a ``sensor_msgs/msg/LaserScan`` saw, in its own frame: z is 0.

    The scanner is taken not to move while it turns.

    Args:
        skip_invalid: leave out what is below `range_min`, above `range_max`, or NaN; otherwise these are points of NaN,
            and the point of ``ranges[i]`` is ``points[i]``.

    Returns:
        Structured, as `pointcloud_to_array` gives points and `array_to_pointcloud` takes them: x, y and z of float32,
        and intensity, if the scan has some. `points_to_xyz` makes plain columns of it.

    Raises:
        ConversionError: a field is no number, or there are more or less intensities than ranges.
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


def points_to_xyz(points: Any, *, skip_nans: bool = False) -> np.ndarray[Any, np.dtype[np.floating[Any]]]:
    """Plain columns of structured points, of `pointcloud_to_array` for example: shape ``(..., 3)``, x, y and z.

    Args:
        skip_nans: leave out points of which one of the three is NaN; the result has shape ``(n, 3)`` then.

    Raises:
        ConversionError: there is no x, y or z, or it is no number.
    """
    given = np.asarray(points)
    names = given.dtype.names or ()
    for name in ("x", "y", "z"):
        if name not in names or given.dtype[name].kind not in "iuf" or given.dtype[name].shape:
            raise ConversionError(f"points: expected numbers x, y and z, got {given.dtype!s:.200}")
    kinds = {given.dtype[name].newbyteorder("=") for name in ("x", "y", "z")}
    columns = np.stack([given[name] for name in ("x", "y", "z")], -1).astype(
        np.result_type(np.float32, *kinds), copy=False
    )
    if not skip_nans:
        return columns
    rows = columns.reshape(-1, 3)
    kept: np.ndarray[Any, np.dtype[np.floating[Any]]] = rows[~np.isnan(rows).any(-1)]
    return kept


def _numbers(scan: Any, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    try:
        found = np.asarray(getattr(scan, name), np.float64)
    except (TypeError, ValueError) as error:
        raise ConversionError(f"{name}: expected numbers: {error!s:.200}") from None
    if found.ndim != 1:
        raise ConversionError(f"{name}: expected a row of numbers, got shape {found.shape}")
    return found


def _number(scan: Any, name: str) -> float:
    value = getattr(scan, name)
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ConversionError(f"{name}: expected a number, got {value!r:.50}") from None
