"""Bags as Parquet datasets, and SQL over both."""

from __future__ import annotations

import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image, Imu
from std_msgs.msg import String
from support.bag_samples import memory_limit
from support.definition_strategies import World, worlds
from support.definition_strategies import values as world_values
from support.example_counts import examples
from support.reference_cdr import Reference
from support.table_values import imus, of_message, of_row, write

from rosidl_py_gen import compile_definition
from rosidl_py_gen.bags import BagError, BagReader, BagWriter
from rosidl_py_gen.tables import dataset_writer
from rosidl_py_gen.tables.dataset_writer import write_dataset
from rosidl_py_gen.tables.query import Database


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """A bag with an IMU, slower odometry that is a little later, an image, and a topic without messages."""
    path = tmp_path / "drive.mcap"
    with BagWriter(path) as writer:
        for number, message in enumerate(imus(200)):
            writer.write("/imu", message, 10 * number)
            if number % 10 == 0:
                odometry = Odometry(child_frame_id=f"b{number}")
                odometry.pose.pose.position.x = number
                writer.write("/robot/odom", odometry, 10 * number + 5)
        writer.write("/camera", Image(data=np.zeros(1000, np.uint8)), 3)
        writer.add_topic("/nothing", String)
    return path


def test_a_dataset_has_a_file_for_each_topic_and_bag(drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for name in ("drive", "a b/c"):
        with BagReader(drive) as bag:
            report = write_dataset(bag, out, name=name)
    assert [(one.topic, one.messages) for one in report.files] == [("/imu", 200), ("/robot/odom", 20)]
    assert [*report.skipped_topics] == ["/camera"]
    assert report.skipped_topics["/camera"].startswith(
        "sensor_msgs/msg/Image is large: --include-large (include_large=True)"
    )
    files = sorted(str(one.relative_to(out)) for one in out.rglob("*.parquet"))
    assert files == [
        "topic=%2Fimu/bag=a%20b%2Fc/Imu-7d9a00ff.parquet",
        "topic=%2Fimu/bag=drive/Imu-7d9a00ff.parquet",
        "topic=%2Frobot%2Fodom/bag=a%20b%2Fc/Odometry-3cc97dc7.parquet",
        "topic=%2Frobot%2Fodom/bag=drive/Odometry-3cc97dc7.parquet",
    ]
    table = ds.dataset(out / "topic=%2Fimu", partitioning="hive").to_table()
    assert sorted(set(table.column("bag").to_pylist())) == ["a b/c", "drive"] and table.num_rows == 400
    frame = pl.scan_parquet(f"{out}/**/*Imu*.parquet", hive_partitioning=True).collect()
    assert frame["topic"].unique().to_list() == ["/imu"] and frame["linear_acceleration"].struct["x"].max() == 99.5
    file = pq.ParquetFile(out / files[1])
    assert file.schema_arrow.metadata[b"ros.type"] == b"sensor_msgs/msg/Imu"
    assert file.metadata.row_group(0).column(0).compression == "ZSTD"
    with BagWriter(tmp_path / "again.mcap") as writer:
        writer.write_table(file.read())
    with BagReader(tmp_path / "again.mcap") as bag:
        assert [one.message for one in bag] == imus(200)
    with BagReader(drive) as bag:
        with pytest.raises(BagError, match=r"drive/Imu-7d9a00ff.parquet exists already"):
            write_dataset(bag, out)
        write_dataset(bag, out, overwrite=True)
        write_dataset(bag, out, name="large", include_large=True)
        write_dataset(bag, out, name="named", topics=["/camera", "/nothing"])
        with pytest.raises(BagError, match="no topic /camer; did you mean"):
            write_dataset(bag, out, topics=["/camer"])
    assert not list(out.rglob("*.partial")) and len(list(out.rglob("topic=%2Fcamera/*/*.parquet"))) == 2


def test_row_groups_are_ordered_by_time_and_memory_is_bounded(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        for number in range(3000):
            message = Imu()
            message.linear_acceleration.x = number
            for topic in ("/a", "/b", "/c"):
                writer.write(topic, message, number)
        for number in range(3000, 3100):
            writer.write("/image", Image(data=np.full(1 << 20, number % 251, np.uint8)), number)
    before = pa.total_allocated_bytes()
    most = 0

    def record_peak(count: int) -> None:
        nonlocal most
        most = max(most, pa.total_allocated_bytes() - before)

    with memory_limit(64 << 20), BagReader(tmp_path / "a.mcap") as bag:
        report = write_dataset(bag, tmp_path / "out", include_large=True, row_group_bytes=1 << 18, progress=record_peak)
    assert most < 64 << 20
    file = pq.ParquetFile(report.files[0].path)
    spans = [file.metadata.row_group(number).column(0).statistics for number in range(file.num_row_groups)]
    assert len(spans) >= 2 and all(one.max < other.min for one, other in pairwise(spans))


def test_buffered_rows_are_written_when_they_exceed_the_limit(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dataset_writer, "BATCH_BYTES", 1 << 10)
    monkeypatch.setattr(dataset_writer, "MAX_WAITING_BYTES", 1 << 13)
    with BagReader(drive) as bag:
        report = write_dataset(bag, tmp_path / "out")
    assert sum(one.messages for one in report.files) == 220
    assert pq.ParquetFile(report.files[0].path).num_row_groups > 3


def test_dataset_may_be_written_to_a_url(drive: Path) -> None:
    with BagReader(drive) as bag:
        report = write_dataset(bag, "memory://bucket/data", topics=["/imu"])
        with pytest.raises(BagError, match="exists already"):
            write_dataset(bag, "memory://bucket/data", topics=["/imu"])
        with pytest.raises(BagError, match="nope://x"):
            write_dataset(bag, "nope://x", topics=["/imu"])
    assert report.files[0].path == "memory://bucket/data/topic=%2Fimu/bag=drive/Imu-7d9a00ff.parquet"
    with fsspec.open(report.files[0].path) as stream:
        assert pq.read_table(stream).num_rows == 200


def test_fields_named_like_partitions_have_an_underscore_suffix(tmp_path: Path) -> None:
    cls = compile_definition("p/msg/Named", "uint8 topic\nuint8 bag\nuint8 log_time")
    path = write(tmp_path / "a.mcap", "/t", cls(1, 2, 3))
    with BagReader(path) as bag:
        report = write_dataset(bag, tmp_path / "out")
    names = ["log_time", "publish_time", "topic_", "bag_", "log_time_"]
    assert pq.ParquetFile(report.files[0].path).schema_arrow.names == names


@settings(max_examples=examples(60))
@given(worlds().flatmap(lambda world: world_values(world.reference(), world.top).map(lambda value: (world, value))))
def test_random_definitions_round_trip_through_parquet_and_duckdb(case: tuple[World, dict[str, Any]]) -> None:
    world, value = case
    reference: Reference = world.reference()
    with tempfile.TemporaryDirectory() as folder:
        with BagWriter(f"{folder}/a.mcap") as writer:
            writer.add_topic("/t", world.compile())
            for number in range(3):
                writer.write("/t", reference.encode(world.top, value), number)
        with BagReader(f"{folder}/a.mcap") as bag, Database() as base:
            table = bag.table("/t")
            report = write_dataset(bag, f"{folder}/out")
            read = pq.ParquetFile(report.files[0].path).read()
            assert repr(of_row(read.to_pylist())) == repr(of_row(table.to_pylist()))
            assert read.schema.metadata == table.schema.metadata
            base.add('select * from "/t"', {"a": bag})
            assert len(list(base.run('select * from "/t"').rows())) == 3
            message = of_message(next(iter(bag)).message)
            assert message is None or len(message) == len(table.column_names) - 2


# ----------------------------------------------------------------------------------------------------------------- SQL


def query_rows(query: str, *bags: Path, datasets: tuple[Path, ...] = ()) -> list[list[str]]:
    with Database() as base:
        readers = {path.stem: BagReader(path) for path in bags}
        base.add(query, readers, map(str, datasets))
        found = list(base.run(query).rows())
        for one in readers.values():
            one.close()
        return found


def test_topics_are_sql_tables_and_nested_fields_have_dotted_names(drive: Path, tmp_path: Path) -> None:
    columns = "max(linear_acceleration.x), max(header.stamp), any_value(bag)"
    query = f"select {columns} from \"/imu\" where log_time >= timestamp '1970-01-01'"
    assert query_rows(query, drive) == [["99.5", "1970-01-01 00:03:19", "drive"]]
    assert query_rows("select count(*) from imu", drive) == [["200"]]
    joined = (
        'select i.header.stamp, o.child_frame_id from "/imu" i asof join "robot/odom" o on i.log_time >= o.log_time '
        "order by i.log_time limit 2 offset 9"
    )
    assert query_rows(joined, drive) == [["1970-01-01 00:00:10", "b0"], ["1970-01-01 00:00:11", "b10"]]
    with BagReader(drive) as bag:
        for name in ("one", "two"):
            write_dataset(bag, tmp_path / "out", name=name)
    counts = "select bag, count(*) from imu group by bag order by bag"
    assert query_rows(counts, datasets=(tmp_path / "out",)) == [["one", "200"], ["two", "200"]]
    assert query_rows(counts, drive, datasets=(tmp_path / "out",))[0] == ["drive", "200"]
    assert query_rows("select 1 + 1") == [["2"]]


@pytest.mark.parametrize(
    ("query", "error_text"),
    [
        ("select * from imus", "no topic imus; did you mean ./imu.[?]; there are /camera, /imu, /nothing, /robot/odom"),
        ('select * from "/nothing"', "/nothing has no messages"),
        ("select nope from imu", "DuckDB: Binder Error: .*nope"),
        ("selec", "DuckDB: Parser Error: syntax error"),
        ("", "expected a query, .* got nothing"),
        ("select cast(header.frame_id as int) from imu", "DuckDB: Conversion Error"),
        ("select * from read_csv('/nowhere/x.csv')", "DuckDB: IO Error"),
    ],
)
def test_invalid_sql_query_is_an_error(drive: Path, query: str, error_text: str) -> None:
    with pytest.raises(BagError, match=error_text), Database() as base, BagReader(drive) as bag:
        base.add(query, {"drive": bag})
        list(base.run(query).rows())


def test_json_result_never_replaces_or_removes_a_file(tmp_path: Path) -> None:
    target = tmp_path / "result.json"
    target.write_text("of the user")
    with Database() as base, pytest.raises(FileExistsError):
        base.run("select 1").write(str(target), "json")
    assert target.read_text() == "of the user"
    with Database() as base, pytest.raises(BagError, match="Conversion Error"):
        base.run("select cast(x as int) from (values ('1'), ('no')) as t(x)").write(str(tmp_path / "new.json"), "json")
    assert not (tmp_path / "new.json").exists()


def test_sql_query_may_use_one_of_two_topics_that_differ_in_case(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write("/Imu", Imu(), 1)
        writer.write("/imu", String(data="x"), 1)
    assert query_rows('select data from "/imu"', tmp_path / "a.mcap") == [["x"]]
    with pytest.raises(BagError, match="/Imu and /imu are one table in SQL"):
        query_rows('select data from "/imu", "/Imu"', tmp_path / "a.mcap")
