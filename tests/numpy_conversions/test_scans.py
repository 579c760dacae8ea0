"""Laser scans as points, and points as plain columns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rosidl_py_gen import decode, encode, get_message
from rosidl_py_gen.numpy import (
    ConversionError,
    array_to_pointcloud,
    laserscan_to_points,
    pointcloud_to_array,
    points_to_xyz,
)

LaserScan: Any = get_message("sensor_msgs/msg/LaserScan")


def scan(ranges: Any, **values: Any) -> Any:
    limits = {"angle_min": -math.pi / 2, "angle_increment": math.pi / 4, "range_min": 0.5, "range_max": 10.0}
    return LaserScan(**{**limits, "ranges": np.array(ranges, np.float32), **values})


def test_a_scan_turns_to_the_left() -> None:
    points = laserscan_to_points(scan([1, 2, 3, 4, 5]))
    half = math.sqrt(0.5)
    wanted = [[0, -1, 0], [2 * half, -2 * half, 0], [3, 0, 0], [4 * half, 4 * half, 0], [0, 5, 0]]
    assert points.dtype.names == ("x", "y", "z") and np.allclose(points_to_xyz(points), wanted, atol=1e-6)


def test_what_was_not_seen_is_left_out_or_nan() -> None:
    made = scan([0.4, math.nan, math.inf, 10.5, 2, -math.inf, 10, 0.5], intensities=np.arange(8, dtype=np.float32))
    points = laserscan_to_points(made)
    assert points["intensity"].tolist() == [4, 6, 7] and not np.isnan(points_to_xyz(points)).any()
    every = laserscan_to_points(made, skip_invalid=False)
    assert np.isnan(every["x"]).tolist() == [True, True, True, True, False, True, False, False]
    assert np.isnan(every["z"]).sum() == 5 and every["intensity"].tolist() == list(range(8))
    assert len(points_to_xyz(every, skip_nans=True)) == 3


def test_endless_ranges_are_no_points_where_the_range_is_endless() -> None:
    assert len(laserscan_to_points(scan([math.inf, 1], range_max=math.inf))) == 1


@given(
    st.lists(st.floats(0, 100, width=32), max_size=30),
    st.floats(-7, 7, width=32),
    st.floats(-0.5, 0.5, width=32),
)
def test_every_point_is_where_its_beam_points(ranges: list[float], first: float, step: float) -> None:
    made = scan(ranges, angle_min=first, angle_increment=step, range_min=0.0, range_max=200.0)
    points = laserscan_to_points(decode(LaserScan, encode(made)))
    assert len(points) == len(ranges)
    for index, (distance, point) in enumerate(zip(ranges, points, strict=True)):
        angle = np.float32(first).item() + index * np.float32(step).item()
        assert point["x"] == pytest.approx(distance * math.cos(angle), abs=1e-4)
        assert point["y"] == pytest.approx(distance * math.sin(angle), abs=1e-4)


def test_points_of_a_scan_are_a_cloud() -> None:
    made = scan([1, 2], intensities=np.array([7, 8], np.float32))
    cloud: Any = array_to_pointcloud(laserscan_to_points(made), header=made.header)
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "intensity"]
    assert pointcloud_to_array(cloud)["intensity"].tolist() == [7, 8]


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"intensities": np.ones(3, np.float32)}, "intensities: 3, but there are 2 ranges"),
        ({"angle_min": math.nan}, "angle_min: expected a number of radians, got nan"),
        ({"angle_increment": math.inf}, "angle_increment: expected a number of radians"),
    ],
)
def test_scans_that_make_no_sense_are_refused(values: dict[str, Any], text: str) -> None:
    with pytest.raises(ConversionError, match=text):
        laserscan_to_points(scan([1, 2], **values))


def test_fields_that_are_no_numbers_are_told() -> None:
    made = scan([1, 2])
    for name, value, text in (
        ("ranges", ["x"], "ranges: expected numbers"),
        ("ranges", [[1]], "ranges: expected a row of numbers, got shape"),
        ("range_max", "far", "range_max: expected a number, got 'far'"),
    ):
        wrong = decode(LaserScan, encode(made))
        setattr(wrong, name, value)
        with pytest.raises(ConversionError, match=text):
            laserscan_to_points(wrong)


def test_columns_have_the_type_that_holds_all_three() -> None:
    points = np.zeros((2, 3), [("x", ">f4"), ("ring", "u1"), ("y", "f8"), ("z", "i2")])
    points["x"], points["y"], points["z"] = 1, 2, 3
    assert points_to_xyz(points).shape == (2, 3, 3) and points_to_xyz(points).dtype == np.float64
    assert points_to_xyz(np.zeros(4, [(name, "u1") for name in "xyz"])).dtype == np.float32
    points["y"][0, 0] = math.nan
    assert points_to_xyz(points, skip_nans=True).shape == (5, 3)
    for wrong in (
        np.zeros(3),
        np.zeros(3, [("x", "f4"), ("y", "f4")]),
        np.zeros(3, [("x", "f4", 2), ("y", "f4"), ("z", "f4")]),
    ):
        with pytest.raises(ConversionError, match="points: expected numbers x, y and z, got"):
            points_to_xyz(wrong)
