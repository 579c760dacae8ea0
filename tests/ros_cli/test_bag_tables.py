"""``rosidl-py bag table`` and ``rosidl-py bag sql``."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from support.bag_datasets import bag_of, rows

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagWriter, mcap_writer
from rosidl_py_gen.tables.multi_bag import datasets as many
from rosidl_py_gen.tables.multi_bag.bag_sources import names_of

Imu: Any = get_message("sensor_msgs/msg/Imu")
Image: Any = get_message("sensor_msgs/msg/Image")
String: Any = get_message("std_msgs/msg/String")


def drive(path: Path, broken: bool = False) -> str:
    with BagWriter(path) as made:
        for number in range(50):
            message = Imu()
            message.linear_acceleration.x, message.header.frame_id = number / 2, f"f{number}"
            made.write("/imu", message, number * 10**9)
        made.write("/image", Image(), 1)
        made.add_topic("/s", String)
        made.write("/s", String(data="x").encode()[: 9 if broken else 10], 10**9)
    return str(path)


def test_bags_become_a_dataset_that_can_be_asked(run_here: Any, tmp_path: Path) -> None:
    first, second, out = drive(tmp_path / "a.mcap"), drive(tmp_path / "b"), tmp_path / "out"
    code, said, err = run_here("bag", "table", first, second, "--out", str(out))
    assert (code, said) == (0, f"102 messages of 2 topics in {out}\n")
    large = "sensor_msgs/msg/Image is large: --include-large (include_large=True) writes it"
    assert err == "".join(f"{one}: skipped /image: {large}\n" for one in "ab")
    query = 'select bag, count(*), max(linear_acceleration.x) from "/imu" group by bag order by bag'
    assert run_here("bag", "sql", query, str(out)) == (0, "a\t50\t24.5\nb\t50\t24.5\n", "")
    assert run_here("bag", "sql", query, first, second) == (0, "a\t50\t24.5\nb\t50\t24.5\n", "")
    code, said, err = run_here("bag", "table", first, "--out", str(out))
    assert (code, said, err) == (0, f"0 messages of 0 topics in {out}; 1 bags were unchanged\n", "")
    code, _, err = run_here("bag", "table", first, "--out", str(out), "--include-large")
    assert code == 1 and err.endswith("parquet exists already\n")
    assert run_here("bag", "table", first, "--out", str(out), "--overwrite", "--include-large")[0] == 0


def test_a_part_of_a_bag_is_chosen_as_for_convert(run_here: Any, tmp_path: Path) -> None:
    bag, out = drive(tmp_path / "a.mcap"), tmp_path / "out"
    part = ("--topics", "/imu", "--start-offset", "10", "--duration", "5")
    code, said, _ = run_here("bag", "table", bag, "-o", str(out), *part, "--json")
    told = json.loads(said)
    assert code == 0 and [(one["topic"], one["messages"], one["bag"]) for one in told["files"]] == [("/imu", 5, "a")]
    assert pq.read_table(told["files"][0]["path"]).num_rows == 5
    code, _, err = run_here("bag", "table", bag, "-o", str(out), "--topics", "/im")
    assert code == 1 and "has no topic /im; did you mean" in err


def test_the_answer_has_the_format_that_is_asked_for(run_here: Any, tmp_path: Path) -> None:
    bag = drive(tmp_path / "a.mcap")
    query = "select log_time, header.frame_id, angular_velocity from imu order by log_time limit 2"
    code, said, _ = run_here("bag", "sql", query, bag, "--format", "csv")
    assert code == 0 and list(csv.DictReader(io.StringIO(said)))[1]["frame_id"] == "f1"
    code, said, _ = run_here("bag", "sql", query, bag, "--format", "json")
    rows = [json.loads(line) for line in said.splitlines()]
    assert code == 0 and rows[0]["angular_velocity"] == {"x": 0.0, "y": 0.0, "z": 0.0} and len(rows) == 2
    for name in ("x.csv", "x.json", "x.parquet"):
        assert run_here("bag", "sql", query, bag, "-o", str(tmp_path / name)) == (0, "", "")
    assert pq.read_table(tmp_path / "x.parquet").column("frame_id").to_pylist() == ["f0", "f1"]
    for arguments, wrong in {
        ("-o", str(tmp_path / "x.csv")): "exists already",
        ("-o", str(tmp_path / "x.txt")): "unknown format; pass --format",
        ("-o", str(tmp_path / "y"), "-f", "table"): "--format table cannot be written to a file",
        ("-f", "parquet"): "requires --output",
    }.items():
        code, said, err = run_here("bag", "sql", query, bag, *arguments)
        assert code == 1 and said == "" and wrong in err


def test_errors_name_bag_topic_and_message(run_here: Any, tmp_path: Path) -> None:
    bag, out = drive(tmp_path / "broken.mcap", broken=True), tmp_path / "out"
    for command in (("table", bag, "-o", str(out)), ("sql", 'select * from "/s"', bag)):
        code, _, err = run_here("bag", *command)
        assert code == 1 and f"{bag}: /s at 1000000000 ns: std_msgs/msg/String.data" in err
    code, said, err = run_here("bag", "table", bag, "-o", str(out), "--skip-damaged")
    assert code == 0 and said == f"50 messages of 1 topics in {out}\n" and "skipped /s: " in err
    code, _, err = run_here("bag", "sql", "select * from nothing", bag)
    assert code == 1 and "no topic nothing; there are /image, /imu, /s" in err


def test_patterns_in_quotes_mean_the_bags_that_are_called_so(run_here: Any, tmp_path: Path) -> None:
    for name in ("a", "b"):
        drive(tmp_path / f"{name}.mcap")
    odd = drive(tmp_path / "run[1].mcap")
    query = "select bag, count(*) from imu group by bag order by bag"
    assert run_here("bag", "sql", query, str(tmp_path / "?.mcap")) == (0, "a\t50\nb\t50\n", "")
    assert run_here("bag", "sql", query, odd) == (0, "run[1]\t50\n", "")  # there is one of just this name
    pattern = str(tmp_path / "c*.mcap")
    for command in (("sql", query, pattern), ("table", pattern, "-o", str(tmp_path / "none"))):
        code, _, err = run_here("bag", *command)
        assert (code, err) == (1, f"error: {pattern}: no bag matches\n")
    code, _, err = run_here("bag", "sql", query, str(tmp_path / "c.mcap"))
    assert (code, err) == (1, f"error: {tmp_path / 'c.mcap'}: there is no such bag\n")
    out = tmp_path / "out"
    code, said, _ = run_here("bag", "table", str(tmp_path / "[ab].mcap"), "-o", str(out))
    assert (code, said) == (0, f"102 messages of 2 topics in {out}\n")
    assert run_here("bag", "sql", query, str(tmp_path / "ou*")) == (0, "a\t50\nb\t50\n", "")


def test_a_query_has_so_much_memory_and_then_a_folder(
    run_here: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bag = drive(tmp_path / "a.mcap")
    many = "select count(*) from (select i, count(*) from imu, range(20000) r(i) group by i, log_time)"
    assert run_here("bag", "sql", many, bag, "--memory-limit", "40MB") == (0, "1000000\n", "")
    whole = "select length(string_agg(repeat(header.frame_id, 500000), '')) from imu"
    code, said, err = run_here("bag", "sql", whole, bag, "--memory-limit", "40MB")
    assert (code, said) == (1, "") and err.startswith("error: DuckDB: Out of Memory Error: ")
    assert err.endswith("; --memory-limit raises the limit\n")
    assert run_here("bag", "sql", whole, bag)[0] == 0
    limit = "select value from duckdb_settings() where name = 'memory_limit'"
    assert run_here("bag", "sql", limit, bag)[1] == "953.6 MiB\n"
    code, _, err = run_here("bag", "sql", limit, bag, "--memory-limit", "much")
    assert (code, err) == (1, 'error: expected a memory limit such as 500MB or 8GiB, found "much"\n')
    assert [one.name for one in tmp_path.iterdir()] == ["a.mcap"]


def test_what_is_no_query_is_not_run(run_here: Any, tmp_path: Path) -> None:
    bag, other = drive(tmp_path / "a.mcap"), tmp_path / "b.csv"
    for query, kind in ((f"copy imu to '{other}'", "COPY"), ("select 1; pragma version", "PRAGMA"), (" ", "nothing")):
        code, said, err = run_here("bag", "sql", query, bag)
        assert (code, said) == (1, "")
        assert err == f"error: expected a query, such as select count(*) from a topic, got {kind}\n"
    assert not other.exists()


def test_bags_of_the_same_name_are_told_apart_by_their_folders() -> None:
    assert names_of(["a/x.mcap", "b/x.mcap", "y", "a/x.mcap"]) == {"a/x": "a/x.mcap", "b/x": "b/x.mcap", "y": "y"}
    assert names_of(["/x.db3.zstd"]) == {"x": "/x.db3.zstd"}


def test_processes_of_this_machine_do_it_without_a_scheduler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run_here: Any
) -> None:
    monkeypatch.setattr(many, "RANGE_BYTES", 20_000)
    monkeypatch.setattr(mcap_writer, "_CHUNK", 1 << 13)
    large = bag_of(tmp_path / "large.mcap", *range(3_000), compression="")
    good, out = bag_of(tmp_path / "b.mcap", 1), tmp_path / "out"
    (tmp_path / "junk.mcap").write_bytes(b"junk" * 30)
    code, printed, err = run_here(
        *("bag", "table", str(large), str(tmp_path / "junk.mcap"), str(good), "-o", str(out), "--workers", "2")
    )
    assert code == 1 and printed == f"3001 messages of 1 topics in {out}\n"
    assert err == f"error: {tmp_path}/junk.mcap: damaged: does not begin with the magic bytes of MCAP\n"
    assert rows(out) == [("b", 1)] + [("large", number) for number in range(3_000)]
    assert len(list(out.rglob("bag=large/*.parquet"))) > 1
    code, printed, err = run_here("bag", "table", str(large), str(good), "-o", str(out))
    assert (code, printed, err) == (0, f"0 messages of 0 topics in {out}; 2 bags were unchanged\n", "")
    code, printed, _ = run_here("bag", "table", str(good), str(tmp_path / "junk.mcap"), "-o", str(out))
    assert (code, printed) == (1, f"0 messages of 0 topics in {out}; 1 bags were unchanged\n")
    code, _, err = run_here("bag", "table", str(good), "-o", str(out), "--scheduler", "tcp://x:1", "--workers", "2")
    assert code == 2 and "expected only one of --scheduler and --workers" in err
