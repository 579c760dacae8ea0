"""Arrays and sequences of messages as columns of tables."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point32, Polygon, TransformStamped
from sensor_msgs.msg import Imu, JointState, LaserScan
from std_msgs.msg import String
from support.bag_samples import memory_limit

from rosidl_py_gen import compile_definition, get_message
from rosidl_py_gen.bags import BagError, BagReader, BagWriter

TFMessage: Any = get_message("tf2_msgs/msg/TFMessage")
Trajectory: Any = get_message("trajectory_msgs/msg/JointTrajectory")
Point: Any = get_message("trajectory_msgs/msg/JointTrajectoryPoint")
NAN = math.nan


def transform(frame: str, x: float, sec: int = 0) -> Any:
    made = TransformStamped(child_frame_id=frame)
    made.transform.translation.x, made.header.stamp.sec = x, sec
    return made


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    path = tmp_path / "b.mcap"
    with BagWriter(path) as writer:
        for number in range(3):
            joints = JointState(name=["a", "bcd"], position=np.array([number, number + 0.5]))
            writer.write("/joints", joints, number)
            scan = LaserScan(ranges=np.arange(number + 2, dtype=np.float32), intensities=np.zeros(0, np.float32))
            writer.write("/scan", scan, number)
            imu = Imu(orientation_covariance=np.arange(9) + 10.0 * number)
            writer.write("/imu", imu, number)
            tf = TFMessage(transforms=[transform("base", number, 7), transform("lidar", 10 + number)][: number + 1])
            writer.write("/tf", tf, number)
            points = [Point(positions=np.arange(2) + float(n)) for n in range(2)]
            points[1].time_from_start.sec = number
            writer.write("/path", Trajectory(points=points), number)
    return path


def columns(bag: Path, topic: str, *fields: str, **options: Any) -> Any:
    with BagReader(bag) as reader:
        return reader.to_arrays(topic, list(fields), **options)


def test_element_of_a_sequence_is_a_table_column(bag: Path) -> None:
    table = columns(bag, "/joints", "position[1]", "position[-2]", "name[1]", "header.stamp.sec")
    assert table["position[1]"].tolist() == [0.5, 1.5, 2.5] and table["position[1]"].dtype == np.float64
    assert table["position[-2]"].tolist() == [0, 1, 2]
    assert table["name[1]"].tolist() == ["bcd"] * 3 and table["header.stamp.sec"].tolist() == [0, 0, 0]
    with BagReader(bag) as reader:
        everything = reader.to_arrays("/imu").dtype
    assert {"log_time", "header.stamp", "header.frame_id", "angular_velocity.z"} <= set(everything.names or ())
    assert all(everything[name].shape == () for name in everything.names or ())  # as pandas.DataFrame needs it
    covariance = columns(bag, "/imu", "orientation_covariance[8]", "orientation_covariance", "linear_acceleration")
    assert covariance["orientation_covariance[8]"].tolist() == [8, 18, 28]
    assert covariance["orientation_covariance"].shape == (3, 9)
    assert covariance.dtype.names[3:] == tuple(f"linear_acceleration.{axis}" for axis in "xyz")


def test_slice_of_known_length_adds_an_axis_to_the_column(bag: Path) -> None:
    table = columns(bag, "/scan", "ranges[0:2]", "ranges[1:2]")
    assert table["ranges[0:2]"].tolist() == [[0, 1]] * 3 and table["ranges[0:2]"].dtype == np.float32
    assert table["ranges[1:2]"].shape == (3, 1)
    assert columns(bag, "/imu", "orientation_covariance[-3:]")["orientation_covariance[-3:]"][1].tolist() == [
        16,
        17,
        18,
    ]
    with BagReader(bag) as reader:
        assert reader.to_arrays("/imu", "orientation_covariance[0:3]", end_ns=0)[
            "orientation_covariance[0:3]"
        ].shape == (0, 3)


def test_whole_sequence_is_an_object_column_or_padded_on_request(bag: Path) -> None:
    for path in ("ranges", "ranges[:]", "ranges[0:]"):
        table = columns(bag, "/scan", path)
        assert [row.tolist() for row in table[path]] == [[0, 1], [0, 1, 2], [0, 1, 2, 3]]
        assert table[path].dtype == object and table[path][0].dtype == np.float32
        assert table[path][0].base is None  # not a view that keeps the file's chunk
    padded = columns(bag, "/scan", "ranges", "intensities", pad=NAN)
    assert padded["ranges"].shape == (3, 4) and padded["intensities"].shape == (3, 0)
    assert np.isnan(padded["ranges"][0, 2:]).all() and padded["ranges"][2].tolist() == [0, 1, 2, 3]
    assert [list(row) for row in columns(bag, "/joints", "name")["name"]] == [["a", "bcd"]] * 3
    assert columns(bag, "/joints", "name", pad="-")["name"].shape == (3, 2)


def test_column_paths_continue_into_elements_of_message_sequences(bag: Path) -> None:
    table = columns(bag, "/tf", "transforms[0].transform.translation.x", "transforms[0].header", "transforms[:].header")
    assert table["transforms[0].transform.translation.x"].tolist() == [0, 1, 2]
    assert table.dtype.names[2:] == (
        *("transforms[0].header.stamp", "transforms[0].header.frame_id"),
        *("transforms[:].header.stamp", "transforms[:].header.frame_id"),
    )
    assert table["transforms[:].header.stamp"][1].tolist() == [7 * 10**9, 0]
    second = columns(bag, "/tf", "transforms[1].transform.translation.x", "transforms[1].child_frame_id", start_ns=1)
    assert second["transforms[1].transform.translation.x"].tolist() == [11, 12]
    assert second["transforms[1].child_frame_id"].tolist() == ["lidar"] * 2
    several = columns(bag, "/path", "points[:].time_from_start", "points[:].positions[1]", pad=0)
    assert several["points[:].time_from_start"].tolist() == [[0, n * 10**9] for n in range(3)]
    assert several["points[:].positions[1]"].tolist() == [[1, 2]] * 3


@pytest.mark.parametrize(
    ("topic", "path", "error_text"),
    [
        ("/scan", "ranges[2]", r"/scan at 0 ns: ranges\[2\]: has 2 elements; pass pad="),
        ("/scan", "ranges[0:3]", r"/scan at 0 ns: ranges\[0:3\]: has 2 elements; pass pad="),
        ("/tf", "transforms[1].child_frame_id", r"at 0 ns: transforms\[1\].child_frame_id: has 1 elements"),
        ("/imu", "orientation_covariance[9]", r"orientation_covariance\[9\]: the array has 9 elements"),
        ("/imu", "orientation_covariance[0:10]", r"the array has 9 elements"),
        ("/imu", "header[0]", r"header\[0\]: header is a single std_msgs/msg/Header without elements"),
        ("/imu", "header.frame_id.x", r"header.frame_id is string, which has no fields"),
        ("/imu", "header.frame", r"no column header.frame; did you mean .header.frame_id.*columns are header.stamp"),
        ("/tf", "transform[0].child_frame_id", r"did you mean .transforms\[:\].child_frame_id"),
        ("/scan", "range[0]", r"no column range\[0\].*columns are .*ranges\[:\]"),
        ("/scan", "ranges[a]", r"no column ranges\[a\].*ranges\[:\]"),
        ("/scan", "ranges[", r"no column"),
        ("/scan", "", r"no column"),
        ("/path", "points[:].positions", r"points\[:\].positions: a path must have at most one slice"),
    ],
)
def test_errors_of_wrong_column_paths_list_existing_fields(bag: Path, topic: str, path: str, error_text: str) -> None:
    with pytest.raises(BagError, match=error_text):
        columns(bag, topic, path)


def test_missing_elements_are_padded_only_with_values_of_the_field_type(bag: Path) -> None:
    table = columns(bag, "/scan", "ranges[3]", "ranges[1:4]", pad=NAN)
    assert np.isnan(table["ranges[3]"][:2]).all() and table["ranges[3]"][2] == 3
    assert table["ranges[1:4]"].shape == (3, 3) and table["ranges[1:4]"][2].tolist() == [1, 2, 3]
    assert columns(bag, "/tf", "transforms[1].child_frame_id", pad="-").tolist()[0] == (0, "-")
    for path, pad, error_text in (
        ("transforms[1].child_frame_id", NAN, "pad=nan is not a text"),
        ("transforms[1].header.stamp", NAN, "pad=nan is not a int64"),
        ("transforms[1].header.stamp", 0.5, "pad=0.5 is not a int64"),
        ("transforms[1].transform.translation.x", "-", "pad='-' is not a number"),
    ):
        with pytest.raises(BagError, match=error_text):
            columns(bag, "/tf", path, pad=pad)


def test_one_long_value_does_not_enlarge_every_row_of_a_table(tmp_path: Path) -> None:
    path = tmp_path / "long.mcap"
    with BagWriter(path) as writer:
        for number in range(2000):
            size = 300_000 if number == 7 else 1
            writer.write("/s", String(data="x" * size), number)
            writer.write("/p", Polygon(points=[Point32()] * (30_000 if number == 7 else 1)), number)
    with BagReader(path) as reader:
        with memory_limit(20 << 20):  # 2.4 GB as text of one length
            table = reader.to_arrays("/s")
        assert table["data"][6] == "x" and len(table["data"][7]) == 300_000
        with pytest.raises(
            BagError, match=r"points\[:\].x: with padding it has 60000000 elements, 31999 of them in the bag"
        ):
            reader.to_arrays("/p", "points[:].x", pad=0)
        with pytest.raises(BagError, match=r"points\[0:99999999\].x"):
            reader.to_arrays("/p", "points[0:99999999].x", pad=0)


def test_fixed_size_arrays_of_messages_are_read_as_columns(tmp_path: Path) -> None:
    text = "geometry_msgs/Point32[2] corners\nstring[2] names\nbool[3] flags\nuint8[] raw\n"
    corners = compile_definition(
        "odd_msgs/msg/Box", text + "=" * 80 + "\nMSG: geometry_msgs/Point32\nfloat32 x\nfloat32 y\nfloat32 z\n"
    )
    box = corners()
    box.corners[1].x, box.names, box.flags = 2.0, ["a", "bc"], [True, False, True]
    with BagWriter(tmp_path / "b.mcap") as writer:
        writer.write("/box", box, 1)
    table = columns(tmp_path / "b.mcap", "/box", "corners[1].x", "corners[:].x", "names", "flags[0:2]", "raw")
    assert table["corners[1].x"].tolist() == [2] and table["corners[:].x"].tolist() == [[0, 2]]
    assert table["names"].tolist() == [["a", "bc"]] and table["flags[0:2]"].tolist() == [[True, False]]
    assert table["raw"][0].dtype == np.uint8


@pytest.mark.needs("pandas")
def test_pandas_frame_has_selected_columns_and_time_index(bag: Path) -> None:
    import pandas

    with BagReader(bag) as reader:
        frame = reader.to_pandas("/imu", ["orientation_covariance[6:8]", "header.frame_id", "linear_acceleration.x"])
        assert list(frame.columns) == [
            *("orientation_covariance[6]", "orientation_covariance[7]", "header.frame_id", "linear_acceleration.x")
        ]
        assert frame["orientation_covariance[7]"].tolist() == [7, 17, 27]
        assert frame.index[2] == pandas.Timestamp(2, unit="ns", tz="UTC") and frame.index.name == "log_time"
        assert list(reader.to_pandas("/scan", "ranges", pad=NAN).columns) == [f"ranges[{n}]" for n in range(4)]
        assert [len(row) for row in reader.to_pandas("/scan", "ranges")["ranges"]] == [2, 3, 4]
        assert list(reader.to_pandas("/tf", "transforms[0:1].header.stamp").columns) == ["transforms[0].header.stamp"]
        assert reader.to_pandas("/imu", start_ns=100).empty


def test_error_without_pandas_explains_how_to_install_it(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with (
        BagReader(bag) as reader,
        pytest.raises(ModuleNotFoundError, match="to_pandas needs pandas: pip install pandas"),
    ):
        reader.to_pandas("/imu")
