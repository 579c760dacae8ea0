"""Topics as Arrow tables: types, columns, consumers, errors."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from geometry_msgs.msg import Point32, Polygon, PoseStamped
from geometry_msgs.msg import TransformStamped as Stamped
from nav_msgs.msg import Path as Path_
from sensor_msgs.msg import Image
from std_msgs.msg import String
from support.bag_samples import STRING, write_foreign, write_humble
from support.table_values import imus, of_message, rows, write

from rosidl_py_gen import DecodeError, ExtraMissingError, compile_definition, get_message, type_hash
from rosidl_py_gen.bags import BagError, BagReader, BagTopic, BagWarning, BagWriter

TFMessage: Any = get_message("tf2_msgs/msg/TFMessage")

EVERYTHING = """\
uint8 LIMIT=7
string NAME="it's"
bool flag
char letter
byte octet
int8 small
uint64 large
float32 half
float64 whole
string text
wstring wide
wstring[] many_wide
uint8[] data
byte[4] four
char[<=9] letters
int8[] signed
bool[3] three
float64[9] covariance
string[2] pair
builtin_interfaces/Time stamp
builtin_interfaces/Duration[] waits
Empty nothing
Empty[] nothings
Part part
Part[] parts
Part[2] two
"""
TEXT = f"{EVERYTHING}\n{'=' * 80}\nMSG: p/Empty\n{'=' * 80}\nMSG: p/Part\nuint8 a\nfloat64 b\n"


def test_arrow_types_and_metadata_match_the_definition(tmp_path: Path) -> None:
    cls = compile_definition("p/msg/Everything", TEXT)
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.add_topic("/all", BagTopic("/all", "p/msg/Everything", TEXT, type_hash=type_hash(cls)))
        writer.write("/all", cls(large=2**64 - 1, wide="\U0001f600").encode())
    with BagReader(tmp_path / "a.mcap") as bag:
        table = bag.table("/all")
    part = "struct<a: uint8 not null, b: double not null>"
    column_types = {field.name: str(field.type) for field in table.schema}
    assert column_types == {
        "log_time": "timestamp[ns]",
        "publish_time": "timestamp[ns]",
        "flag": "bool",
        "letter": "uint8",
        "octet": "uint8",
        "small": "int8",
        "large": "uint64",
        "half": "float",
        "whole": "double",
        "text": "string",
        "wide": "string",
        "many_wide": "list<item: string not null>",
        "data": "binary",
        "four": "fixed_size_binary[4]",
        "letters": "binary",
        "signed": "list<item: int8 not null>",
        "three": "fixed_size_list<item: bool not null>[3]",
        "covariance": "fixed_size_list<item: double not null>[9]",
        "pair": "fixed_size_list<item: string not null>[2]",
        "stamp": "timestamp[ns]",
        "waits": "list<item: duration[ns] not null>",
        "nothing": "null",
        "nothings": "list<item: null>",
        "part": part,
        "parts": f"list<item: {part} not null>",
        "two": f"fixed_size_list<item: {part} not null>[2]",
    }
    assert [field.name for field in table.schema if field.nullable] == ["nothing"]
    table_metadata = table.schema.metadata
    assert table_metadata[b"ros.type"] == b"p/msg/Everything" and table_metadata[
        b"ros.type_hash"
    ].decode() == type_hash(cls)
    assert table_metadata[b"ros.topic"] == b"/all" and b"uint8 LIMIT" in table_metadata[b"ros.definition"]
    assert json.loads(table_metadata[b"ros.constants"]) == {"p/msg/Everything": {"LIMIT": 7, "NAME": "it's"}}
    assert table.schema.field("wide").metadata == {b"ros.type": b"wstring"}
    assert table.column("wide").to_pylist() == ["\U0001f600"] and table.column("large").to_pylist() == [2**64 - 1]


def test_columns_are_selected_and_named_by_path(tmp_path: Path) -> None:
    with BagReader(write(tmp_path / "a.mcap", "/imu", *imus(7))) as bag:
        table = bag.table("/imu", ["linear_acceleration.x", "header.frame_id", "angular_velocity"], start_ns=20)
        assert table.column_names[2:] == ["linear_acceleration.x", "header.frame_id", "angular_velocity"]
        assert table.column("linear_acceleration.x").to_pylist() == [1.0, 1.5, 2.0, 2.5, 3.0]
        assert table.column("header.frame_id").to_pylist()[:2] == ["base", "a longer frame"]
        assert bag.table("/imu", "header.stamp", end_ns=0).num_rows == 0
        assert bag.table("/imu", []).column_names == ["log_time", "publish_time"]
        for wrong, error_text in {
            "linear.x": "a.mcap: /imu: no column linear.x; there are header, header.stamp",
            "header.stam": "did you mean .header.stamp",
            "header.stamp.sec": "no column",
            "": "no column",
        }.items():
            with pytest.raises(BagError, match=error_text):
                bag.batches("/imu", wrong)
        with pytest.raises(BagError, match=r"no topic /im; did you mean ./imu"):
            bag.table("/im")
        with pytest.raises(ValueError, match="on_error"):
            bag.table("/imu", on_error="ignore")  # type: ignore[arg-type]
    with (
        BagReader(write(tmp_path / "b.mcap", "/tf", TFMessage(transforms=[Stamped()]))) as bag,
        pytest.raises(BagError, match=r"transforms.header: transforms is a list of messages; select it as a whole"),
    ):
        bag.table("/tf", "transforms.header")


def test_fields_named_like_bag_times_have_an_underscore_suffix(tmp_path: Path) -> None:
    cls = compile_definition("p/msg/Clash", "uint8 log_time\nuint8 x")
    with BagReader(write(tmp_path / "a.mcap", "/c", cls(3, 4))) as bag:
        table = bag.table("/c")
        assert table.column_names == ["log_time", "publish_time", "log_time_", "x"]
    with BagWriter(tmp_path / "b.mcap") as writer:
        writer.write_table(table)
    with BagReader(tmp_path / "b.mcap") as bag:
        assert next(iter(bag)).message == cls(3, 4)


def test_size_of_batches_is_limited_by_batch_bytes(tmp_path: Path) -> None:
    with BagReader(write(tmp_path / "a.mcap", "/imu", *imus(100))) as bag:
        sizes = [batch.num_rows for batch in bag.batches("/imu", batch_bytes=3300)]
        assert len(sizes) >= 5 and sum(sizes) == 100
        assert [batch.num_rows for batch in bag.batches("/imu", batch_bytes=0)] == [1] * 100


def test_lists_of_messages_of_equal_and_different_size_are_read(tmp_path: Path) -> None:
    def path(count: int, frame: str) -> Any:
        poses = [PoseStamped() for _ in range(count)]
        for number, pose in enumerate(poses):
            pose.pose.position.x = number
            pose.header.frame_id = frame if number % 5 else frame[:1]
        return Path_(poses=poses)

    even = [path(count, "m") for count in (0, 1, 2, 300)]
    odd = [path(count, "map of it") for count in (0, 1, 2, 3, 7, 8)] + [path(40, "map of it") for _ in range(3)]
    for name, messages in {"even": even, "odd": odd, "few": odd[:6] * 9}.items():
        with BagReader(write(tmp_path / f"{name}.mcap", "/path", *messages)) as bag:
            assert rows(bag.table("/path")) == [of_message(one) for one in messages]


def test_big_endian_messages_are_read(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.add_topic("/s", String)
        writer.write("/s", String(data="little").encode(), 0)
        writer.write("/s", bytes.fromhex("00000000 00000004") + b"big\0", 1)
    with BagReader(tmp_path / "a.mcap") as bag:
        assert bag.table("/s").column("data").to_pylist() == ["little", "big"]


def test_damaged_messages_are_errors_or_skipped_on_request(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.add_topic("/s", String)
        for number in range(10):
            data = String(data=f"number {number}").encode()
            writer.write("/s", data[:-3] if number == 4 else data, number)
    with BagReader(tmp_path / "a.mcap") as bag:
        with pytest.raises(DecodeError, match=r"a.mcap: /s at 4 ns: std_msgs/msg/String.data"):
            bag.table("/s")
        with pytest.warns(BagWarning, match="skipped /s"):
            table = bag.table("/s", on_error="skip")
        assert table.column("log_time").cast("int64").to_pylist() == [0, 1, 2, 3, 5, 6, 7, 8, 9]
        assert bag.skipped["/s"].count == 1


def test_list_that_extends_into_the_next_message_is_an_error(tmp_path: Path) -> None:
    square = Polygon(points=[Point32(x=float(number)) for number in range(4)]).encode()
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.add_topic("/p", Polygon)
        for number in range(3):
            writer.write("/p", square[:4] + b"\5" + square[5:] if number == 1 else square, number)
    with (
        BagReader(tmp_path / "a.mcap") as bag,
        pytest.raises(DecodeError, match=r"/p at 1 ns: geometry_msgs/msg/Polygon.points\[4\]"),
    ):
        bag.table("/p")


def test_two_definitions_of_a_topic_form_one_table_if_columns_are_equal(tmp_path: Path) -> None:
    old, new = (compile_definition("p/msg/T", text) for text in ("uint8 a\nuint8 b", "uint8 X=1\nuint8 a\nuint8 b"))
    other = compile_definition("p/msg/T", "uint8 a\nfloat32 c")
    paths = []
    for name, second in {"alike": new, "other": other}.items():
        first, last = (tmp_path / f"{name}{number}.mcap" for number in (1, 2))
        write(first, "/t", old(1, 2), old(3, 4))
        write(last, "/t", second(5, 6))
        paths.append(tmp_path / name)
        with BagWriter(paths[-1]) as writer:
            for one in (first, last):
                with BagReader(one) as bag:
                    for message in bag.raw_messages():
                        writer.write_raw(message)
    with BagReader(paths[0]) as bag:
        assert sorted(bag.table("/t").column("a").to_pylist()) == [1, 3, 5]
    with BagReader(paths[1]) as bag:
        with pytest.raises(BagError, match=r"other: /t was recorded with 2 definitions with different columns"):
            bag.table("/t")
        assert sorted(bag.table("/t", "a").column("a").to_pylist()) == [1, 3, 5]
        assert sorted(bag.table(one).num_rows for one in bag.channels) == [1, 2]


def test_bag_without_definitions_is_read_by_type_name_and_sizes_are_checked(tmp_path: Path) -> None:
    samples = enumerate(one.encode() for one in imus(20))
    file = write_humble(tmp_path / "a.db3", ("/imu", "sensor_msgs/msg/Imu", samples))
    with BagReader(file) as bag, pytest.warns(BagWarning, match="contains neither definition"):
        table = bag.table("/imu")
        assert rows(table) == [of_message(one) for one in imus(20)]
        assert b"geometry_msgs" in table.schema.metadata[b"ros.definition"]
    with (
        BagReader(file, typestore={"sensor_msgs/msg/Imu": "uint8 x"}) as bag,
        pytest.warns(BagWarning),
        pytest.raises(BagError, match="bytes of a message are after its last field"),
    ):
        bag.table("/imu")


def test_time_beyond_the_range_of_arrow_is_an_error(tmp_path: Path) -> None:
    write_foreign(tmp_path / "a.mcap", ("/s", *STRING, [(2**63, String(data="x").encode())]))
    with BagReader(tmp_path / "a.mcap") as bag, pytest.raises(BagError, match=f"/s at {2**63} ns: expected a time"):
        bag.table("/s")


def test_definition_with_too_many_columns_is_refused(tmp_path: Path) -> None:
    texts = ["M1 a\nM1 b\nM1 c\nM1 d"]
    texts += [f"MSG: p/M{number}\nM{number + 1} a\nM{number + 1} b\nM{number + 1} c" for number in range(1, 10)]
    cls = compile_definition("p/msg/M0", f"\n{'=' * 80}\n".join([*texts, "MSG: p/M10\nuint8 a"]))
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.add_topic("/m", cls)
        writer.write("/m", bytes(8), 0)
    with BagReader(tmp_path / "a.mcap") as bag, pytest.raises(BagError, match=r"/m: p/msg/M0 has .* columns; expected"):
        bag.table("/m")


def test_truncated_message_with_a_huge_array_is_a_decode_error(tmp_path: Path) -> None:
    cls = compile_definition("p/msg/Huge", "float64[30000000] a\nstring b")
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.add_topic("/m", cls)
        writer.write("/m", b"\0\1\0\0" + bytes(80), 0)
    with BagReader(tmp_path / "a.mcap") as bag, pytest.raises(DecodeError, match="expected 240000000 bytes"):
        bag.table("/m")


def test_counts_larger_than_the_message_are_decode_errors(tmp_path: Path) -> None:
    for text in ("float64[] a", "string[] a", "E[] a", "P[] a", "S[] a", "wstring a"):
        whole = f"{text}\n{'=' * 80}\nMSG: p/E\n{'=' * 80}\nMSG: p/P\nfloat64 x\n{'=' * 80}\nMSG: p/S\nstring s"
        cls = compile_definition("p/msg/Counted", whole)
        name = tmp_path / f"{text[:4]}.mcap"
        with BagWriter(name) as writer:
            writer.add_topic("/m", cls)
            for number in range(3):
                writer.write("/m", b"\0\1\0\0" + b"\xff\xff\xff\x7f" + bytes(12), number)
        with BagReader(name) as bag, pytest.raises(DecodeError, match="/m at 0 ns"):
            bag.table("/m")


def test_image_data_is_read_as_binary_in_bounded_memory(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 255, 1 << 20, np.uint8)
    write(tmp_path / "a.mcap", "/image", *[Image(data=pixels)] * 40)
    before = pa.total_allocated_bytes()
    with BagReader(tmp_path / "a.mcap") as bag:
        for batch in bag.batches("/image"):
            assert batch.num_rows <= 2
            assert pa.total_allocated_bytes() - before < 8 << 20
        assert batch.column("data")[0].as_py() == pixels.tobytes()


def test_error_without_pyarrow_contains_the_install_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("rosidl_py_gen.tables")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    error_text = r"needs pyarrow, which is not installed: pip install .*\[tables\]"
    with (
        BagReader(write(tmp_path / "a.mcap", "/s", String())) as bag,
        pytest.raises(ExtraMissingError, match=error_text),
    ):
        bag.table("/s")
