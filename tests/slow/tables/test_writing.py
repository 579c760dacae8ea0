"""Bags from tables of any origin, and errors of invalid tables."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String
from support.table_values import imus, write

from rosidl_py_gen import EncodeError, RosidlError, compile_definition
from rosidl_py_gen.bags import BagError, BagReader, BagWriter


def read(path: Path, topic: str) -> list[Any]:
    with BagReader(path) as bag:
        return [one.message for one in bag.messages(topic)]


def test_table_is_written_to_a_bag_equal_to_its_origin(tmp_path: Path) -> None:
    with BagReader(write(tmp_path / "a.mcap", "/imu", *imus(9000))) as bag:
        with BagWriter(tmp_path / "b.mcap") as writer:
            assert writer.write_table(bag.batches("/imu")) == 9000
            assert writer.write_table(bag.batches("/imu", end_ns=20), "/other") == 2
        topic = bag.topics["/imu"]
    assert read(tmp_path / "b.mcap", "/imu") == imus(9000) and len(read(tmp_path / "b.mcap", "/other")) == 2
    with BagReader(tmp_path / "b.mcap") as bag:
        assert bag.topics["/imu"] == topic


def test_tables_of_polars_pandas_and_duckdb_are_written(tmp_path: Path) -> None:
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


def test_fields_without_a_column_have_default_values(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        columns = {"log_time": [1, 2], "header.frame_id": ["a", "b"], "position": [[1], [2, 3]], "name": [[], ["x"]]}
        writer.write_table(pa.table(columns), "/joints", JointState)
        writer.write_table(pa.table({"log_time": pa.array([1], "timestamp[us]")}), "/all", JointState)
    first, second = read(tmp_path / "a.mcap", "/joints")
    assert (first.header.frame_id, first.position.tolist(), second.name, len(second.velocity)) == ("a", [1.0], ["x"], 0)
    assert read(tmp_path / "a.mcap", "/all") == [JointState()]


STRINGS = {"log_time": [5], "data": ["x"]}


@pytest.mark.parametrize(
    ("columns", "error_text"),
    [
        ({"data": ["x"]}, "/s: rows from 0: there is no column log_time"),
        ({**STRINGS, "date": [1]}, "std_msgs/msg/String has no field date; did you mean .data"),
        ({**STRINGS, "data": [None]}, "data: expected text, found null|data: no value in row 0"),
        ({**STRINGS, "data": pa.array([None], pa.string())}, "data: no value in row 0"),
        ({**STRINGS, "data": [1]}, "data: expected text, found int64"),
        ({**STRINGS, "data": [b"x"]}, "data: expected text, found binary"),
        ({**STRINGS, "data": [["x"]]}, "data: expected text, found list"),
        ({**STRINGS, "data.x": ["x"]}, "there is a column data.x, and another one that contains it"),
        ({**STRINGS, "log_time": [1.5]}, "log_time: expected a time, or nanoseconds as integers, found double"),
        ({**STRINGS, "log_time": [-1]}, "/s: log time -1 is not from 0"),
        ({**STRINGS, "log_time": pa.array([2**64 - 1], pa.uint64())}, "rows from 0: .*18446744073709551615"),
    ],
)
def test_table_that_does_not_fit_the_message_class_is_an_error(tmp_path: Path, columns: Any, error_text: str) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer, pytest.raises(BagError, match=error_text):
        writer.write_table(pa.table(columns), "/s", String)


def test_values_that_do_not_fit_are_errors_with_location(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        covariance = pa.table({"log_time": [7], "orientation_covariance": [[1.0] * 8]})
        with pytest.raises(
            EncodeError, match=r"/imu at 7 ns: sensor_msgs/msg/Imu.orientation_covariance: .*9 elements"
        ):
            writer.write_table(covariance, "/imu", Imu)
        for column, value, error_text in [
            ("header.stamp", pa.array([2**62], pa.int64()), r"/imu at 7 ns: sensor_msgs/msg/Imu.header.stamp.sec"),
            ("header.stamp", pa.array(["x"]), "header.stamp: expected a time"),
            ("header", pa.array([1]), "header: expected a struct for std_msgs/msg/Header, found int64"),
            ("header", pa.array([{"stam": 1}]), "has no field header.stam; did you mean .stamp"),
            ("orientation_covariance", pa.array([1.0]), "orientation_covariance: expected a list"),
            ("orientation_covariance", pa.array([["x"]]), "rows from 0: .*x"),
            ("orientation_covariance.x", pa.array([1.0]), "orientation_covariance is .*; its fields cannot be columns"),
        ]:
            table = pa.Table.from_arrays([pa.array([7]), value], ["log_time", column])
            with pytest.raises(ValueError, match=error_text):
                writer.write_table(table, "/imu", Imu)


def test_table_without_metadata_requires_topic_and_message_class(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        for arguments, error_text in {
            (): "table has no ros.topic .*; pass topic=",
            ("/s",): "table has no ros.type .*; pass msg_type=",
            (None, String): "name the topic",
        }.items():
            with pytest.raises(BagError, match=error_text):
                writer.write_table(pa.table(STRINGS), *arguments)
        with pytest.raises(BagError, match="expected a table"):
            writer.write_table([1], "/s", String)
        table_metadata = {b"ros.topic": b"/s", b"ros.type": b"std_msgs/msg/String", b"ros.type_hash": b"RIHS01_0"}
        with pytest.raises(BagError, match="was made of std_msgs/msg/String RIHS01_0"):
            writer.write_table(pa.table(STRINGS).replace_schema_metadata(table_metadata))
        with pytest.raises(ValueError, match=r"none|no "):
            writer.write_table(pa.table(STRINGS).replace_schema_metadata({**table_metadata, b"ros.type": b"../x"}))
    with pytest.raises(BagError, match="closed"):
        writer.write_table(pa.table(STRINGS), "/s", String)


def view(sizes: list[int], offsets: list[int], values: pa.Array, kind: Any) -> pa.Array:
    made = pa.LargeListViewArray if kind == pa.int64() else pa.ListViewArray
    return made.from_arrays(pa.array(offsets, kind), pa.array(sizes, kind), values)


TextArray: Any = compile_definition("a_msgs/msg/TextArray", "string[] data\nuint8[] octets\nfloat32[] floats")


def test_values_of_every_arrow_layout_are_written_correctly(tmp_path: Path) -> None:
    rows = [["a", "b"], ["c"], [], ["d", "e", "f"]]
    flat = pa.array([one for row in rows for one in row])
    numbers = [[1, 2], [255], [], [0, 7, 9]]
    bits = pa.array([one for row in numbers for one in row], pa.int64())
    runs = pa.RunEndEncodedArray.from_arrays(pa.array([2, 6]), pa.array(["x", "y"]))
    repeated = pa.DictionaryArray.from_arrays(pa.array([1, 0, 1]), pa.array(["x", "y"]))
    sizes, offsets = [2, 1, 0, 3], [0, 2, 6, 3]
    shuffled = pa.array(["d", "e", "f", "c", "a", "b"])
    lists = {
        "list": (pa.array(rows), rows),
        "large": (pa.array(rows, pa.large_list(pa.string_view())), rows),
        "view": (view(sizes, offsets, flat, pa.int32()), rows),
        "large view": (view(sizes, offsets, flat, pa.int64()), rows),
        "out of order": (view(sizes, [4, 3, 0, 0], shuffled, pa.int32()), rows),
        "overlapping": (view([2, 3], [1, 0], flat, pa.int32()), [["b", "c"], ["a", "b", "c"]]),
        "slice of a view": (view(sizes, offsets, flat, pa.int64())[1:], rows[1:]),
        "dictionary": (
            pa.DictionaryArray.from_arrays(pa.array([3, 0, 3]), pa.array(rows)),
            [rows[3], rows[0], rows[3]],
        ),
        "fixed": (pa.FixedSizeListArray.from_arrays(flat, 3)[1:], [["d", "e", "f"]]),
        "run ends inside": (pa.ListArray.from_arrays([0, 1, 6], runs), [["x"], ["x", "y", "y", "y", "y"]]),
        "run ends of views": (
            pa.RunEndEncodedArray.from_arrays(pa.array([1, 3, 5]), pa.array(rows[:3], pa.list_view(pa.string_view())))[
                2:
            ],
            [["c"], [], []],
        ),
        "run ends of views inside": (
            pa.ListArray.from_arrays(
                [0, 1, 6], pa.RunEndEncodedArray.from_arrays([2, 6], pa.array(["x", "y"], pa.string_view()))
            ),
            [["x"], ["x", "y", "y", "y", "y"]],
        ),
        "dictionary inside a view": (view([2, 1], [1, 0], repeated, pa.int32()), [["x", "y"], ["y"]]),
        "nothing": (pa.array([[], []]), [[], []]),
    }
    cases = [("data", *case, name) for name, case in lists.items()]
    cases += [
        ("octets", view(sizes, offsets, bits, pa.int64()), numbers, "octets in a view"),
        ("octets", pa.array([bytes(one) for one in numbers], pa.binary_view()), numbers, "bytes in a view"),
        ("floats", view(sizes, offsets, bits, pa.int32()), numbers, "numbers in a view"),
        ("floats", pa.array([[0.1, 1e-60, float("inf")]]), [np.float32([0.1, 0, np.inf]).tolist()], "rounded"),
    ]
    with BagWriter(tmp_path / "a.mcap") as writer:
        for number, (column, values, _, _) in enumerate(cases):
            table = pa.table({"log_time": range(len(values)), column: values})
            assert writer.write_table(table, f"/t{number}", TextArray) == len(values)
    for number, (column, _, right, name) in enumerate(cases):
        found = [list(getattr(one, column)) for one in read(tmp_path / "a.mcap", f"/t{number}")]
        assert found == right, name


Numbers: Any = compile_definition(
    "a_msgs/msg/Numbers",
    "int8 i8\nuint64 u64\nint64 i64\nfloat32 f\nfloat64 d\nbool b\nuint8[] octets\nint16[] list\nstring s\n"
    "std_msgs/Empty none\nbuiltin_interfaces/Time stamp\nbuiltin_interfaces/Duration length\nInner inner\n"
    + "=" * 80 + "\nMSG: a_msgs/Inner\nint8 x\n"
    + "=" * 80 + "\nMSG: std_msgs/Empty\n"
    + "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    + "=" * 80 + "\nMSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n",
)  # fmt: skip
DECIMAL = pa.decimal128(38, 3)


def test_structs_with_views_inside_list_views_are_written(tmp_path: Path) -> None:
    cls = compile_definition("a_msgs/msg/A", f"B[] b\n{'=' * 80}\nMSG: a_msgs/B\nstring s\nint8[] n")
    names = pa.array(["a", "b", "c"]).cast(pa.string_view())
    numbers = view([0, 2, 1], [0, 1, 0], pa.array([1, 2, 3]), pa.int64())
    table = {
        "log_time": [1, 2],
        "b": view([2, 1], [1, 0], pa.StructArray.from_arrays([names, numbers], ["s", "n"]), pa.int32()),
    }
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write_table(pa.table(table), "/b", cls)
    found = [[(one.s, one.n.tolist()) for one in message.b] for message in read(tmp_path / "a.mcap", "/b")]
    assert found == [[("b", [2, 3]), ("c", [1])], [("a", [])]]


def test_numbers_and_times_in_tables_must_fit_exactly(tmp_path: Path) -> None:
    array = pa.array
    right = [
        ("i8", array([-128.0, 127.0]), [-128, 127]),
        ("i8", array([Decimal(-5), Decimal(7)], DECIMAL), [-5, 7]),
        ("u64", array([2**64 - 1], pa.uint64()), [2**64 - 1]),
        ("u64", array([float(2**63)]), [2**63]),
        ("i64", array([-(2.0**63)]), [-(2**63)]),
        ("f", array([2**24, 2**60]), [2.0**24, 2.0**60]),
        ("f", array([0.1, float("nan"), -float("inf")]), [float(np.float32(0.1)), float("nan"), -float("inf")]),
        ("d", array([2**63], pa.uint64()), [2.0**63]),
        ("d", array([Decimal("0.125")], DECIMAL), [0.125]),
        ("b", array([True, False]), [True, False]),
        ("none", array([None, None], pa.int32()), [compile_definition("std_msgs/msg/Empty", "")()] * 2),
        ("stamp", array([1, -1], pa.timestamp("s")), None),
        ("length", array([-1], pa.duration("ms")), None),
    ]
    wrong = [
        ("i8", array([1, 128]), "i8: 128 in row 1 does not fit int8"),
        ("i8", array([1, 2**64 - 1], pa.uint64()), "i8: 18446744073709551615 in row 1 does not fit"),
        ("u64", array([-1]), "u64: -1 in row 0 does not fit uint64"),
        ("u64", array([2.0**64]), "u64: 1.8446744073709552e.19 in row 0 does not fit"),
        ("i64", array([2.0**63]), "i64: 9.223372036854776e.18 in row 0 does not fit"),
        ("i64", array([1.5]), "i64: 1.5 in row 0 does not fit int64"),
        ("i64", array([float("nan")]), "i64: nan in row 0 does not fit"),
        ("i64", array([Decimal("1.5")], DECIMAL), "i64: 1.500 in row 0 does not fit"),
        ("i64", array([Decimal(2**63)], DECIMAL), "i64: 9223372036854775808.000 in row 0 does not fit"),
        ("f", array([0.0, 1e39]), r"f: 1e\+39 in row 1 does not fit float"),
        ("f", array([Decimal(10) ** 30], pa.decimal128(38, 0)), "f: 1000000000000000000000000000000 in row 0 does not"),
        ("f", array([2**24 + 1]), "f: 16777217 in row 0 does not fit float"),
        ("d", array([2**53 + 1]), "d: 9007199254740993 in row 0 does not fit double"),
        ("list", array([[1, 2], [3, 40000]]), "list: 40000 in row 3 does not fit int16"),
        ("octets", array(["1"]), "octets: expected a list for uint8.., found string"),
        ("inner", array([{"x": 300}]), "inner.x: 300 in row 0 does not fit int8"),
        ("inner.x", array(["1"]), "inner.x: expected int8, found string"),
        ("none", array([{"x": 1}]), "none: expected nulls for std_msgs/msg/Empty, which has no fields, found struct"),
        ("none", array([1]), "none: expected nulls for std_msgs/msg/Empty, which has no fields, found int64"),
        ("stamp", array([2**62], pa.timestamp("us")), "stamp: 4611686018427387904 us in row 0 does not fit"),
        ("stamp", array([1], pa.duration("s")), "stamp: expected a time, or nanoseconds as integers, found duration"),
        ("length", array([1], pa.timestamp("s")), "length: expected a duration, or nanoseconds as integers"),
        ("log_time.x", array([1]), "two columns log_time|another one that contains it"),
        ("inner", view([1], [5], array([1]), pa.int32()), "inner: expected a struct"),
        ("list", view([3], [0], array([1]), pa.int32()), "list: a list refers to elements beyond the 1 stored"),
    ]
    text, day = array(["1"]), array([1], pa.int32()).cast(pa.date32())
    others = [text, text.cast(pa.large_string()), text.cast(pa.string_view()), text.cast(pa.binary()), day]
    for values in (*others, array([1], pa.time64("ns")), array([1], pa.timestamp("ns")), array([1], pa.duration("s"))):
        wrong += [(column, values, f"{column}: expected .*, found ") for column in ("i8", "i64", "f", "d", "b")]
    wrong += [("b", array([1]), "b: expected bool, found int64"), ("i64", array([True]), "expected int64, found bool")]
    with BagWriter(tmp_path / "a.mcap") as writer:
        for number, (column, values, _) in enumerate(right):
            table = pa.Table.from_arrays([array(range(len(values))), values], ["log_time", column])
            writer.write_table(table, f"/t{number}", Numbers)
        for column, values, error_text in wrong:
            table = pa.Table.from_arrays([array(range(len(values))), values], ["log_time", column])
            with pytest.raises(BagError, match=error_text):
                writer.write_table(table, "/wrong", Numbers)
        twice = pa.StructArray.from_arrays([array([1]), array([2])], ["x", "x"])
        with pytest.raises(BagError, match="inner: there are two fields x"):
            writer.write_table(pa.table({"log_time": [1], "inner": twice}), "/wrong", Numbers)
    for number, (column, _, values) in enumerate(right):
        found = [getattr(one, column.partition(".")[0]) for one in read(tmp_path / "a.mcap", f"/t{number}")]
        assert values is None or str(found) == str(values), column
    assert [(one.stamp.sec, one.stamp.nanosec) for one in read(tmp_path / "a.mcap", "/t11")] == [(1, 0), (-1, 0)]
    assert [(one.length.sec, one.length.nanosec) for one in read(tmp_path / "a.mcap", "/t12")] == [(-1, 999_000_000)]


def test_errors_of_tables_are_printable_and_of_bounded_length(tmp_path: Path) -> None:
    hostile = "\x1b]0;t\x07\x9b\u202e\nlog_time\r" + "x" * 3_000_000
    struct = pa.struct([(f"{hostile[:99]}{number}", pa.int8()) for number in range(3000)])
    good = {b"ros.topic": b"/s", b"ros.type": b"std_msgs/msg/String"}
    tables = [
        (pa.table({"log_time": [1], hostile: [1]}), True),
        (pa.table({"log_time": [1], f"{hostile}.data": [1], f"{hostile}": [1]}), True),
        (pa.table({"log_tim\x1b": [1]}), True),
        (pa.table({"log_time": [1], "data": pa.array([None], struct)}), True),
        (pa.table({"log_time": [1], "data": pa.array([{}], struct)}), True),
        *(
            (pa.table(STRINGS).replace_schema_metadata({**good, key: hostile.encode()}), False)
            for key in (b"ros.type", b"ros.type_hash", b"ros.definition")
        ),
        (pa.table(STRINGS).replace_schema_metadata({b"ros.topic": hostile.encode()}), False),
        (pa.table(STRINGS).replace_schema_metadata({**good, b"ros.type": b"a\x1b/msg/" + b"y" * 900}), False),
    ]
    with BagWriter(tmp_path / "a.mcap") as writer:
        for number, (table, is_named) in enumerate(tables):
            with pytest.raises(RosidlError) as found:
                writer.write_table(table, *(("/s", String) if is_named else ()))
            text = str(found.value)
            assert len(text) < 10_000 and text.replace("\n", "").isprintable(), number
