"""Tables as bags: of whoever makes them, and what is said of those that cannot be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import duckdb
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from table_values import imus, write

from rosidl_py_gen import EncodeError, get_message
from rosidl_py_gen.bags import BagError, BagReader, BagWriter

Imu: Any = get_message("sensor_msgs/msg/Imu")
String: Any = get_message("std_msgs/msg/String")
JointState: Any = get_message("sensor_msgs/msg/JointState")


def read(path: Path, topic: str) -> list[Any]:
    with BagReader(path) as bag:
        return [one.message for one in bag.messages(topic)]


def test_a_table_becomes_the_bag_it_was_read_from(tmp_path: Path) -> None:
    with BagReader(write(tmp_path / "a.mcap", "/imu", *imus(9000))) as bag:
        with BagWriter(tmp_path / "b.mcap") as writer:
            assert writer.write_table(bag.batches("/imu")) == 9000
            assert writer.write_table(bag.batches("/imu", end_ns=20), "/other") == 2
        topic = bag.topics["/imu"]
    assert read(tmp_path / "b.mcap", "/imu") == imus(9000) and len(read(tmp_path / "b.mcap", "/other")) == 2
    with BagReader(tmp_path / "b.mcap") as bag:
        assert bag.topics["/imu"] == topic


def test_polars_pandas_and_duckdb_give_tables(tmp_path: Path) -> None:
    with BagReader(write(tmp_path / "a.mcap", "/imu", *imus(5))) as bag:
        frame = pl.DataFrame(bag.table("/imu"))
        flat = bag.table("/imu", ["header.frame_id", "header.stamp", "linear_acceleration.x"]).to_pandas()
        table = bag.table("/imu")
    frame = frame.with_columns(pl.col("header").struct.with_fields(pl.field("frame_id").cast(pl.Categorical)))
    assert isinstance(flat, pd.DataFrame)
    with BagWriter(tmp_path / "b.mcap") as writer:
        writer.write_table(frame, "/polars", Imu)
        writer.write_table(flat, "/pandas", Imu)
        writer.write_table(duckdb.from_arrow(table).filter("linear_acceleration.x > 1"), "/duckdb", Imu)
    assert read(tmp_path / "b.mcap", "/polars") == imus(5) == read(tmp_path / "b.mcap", "/pandas")
    assert read(tmp_path / "b.mcap", "/duckdb") == imus(5)[3:]


def test_fields_without_a_column_have_their_defaults(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        columns = {"log_time": [1, 2], "header.frame_id": ["a", "b"], "position": [[1], [2, 3]], "name": [[], ["x"]]}
        writer.write_table(pa.table(columns), "/joints", JointState)
        writer.write_table(pa.table({"log_time": pa.array([1], "timestamp[us]")}), "/all", JointState)
    first, second = read(tmp_path / "a.mcap", "/joints")
    assert (first.header.frame_id, first.position.tolist(), second.name, len(second.velocity)) == ("a", [1.0], ["x"], 0)
    assert read(tmp_path / "a.mcap", "/all") == [JointState()]


STRINGS = {"log_time": [5], "data": ["x"]}


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"data": ["x"]}, "/s: rows from 0: there is no column log_time"),
        ({**STRINGS, "date": [1]}, "std_msgs/msg/String has no field date; did you mean .data"),
        ({**STRINGS, "data": [None]}, "data: expected text, found null|data: no value in row 0"),
        ({**STRINGS, "data": pa.array([None], pa.string())}, "data: no value in row 0"),
        ({**STRINGS, "data": [1]}, "data: expected text, found int64"),
        ({**STRINGS, "data": [b"x"]}, "data: expected text, found binary"),
        ({**STRINGS, "data": [["x"]]}, "data: expected text, found list"),
        ({**STRINGS, "data.x": ["x"]}, "there is a column data.x, and one that holds it"),
        ({**STRINGS, "log_time": [1.5]}, "log_time: expected a time, or nanoseconds as integers, found double"),
        ({**STRINGS, "log_time": [-1]}, "/s: log time -1 is not from 0"),
        ({**STRINGS, "log_time": pa.array([2**64 - 1], pa.uint64())}, "rows from 0: .*18446744073709551615"),
    ],
)
def test_what_is_no_table_of_such_messages_is_an_error(tmp_path: Path, columns: Any, said: str) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer, pytest.raises(BagError, match=said):
        writer.write_table(pa.table(columns), "/s", String)


def test_values_that_do_not_fit_are_errors_with_their_place(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        covariance = pa.table({"log_time": [7], "orientation_covariance": [[1.0] * 8]})
        with pytest.raises(
            EncodeError, match=r"/imu at 7 ns: sensor_msgs/msg/Imu.orientation_covariance: .*9 elements"
        ):
            writer.write_table(covariance, "/imu", Imu)
        for column, value, said in [
            ("header.stamp", pa.array([2**62], pa.int64()), r"/imu at 7 ns: sensor_msgs/msg/Imu.header.stamp.sec"),
            ("header.stamp", pa.array(["x"]), "header.stamp: expected a time"),
            ("header", pa.array([1]), "header: expected a struct for std_msgs/msg/Header, found int64"),
            ("header", pa.array([{"stam": 1}]), "has no field header.stam; did you mean .stamp"),
            ("orientation_covariance", pa.array([1.0]), "orientation_covariance: expected a list"),
            ("orientation_covariance", pa.array([["x"]]), "rows from 0: .*x"),
            ("orientation_covariance.x", pa.array([1.0]), "orientation_covariance is .*, and has no fields"),
        ]:
            table = pa.Table.from_arrays([pa.array([7]), value], ["log_time", column])
            with pytest.raises(ValueError, match=said):
                writer.write_table(table, "/imu", Imu)


def test_a_table_that_does_not_say_what_it_holds_needs_a_topic_and_a_class(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        for arguments, said in {
            (): "does not say its topic",
            ("/s",): "does not say the type",
            (None, String): "name the topic",
        }.items():
            with pytest.raises(BagError, match=said):
                writer.write_table(pa.table(STRINGS), *arguments)
        with pytest.raises(BagError, match="expected a table"):
            writer.write_table([1], "/s", String)
        told = {b"ros.topic": b"/s", b"ros.type": b"std_msgs/msg/String", b"ros.type_hash": b"RIHS01_0"}
        with pytest.raises(BagError, match="was made of std_msgs/msg/String RIHS01_0"):
            writer.write_table(pa.table(STRINGS).replace_schema_metadata(told))
        with pytest.raises(ValueError, match=r"none|no "):
            writer.write_table(pa.table(STRINGS).replace_schema_metadata({**told, b"ros.type": b"../x"}))
    with pytest.raises(BagError, match="closed"):
        writer.write_table(pa.table(STRINGS), "/s", String)
