"""Point clouds, laser scans and maps as arrays."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan, PointCloud2, PointField

from rosidl_py_gen import decode, encode
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.numpy import (
    ConversionError,
    array_to_occupancygrid,
    array_to_pointcloud,
    laserscan_to_points,
    occupancygrid_to_array,
    pointcloud_dtype,
    pointcloud_to_array,
    points_to_xyz,
)

HUGE = 2**32 - 1
OFFSETS = {"x": 0, "y": 4, "z": 8, "i": 16}
XYZI = [PointField(name=name, offset=offset, datatype=7, count=1) for name, offset in OFFSETS.items()]


def cloud(**changes: Any) -> Any:
    points = np.arange(6 * 5, dtype="<f4").view(np.uint8)  # 20 bytes a point, 4 of them between z and i
    values = {"height": 1, "width": 6, "fields": XYZI, "point_step": 20, "row_step": 120, "data": points, **changes}
    return PointCloud2(**values)


def test_cloud_columns_are_views_at_the_offsets_of_the_fields() -> None:
    message = cloud()
    points = pointcloud_to_array(message)
    assert points.shape == (6,)
    assert points["x"].tolist() == [0, 5, 10, 15, 20, 25]
    assert points["i"].tolist() == [4, 9, 14, 19, 24, 29]
    assert np.shares_memory(points, message.data)
    assert pointcloud_to_array(message, ["z", "x"]).dtype.names == ("z", "x")
    owned = pointcloud_to_array(message, copy=True)
    assert owned.dtype == np.dtype([(name, "f4") for name in "xyzi"]) and owned["z"].tolist() == [2, 7, 12, 17, 22, 27]


def test_an_organised_cloud_has_rows_and_columns() -> None:
    data = np.arange(2 * 33, dtype="<f4").view(np.uint8)  # rows of 132 bytes: 6 points of 20, and 12 bytes behind them
    points = pointcloud_to_array(cloud(height=2, row_step=132, data=data))
    assert points.shape == (2, 6)
    assert points["x"].tolist() == [[0, 5, 10, 15, 20, 25], [33, 38, 43, 48, 53, 58]]
    again = array_to_pointcloud(points)
    assert (again.height, again.width, again.row_step) == (2, 6, 120)
    assert (pointcloud_to_array(again) == points).all()


KINDS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8, "i8": 9, "u8": 10}


@given(
    st.lists(st.tuples(st.sampled_from(list(KINDS)), st.sampled_from("<>"), st.integers(1, 3)), min_size=1, max_size=5),
    st.booleans(),
    st.sampled_from([(0,), (1,), (5,), (2, 3)]),
)
def test_structured_arrays_round_trip_through_clouds(
    kinds: list[tuple[str, str, int]], aligned: bool, shape: tuple[int, ...]
) -> None:
    dtype = np.dtype(
        [(f"f{i}", order + kind, (n,) if n > 1 else ()) for i, (kind, order, n) in enumerate(kinds)], align=aligned
    )
    array = np.zeros(shape, dtype)
    raw = np.random.default_rng(3).integers(0, 256, array.nbytes, np.uint8)
    array = np.ndarray(shape, dtype, raw)
    message = array_to_pointcloud(array)
    assert [field.datatype for field in message.fields] == [KINDS[kind] for kind, _, _ in kinds]
    again = pointcloud_to_array(PointCloud2.decode(message.encode()))
    assert again.shape == shape
    for name in dtype.names or ():
        assert little(again[name]) == little(array[name])


def little(column: np.ndarray[Any, Any]) -> bytes:
    return column.astype(column.dtype.newbyteorder("<")).tobytes()


def test_padding_between_fields_in_memory_is_not_sent() -> None:
    memory = np.full(5 * 16, 0xEE, np.uint8)
    dtype = np.dtype({"names": ["x", "y"], "formats": ["<f4", "<f4"], "offsets": [0, 8], "itemsize": 16})
    points = np.ndarray(5, dtype, memory)
    points["x"], points["y"] = 0, 0
    assert not array_to_pointcloud(points).data.any()


def test_plain_arrays_become_clouds_with_x_y_z() -> None:
    numbers = np.arange(12, dtype=np.float32).reshape(4, 3)
    message = array_to_pointcloud(numbers)
    assert [field.name for field in message.fields] == ["x", "y", "z"] and message.is_dense
    assert np.shares_memory(message.data, numbers)
    assert pointcloud_to_array(message)["z"].tolist() == [2, 5, 8, 11]
    assert not array_to_pointcloud(np.full((1, 2), np.nan), names=("a", "b")).is_dense
    with pytest.raises(ConversionError, match=r"expected 3 columns \(x, y, z\), got shape \(4, 2\)"):
        array_to_pointcloud(numbers[:, :2])


def test_point_field_types_of_pcl_and_lyrical_round_trip() -> None:
    made = np.array([(1.5, 2**63 + 1, -5, True), (2.5, 7, 2**62, False)], "f4,u8,i8,?")
    message = array_to_pointcloud(made)
    assert [field.datatype for field in message.fields] == [7, 10, 9, 11]
    points = pointcloud_to_array(PointCloud2.decode(message.encode()))
    assert points.tolist() == made.tolist() and points["f3"].dtype == np.bool_
    message.data[20] = 2
    with pytest.raises(ConversionError, match='"f3": 2 is not a bool; expected 0 or 1'):
        pointcloud_to_array(message)


def test_plain_64_bit_integers_require_an_explicit_dtype() -> None:
    numbers = np.array([[1, 2, 3]])
    with pytest.raises(ConversionError, match='pass dtype="f4", or dtype="int64" to use it'):
        array_to_pointcloud(numbers)
    assert {field.datatype for field in array_to_pointcloud(numbers, dtype="f4").fields} == {7}
    assert {field.datatype for field in array_to_pointcloud(numbers, dtype="int64").fields} == {9}


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"point_step": 2**31}, "point_step: 2147483648 bytes, but a point of an array has at most 2147483647"),
        ({"fields": [PointField(name="x", datatype=2, count=2**31)]}, 'fields.0.: "x" ends at byte 2147483648, but'),
        ({"width": 2**40}, "width: expected a number from 0 to 4294967295"),
        ({"point_step": 19}, 'fields.3.: "i" ends at byte 20, but point_step is 19'),
        ({"fields": [*XYZI, XYZI[0]]}, 'there are two fields "x"'),
        ({"fields": [PointField(name="x", datatype=12)]}, "fields.0..datatype: 12 is not known"),
        ({"height": 2, "row_step": 119}, "row_step: 119 bytes, but 6 points of 20 need 120"),
        ({"width": 7}, "data: 120 bytes, but 1 x 7 points need 140"),
        ({"height": 2**32 - 1, "row_step": 2**32 - 1}, "data: 120 bytes"),
        (
            {"fields": [], "point_step": 0, "height": 2**32 - 1, "width": 2**32 - 1, "row_step": 2**32 - 1},
            "point_step: 0 bytes",
        ),
    ],
)
def test_inconsistent_clouds_are_refused(changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ConversionError, match=text):
        pointcloud_to_array(cloud(**changes))


def test_missing_field_is_reported() -> None:
    with pytest.raises(ConversionError, match='no field "intensity" in x, y, z, i'):
        pointcloud_to_array(cloud(), ["intensity"])


def test_field_count_zero_means_one_and_unnamed_field_is_named() -> None:
    dtype = pointcloud_dtype(cloud(fields=[PointField(offset=4, datatype=7, count=0)]))
    assert dtype.names == ("unnamed_field_0",)


EDGES = [2**28, 2**31 - 2, 2**31 - 1, 2**31, 2**32 - 1]
FIELDS = st.builds(
    PointField,
    name=st.text(max_size=2),
    offset=st.integers(0, 30) | st.integers(0, 2**32 - 1),
    datatype=st.integers(0, 12),
    count=st.integers(0, 3) | st.integers(0, 2**32 - 1) | st.sampled_from(EDGES),
)
SIZES = st.integers(0, 40) | st.integers(0, 2**32 - 1) | st.sampled_from(EDGES)


@given(
    st.builds(
        PointCloud2,
        height=SIZES,
        width=SIZES,
        fields=st.lists(FIELDS, max_size=3),
        point_step=SIZES,
        row_step=SIZES,
        is_bigendian=st.booleans(),
        data=st.binary(max_size=200),
    )
)
def test_any_cloud_is_read_within_its_data_or_raises_our_error(message: Any) -> None:
    try:
        points = pointcloud_to_array(message)
    except RosidlError:
        return
    assert pointcloud_to_array(message, skip_nans=True).size <= points.size
    assert points.size * points.dtype.itemsize <= 200 * 200  # rows may overlap only in what is there
    points.tobytes()


def test_points_with_nan_are_skipped_on_request() -> None:
    made = np.zeros((2, 3), [("x", "f4"), ("n", "f8", (2,)), ("i", "u1")])
    made["i"] = np.arange(6).reshape(2, 3)
    made["x"][0, 1] = made["n"][1, 2, 1] = np.nan
    made["x"][1, 0] = np.inf
    message = array_to_pointcloud(made, cls=PointCloud2, is_dense=True)  # which is not true
    assert pointcloud_to_array(message, skip_nans=True)["i"].tolist() == [0, 2, 3, 4]
    assert pointcloud_to_array(message, ["x", "i"], skip_nans=True, copy=True)["i"].tolist() == [0, 2, 3, 4, 5]
    assert pointcloud_to_array(message).shape == (2, 3)


def test_plain_arrays_are_converted_to_the_given_dtype() -> None:
    numbers = np.random.default_rng(1).random((4, 3))
    assert {field.datatype for field in array_to_pointcloud(numbers).fields} == {8}
    message = array_to_pointcloud(numbers, dtype="f4", cls=PointCloud2)
    assert {field.datatype for field in message.fields} == {7} and message.point_step == 12
    assert np.allclose(pointcloud_to_array(message)["y"], numbers[:, 1])
    with pytest.raises(ConversionError, match=r"1e\+300.* is out of the range of float32"):
        array_to_pointcloud([[0.0, 1e300, 0.0]], dtype="f4")
    with pytest.raises(ConversionError, match=r"0\.5.* has a fraction; expected an integer for uint8"):
        array_to_pointcloud([[0.0, 0.5, 0.0]], dtype="u1")
    with pytest.raises(ConversionError, match=r'array\["t"\]: float16 is not a type of point fields'):
        array_to_pointcloud(np.zeros(2, [("x", "f4"), ("t", "f2")]))
    with pytest.raises(ConversionError, match="cannot be passed for a structured array"):
        array_to_pointcloud(np.zeros(1, [("x", "f8")]), dtype="f4")


def test_map_cells_of_another_dtype_are_never_misread() -> None:
    grid = array_to_occupancygrid(np.array([[-1, 0, 100]]), 0.05, cls=OccupancyGrid)
    grid.data = [-1, 0, 100]
    assert occupancygrid_to_array(grid).tolist() == [[-1, 0, 100]]
    for wrong in (np.array([0, 200, 1]), np.array([0, 0.5, 1]), [0, 1, 1000]):
        grid.data = wrong
        with pytest.raises(ConversionError, match="data: expected int8, got"):
            occupancygrid_to_array(grid)


def test_occupancy_grids_are_read_as_rows_of_cells() -> None:
    cells = np.array([[-1, 0, 100], [50, 1, 2]], np.int8)
    grid = array_to_occupancygrid(cells, 0.05, cls=OccupancyGrid)
    assert (grid.info.height, grid.info.width) == (2, 3) and grid.info.resolution == pytest.approx(0.05)
    again = occupancygrid_to_array(OccupancyGrid.decode(grid.encode()))
    assert again.dtype == np.int8 and (again == cells).all()
    assert np.shares_memory(occupancygrid_to_array(grid), grid.data)
    grid.info.width = 4
    with pytest.raises(ConversionError, match="6 cells, but 2 x 4 need 8"):
        occupancygrid_to_array(grid)
    with pytest.raises(ConversionError, match="cells are from -1 to 100, got 0 to 101"):
        array_to_occupancygrid(np.array([[0, 101]]), 1.0)


def scan(ranges: Any, **values: Any) -> Any:
    limits = {"angle_min": -math.pi / 2, "angle_increment": math.pi / 4, "range_min": 0.5, "range_max": 10.0}
    return LaserScan(**{**limits, "ranges": np.array(ranges, np.float32), **values})


def test_invalid_ranges_of_a_scan_are_skipped_or_nan() -> None:
    made = scan([0.4, math.nan, math.inf, 10.5, 2, -math.inf, 10, 0.5], intensities=np.arange(8, dtype=np.float32))
    points = laserscan_to_points(made)
    assert points["intensity"].tolist() == [4, 6, 7] and not np.isnan(points_to_xyz(points)).any()
    every = laserscan_to_points(made, skip_invalid=False)
    assert np.isnan(every["x"]).tolist() == [True, True, True, True, False, True, False, False]
    assert np.isnan(every["z"]).sum() == 5 and every["intensity"].tolist() == list(range(8))
    assert len(points_to_xyz(every, skip_nans=True)) == 3


def test_infinite_ranges_are_not_points_even_with_infinite_range_max() -> None:
    assert len(laserscan_to_points(scan([math.inf, 1], range_max=math.inf))) == 1


@given(
    st.lists(st.floats(0, 100, width=32), max_size=30),
    st.floats(-7, 7, width=32),
    st.floats(-0.5, 0.5, width=32),
)
def test_scan_points_lie_in_the_direction_of_their_beams(ranges: list[float], first: float, step: float) -> None:
    made = scan(ranges, angle_min=first, angle_increment=step, range_min=0.0, range_max=200.0)
    points = laserscan_to_points(decode(LaserScan, encode(made)))
    assert len(points) == len(ranges)
    for index, (distance, point) in enumerate(zip(ranges, points, strict=True)):
        angle = np.float32(first).item() + index * np.float32(step).item()
        assert point["x"] == pytest.approx(distance * math.cos(angle), abs=1e-4)
        assert point["y"] == pytest.approx(distance * math.sin(angle), abs=1e-4)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"intensities": np.ones(3, np.float32)}, "intensities: 3, but there are 2 ranges"),
        ({"angle_min": math.nan}, "angle_min: expected a number of radians, got nan"),
        ({"angle_increment": math.inf}, "angle_increment: expected a number of radians"),
        ({"ranges": ["x"]}, "ranges: expected numbers"),
        ({"ranges": [[1]]}, "ranges: expected a row of numbers, got shape"),
        ({"range_max": "far"}, "range_max: expected a number, got 'far'"),
    ],
)
def test_inconsistent_scans_are_refused(values: dict[str, Any], text: str) -> None:
    wrong = scan([1, 2])
    for name, value in values.items():
        setattr(wrong, name, value)
    with pytest.raises(ConversionError, match=text):
        laserscan_to_points(wrong)


def test_points_to_xyz_uses_a_dtype_that_fits_all_columns() -> None:
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
