"""``rosidl-py bag table`` and ``rosidl-py bag sql``: parts of bags, damage, names and values of any kind."""

from __future__ import annotations

import csv
import io
import json
import math
import shutil
import struct
import sys
from pathlib import Path
from typing import Any

import duckdb
import pyarrow.parquet as pq
import pytest
from support import bag_datasets
from support.bag_samples import write_strings

from rosidl_py_gen import compile_definition, get_message
from rosidl_py_gen.bags import BagWriter, writer
from rosidl_py_gen.bags.remote import BagLocation
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.tables import multi_bag

pytestmark = pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")  # what is lost is output in them
Imu: Any = get_message("sensor_msgs/msg/Imu")
Image: Any = get_message("sensor_msgs/msg/Image")
Odometry: Any = get_message("nav_msgs/msg/Odometry")
String: Any = get_message("std_msgs/msg/String")
QUERY = 'select epoch_ns(log_time) as log_time, data from "/s" order by log_time'
RIGHT = [{"log_time": number, "data": f"number {number}"} for number in range(8)]
MB = 1 << 20
Values: Any = compile_definition("a_msgs/msg/Values", "float64 d\nfloat32[] f\nstring s\nint64 i")
HOSTILE = '\x1b]0;t\x07\x9b2J\u202e"NaN\\", Infinity'


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


def test_table_writes_dataset_that_sql_queries_like_bags(run_here: Any, tmp_path: Path) -> None:
    first, second, out = drive(tmp_path / "a.mcap"), drive(tmp_path / "b"), tmp_path / "out"
    code, output, err = run_here("bag", "table", first, second, "--out", str(out))
    assert (code, output) == (0, f"102 messages of 2 topics in {out}\n")
    large = "sensor_msgs/msg/Image is large: --include-large (include_large=True) writes it"
    assert err == "".join(f"{one}: skipped /image: {large}\n" for one in "ab")
    query = 'select bag, count(*), max(linear_acceleration.x) from "/imu" group by bag order by bag'
    assert run_here("bag", "sql", query, str(out)) == (0, "a\t50\t24.5\nb\t50\t24.5\n", "")
    assert run_here("bag", "sql", query, first, second) == (0, "a\t50\t24.5\nb\t50\t24.5\n", "")
    code, output, err = run_here("bag", "table", first, "--out", str(out))
    assert (code, output, err) == (0, f"0 messages of 0 topics in {out}; 1 bag unchanged\n", "")
    code, _, err = run_here("bag", "table", first, "--out", str(out), "--include-large")
    assert code == 1 and err.endswith("parquet exists already\n")
    assert run_here("bag", "table", first, "--out", str(out), "--overwrite", "--include-large")[0] == 0


def test_table_has_selection_options_of_convert(run_here: Any, tmp_path: Path) -> None:
    bag, out = drive(tmp_path / "a.mcap"), tmp_path / "out"
    part = ("--topics", "/imu", "--start-offset", "10", "--duration", "5")
    code, output, _ = run_here("bag", "table", bag, "-o", str(out), *part, "--json")
    document = json.loads(output)
    assert code == 0 and [(one["topic"], one["messages"], one["bag"]) for one in document["files"]] == [
        ("/imu", 5, "a")
    ]
    assert pq.read_table(document["files"][0]["path"]).num_rows == 5
    code, _, err = run_here("bag", "table", bag, "-o", str(out), "--topics", "/im")
    assert code == 1 and "has no topic /im; did you mean" in err


def test_sql_writes_result_in_requested_format(run_here: Any, tmp_path: Path) -> None:
    bag = drive(tmp_path / "a.mcap")
    query = "select log_time, header.frame_id, angular_velocity from imu order by log_time limit 2"
    code, output, _ = run_here("bag", "sql", query, bag, "--format", "csv")
    assert code == 0 and list(csv.DictReader(io.StringIO(output)))[1]["frame_id"] == "f1"
    code, output, _ = run_here("bag", "sql", query, bag, "--format", "json")
    rows = [json.loads(line) for line in output.splitlines()]
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
        code, output, err = run_here("bag", "sql", query, bag, *arguments)
        assert code == 1 and output == "" and wrong in err


def test_decode_errors_of_table_and_sql_name_bag_topic_and_time(run_here: Any, tmp_path: Path) -> None:
    bag, out = drive(tmp_path / "broken.mcap", broken=True), tmp_path / "out"
    for command in (("table", bag, "-o", str(out)), ("sql", 'select * from "/s"', bag)):
        code, _, err = run_here("bag", *command)
        assert code == 1 and f"{bag}: /s at 1000000000 ns: std_msgs/msg/String.data" in err
    code, output, err = run_here("bag", "table", bag, "-o", str(out), "--skip-damaged")
    assert code == 0 and output == f"50 messages of 1 topic in {out}\n" and "skipped /s: " in err
    code, _, err = run_here("bag", "sql", "select * from nothing", bag)
    assert code == 1 and "no topic nothing; there are /image, /imu, /s" in err


def test_quoted_patterns_select_matching_bags(run_here: Any, tmp_path: Path) -> None:
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
    code, output, _ = run_here("bag", "table", str(tmp_path / "[ab].mcap"), "-o", str(out))
    assert (code, output) == (0, f"102 messages of 2 topics in {out}\n")
    assert run_here("bag", "sql", query, str(tmp_path / "ou*")) == (0, "a\t50\nb\t50\n", "")


def test_sql_query_is_limited_by_memory_limit_option(run_here: Any, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    bag = drive(tmp_path / "a.mcap")
    many = "select count(*) from (select i, count(*) from imu, range(20000) r(i) group by i, log_time)"
    assert run_here("bag", "sql", many, bag, "--memory-limit", "40MB") == (0, "1000000\n", "")
    whole = "select length(string_agg(repeat(header.frame_id, 500000), '')) from imu"
    code, output, err = run_here("bag", "sql", whole, bag, "--memory-limit", "40MB")
    assert (code, output) == (1, "") and err.startswith("error: DuckDB: Out of Memory Error: ")
    assert err.endswith("; --memory-limit raises the limit\n")
    assert run_here("bag", "sql", whole, bag)[0] == 0
    limit = "select value from duckdb_settings() where name = 'memory_limit'"
    assert run_here("bag", "sql", limit, bag)[1] == "953.6 MiB\n"
    code, _, err = run_here("bag", "sql", limit, bag, "--memory-limit", "much")
    assert (code, err) == (1, 'error: expected a memory limit such as 500MB or 8GiB, found "much"\n')
    assert [one.name for one in tmp_path.iterdir()] == ["a.mcap"]


def test_sql_refuses_statements_that_are_not_queries(run_here: Any, tmp_path: Path) -> None:
    bag, other = drive(tmp_path / "a.mcap"), tmp_path / "b.csv"
    for query, kind in ((f"copy imu to '{other}'", "COPY"), ("select 1; pragma version", "PRAGMA"), (" ", "nothing")):
        code, output, err = run_here("bag", "sql", query, bag)
        assert (code, output) == (1, "")
        assert err == f"error: expected a query, such as select count(*) from a topic, got {kind}\n"
    assert not other.exists()


@pytest.mark.slow
def test_table_uses_local_worker_processes_without_scheduler(tmp_path: Path, monkeypatch: Any, run_here: Any) -> None:
    monkeypatch.setattr(multi_bag, "RANGE_BYTES", 20_000)
    monkeypatch.setattr(writer, "CHUNK_BYTES", 1 << 13)
    large = bag_datasets.bag_of(tmp_path / "large.mcap", *range(3_000), compression="")
    good, out = bag_datasets.bag_of(tmp_path / "b.mcap", 1), tmp_path / "out"
    (tmp_path / "junk.mcap").write_bytes(b"junk" * 30)
    code, printed, err = run_here(
        *("bag", "table", str(large), str(tmp_path / "junk.mcap"), str(good), "-o", str(out), "--workers", "2")
    )
    assert code == 1 and printed == f"3001 messages of 1 topic in {out}\n"
    assert err == f"error: {tmp_path}/junk.mcap: damaged: does not begin with the magic bytes of MCAP\n"
    assert bag_datasets.rows(out) == [("b", 1)] + [("large", number) for number in range(3_000)]
    assert len(list(out.rglob("bag=large/*.parquet"))) > 1
    code, printed, err = run_here("bag", "table", str(large), str(good), "-o", str(out))
    assert (code, printed, err) == (0, f"0 messages of 0 topics in {out}; 2 bags unchanged\n", "")
    code, printed, _ = run_here("bag", "table", str(good), str(tmp_path / "junk.mcap"), "-o", str(out))
    assert (code, printed) == (1, f"0 messages of 0 topics in {out}; 1 bag unchanged\n")
    code, _, err = run_here("bag", "table", str(good), "-o", str(out), "--scheduler", "tcp://x:1", "--workers", "2")
    assert code == 2 and "expected only one of --scheduler and --workers" in err


def damaged(data: bytes, count: int) -> list[bytes]:
    """Return copies of data: each has a wrong byte or bit, or is truncated; only a checksum reveals the last one."""
    step = len(data) // count
    wrong = [
        data[:at] + bytes([data[at] ^ (0xFF if at % 2 else 1 << at // 2 % 8)]) + data[at + 1 :]
        for at in range(0, len(data), step)
    ]
    return [*wrong, *(data[:at] for at in range(1, len(data), step)), data.replace(b"number 3", b"number 4")]


def require_error_line(code: int, err: str) -> None:
    last = err.splitlines()[-1]
    assert code == 1 and last.startswith("error: ") and len(last) > 20 and "Traceback" not in err, err


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["", "zstd"])
def test_damaged_mcap_file_yields_correct_rows_or_an_error(run_here: Any, tmp_path: Path, compression: str) -> None:
    path, out = tmp_path / "a.mcap", tmp_path / "out"
    write_strings(path, [one["data"] for one in RIGHT], compression=compression)
    codes = set()
    for wrong in damaged(path.read_bytes(), 23):
        path.write_bytes(wrong)
        asked, output, err = run_here("bag", "sql", QUERY, str(path), "-f", "json")
        found = [json.loads(line) for line in output.splitlines()] if asked == 0 else require_error_line(asked, err)
        assert found in (None, RIGHT[: len(found or ())])
        shutil.rmtree(out, ignore_errors=True)
        code, output, err = run_here("bag", "table", str(path), "--out", str(out), "--json")
        files = [file for file in out.rglob("*") if file.is_file()]
        if code:
            require_error_line(code, err)
            assert files == []
        for one in json.loads(output)["files"] if code == 0 else ():
            table = pq.ParquetFile(one["path"]).read()
            times = table.column("log_time").cast("int64").to_pylist()
            rows = [{"log_time": at, "data": text} for at, text in zip(times, table["data"].to_pylist(), strict=True)]
            assert rows == RIGHT[: one["messages"]]
        codes.add((asked, code))
    assert {(0, 0), (1, 1)} <= codes


@pytest.mark.slow
def test_damaged_dataset_yields_rows_or_an_error(run_here: Any, tmp_path: Path) -> None:
    bag = write_strings(tmp_path / "a.mcap", [one["data"] for one in RIGHT])
    assert run_here("bag", "table", str(bag), "-o", str(tmp_path / "set"))[0] == 0
    file = next((tmp_path / "set").rglob("*.parquet"))
    codes = set()
    for wrong in damaged(file.read_bytes(), 29):
        file.write_bytes(wrong)
        code, _, err = run_here("bag", "sql", QUERY, str(tmp_path / "set"), "-f", "json")
        codes.add(code)
        if code:
            require_error_line(code, err)
    assert codes == {0, 1}


def test_skip_damaged_omits_undecodable_messages_in_table_and_sql(run_here: Any, tmp_path: Path) -> None:
    messages = [String(data=one["data"]).encode() for one in RIGHT]
    messages[2], messages[5] = messages[2][:-1], messages[5][:4] + struct.pack("<I", 1 << 31) + messages[5][8:]
    path = write_strings(tmp_path / "a.mcap", messages)
    for words in (("table", str(path), "-o", str(tmp_path / "none")), ("sql", QUERY, str(path))):
        code, _, err = run_here("bag", *words)
        require_error_line(code, err)
    kept = [one for one in RIGHT if one["log_time"] not in (2, 5)]
    out = tmp_path / "kept"
    assert run_here("bag", "table", str(path), "-o", str(out), "--skip-damaged")[1].startswith("6 messages of 1 topic")
    table = pq.read_table(next(out.rglob("*.parquet")), columns=["data"], partitioning=None)
    assert table.column("data").to_pylist() == [one["data"] for one in kept]
    code, output, err = run_here("bag", "sql", 'select data from "/s" order by log_time', str(path), "--skip-damaged")
    assert (code, output.split("\n")[:-1]) == (0, [one["data"] for one in kept]) and "skipped /s" in err


def bag_of(path: Path, *topics: str) -> str:
    with BagWriter(path) as made:
        for topic in topics:
            made.write(topic, String(data=topic), 1)
    return str(path)


def values_of(path: Path) -> str:
    with BagWriter(path) as made:
        made.write("/v", Values(d=math.nan, f=[math.inf, -math.inf, 0.5], s=HOSTILE, i=2**63 - 1), 1)
        made.write("/v", Values(d=1e300, s="a,\n"), 2)
    return str(path)


@pytest.mark.slow
def test_topics_may_be_named_like_duckdb_views_and_keywords(run_here: Any, tmp_path: Path) -> None:
    views = [one for (one,) in duckdb.connect().execute("select view_name from duckdb_views()").fetchall()]
    own = "topics main temp range read_csv select query base a.b a'b"
    names = [*dict.fromkeys([*views, "result of the query", *own.split()])]
    bag = bag_of(tmp_path / "a.mcap", *(f"/{name}" for name in names))
    for quote in "/ ":
        listed = [f'"{quote.strip()}{name}"' for name in names]
        query = "select data from (" + " union all ".join(f"select * from {one}" for one in listed) + ")"
        code, output, err = run_here("bag", "sql", query, bag)
        assert (code, err) == (0, "") and sorted(output.split("\n")[:-1]) == sorted(f"/{name}" for name in names)
    assert run_here("bag", "sql", "select '\"' || data from '/a.b'", bag) == (0, '"/a.b\n', "")
    code, _, err = run_here("bag", "sql", "select * from names", bag)
    assert code == 1 and "no topic names" in err, "variables of this package are no tables"


def test_sql_json_is_valid_and_output_has_no_control_characters(run_here: Any, tmp_path: Path) -> None:
    bag = values_of(tmp_path / "a.mcap")
    query = 'select d, f, s, i, {a: [-d]} as n, s as "\x1b[1mname" from v order by log_time'
    files = {form: str(tmp_path / f"out.{form}") for form in ("csv", "json", "parquet")}
    for arguments in ((), ("--format", "csv"), ("--json",)):
        code, output, err = run_here("bag", "sql", query, bag, *arguments)
        assert (code, err) == (0, "") and output.replace("\n", "").replace("\t", "").isprintable(), arguments
    first, second = map(json.loads, output.splitlines())
    right = {"d": "NaN", "f": ["Infinity", "-Infinity", 0.5], "s": HOSTILE, "i": 2**63 - 1, "n": {"a": ["NaN"]}}
    assert first == {**right, "\x1b[1mname": HOSTILE} and second["d"] == 1e300
    for file, option in zip(files.values(), ("-o", "--output", "--out"), strict=True):
        assert run_here("bag", "sql", query, bag, option, file) == (0, "", "")
    assert Path(files["json"]).read_text(encoding="utf-8") == output
    with open(files["csv"], encoding="utf-8", newline="") as stream:
        texts = [one["s"] for one in csv.DictReader(stream)]
    assert texts == [HOSTILE, "a,\n"] == pq.read_table(files["parquet"]).column("s").to_pylist(), "files are exact"


def test_query_may_be_first_or_last_argument(run_here: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    one, two, query = bag_of(Path("a b.mcap"), "/s"), bag_of(Path("two.mcap"), "/s"), "select count(*) from s"
    for words in ((query, one, two), (one, two, query), (query, "*.mcap"), ("*.mcap", query)):
        assert run_here("bag", "sql", *words) == (0, "2\n", ""), words
    for wrong in (("select 1",), (one,)):
        code, _, err = run_here("bag", "sql", *wrong)
        assert code == 2 and "expected a query and a bag" in err
    code, _, err = run_here("bag", "sql", query, one, "--json", "--format", "csv")
    assert code == 2 and "expected only one of --json and --format csv" in err


def test_show_tables_lists_the_topics(run_here: Any, tmp_path: Path) -> None:
    bag, out = bag_of(tmp_path / "a.mcap", "/s", "/a/b", "/tables"), str(tmp_path / "out")
    right = [f"{name}\tstd_msgs/msg/String\t1\n" for name in ("/a/b", "/s", "/tables")]
    assert run_here("bag", "sql", "show tables", bag) == (0, "".join(right), "")
    assert run_here("bag", "sql", "/* all */show\n-- of them\ntables; -- by name", bag) == (0, "".join(right), "")
    assert run_here("bag", "table", bag, "-o", out)[0] == 0
    assert run_here("bag", "sql", "SHOW ALL TABLES;", out) == (0, "".join(right), "")
    output = run_here("bag", "sql", "show tables", out, bag, "--json")[1]
    assert json.loads(output.splitlines()[0]) == {"name": "/a/b", "type": "std_msgs/msg/String", "messages": 2}
    with BagWriter(tmp_path / "none.mcap"):
        pass
    assert run_here("bag", "sql", "show tables", str(tmp_path / "none.mcap")) == (0, "", "")


def test_topic_longer_than_file_names_can_be_queried_but_not_written(run_here: Any, tmp_path: Path) -> None:
    long = "/robot" + "/segment_of_a_name" * 14
    bag, out = bag_of(tmp_path / "a.mcap", "/s", long), str(tmp_path / "out")
    assert run_here("bag", "sql", f'select data, bag from "{long}"', bag) == (0, f"{long}\ta\n", "")
    code, output, err = run_here("bag", "table", bag, "-o", out)
    assert (code, output) == (0, f"1 message of 1 topic in {out}\n")
    assert "the name of its folder would have 294 characters; expected at most 255" in err
    code, _, err = run_here("bag", "table", bag, "-o", out, "--overwrite", "--topics", long)
    assert code == 1 and "expected at most 255" in err


def test_unquoted_topic_name_error_explains_double_quotes(run_here: Any, tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "a.mcap", "/imu", "/a/imu")
    for name, near in (("/imu", ""), ("/a/imu", ""), ("a/imu", ""), ("/imi", '; did you mean "/imu"?')):
        code, output, err = run_here("bag", "sql", f"select * from {name} limit 5", bag)
        assert (code, output) == (1, "")
        assert err.endswith(f'; a topic with a slash needs double quotes: from "{name}"{near}\n'), err
    code, _, err = run_here("bag", "sql", "select 1 / 2 from imu where", bag)
    assert code == 1 and "double quotes" not in err


def test_file_names_may_contain_wildcards_and_colons(run_here: Any, tmp_path: Path) -> None:
    folder = tmp_path / "speed=3[a]*" / "drive::x"
    folder.mkdir(parents=True)
    bag, out = bag_of(folder / "a::b.mcap", "/s"), folder / "out::1"
    places = {"": (bag, str(out)), "file://": (f"file://{bag}", f"file://{folder}/out::2")}
    for prefix, (source, target) in places.items():
        assert run_here("bag", "table", source, "-o", target) == (0, f"1 message of 1 topic in {target}\n", "")
        assert Path(target.removeprefix("file://"), "topic=%2Fs", "bag=a%3A%3Ab").is_dir()
        assert run_here("bag", "sql", "select data, bag from s", source) == (0, "/s\ta::b\n", "")
        code, output, _ = run_here("bag", "info", source)
        assert code == 0 and "a::b.mcap" in output, prefix
    assert run_here("bag", "sql", "select * exclude (log_time, publish_time) from s", str(out)) == (0, "/s\ta::b\n", "")
    assert run_here("bag", "sql", "select data from s", f"{tmp_path}/speed*/drive::x/a::*.mcap") == (0, "/s\n", "")
    urls = "s3://b/a::b.mcap", "simplecache::s3://b", "zip://a::b", "zip://a::s3://b", "c://b", "/a/b://c", "a::b"
    assert [one for one in (*urls, "a b://c") if BagLocation(one).is_url] == [*urls[:4]]
    assert [one for one in (*urls, "a b://c") if BagLocation(one).has_colons_in_names] == [urls[0]]


def test_wide_rows_are_printed_one_field_per_line(capsys: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    monkeypatch.setenv("NO_COLOR", "1")
    rows = [["1", "x" * 30, "[b]\x1b"], ["22", "漢", ""]]
    monkeypatch.setenv("COLUMNS", "40")
    terminal_output.table(rows, "a", "bb", "[red]c", has_names=False)
    right = ["row 1", "  a       1", f"  bb      {'x' * 30}", "  [red]c  [b]\ufffd"]
    assert capsys.readouterr().out.split("\n") == [*right, "row 2", "  a       22", "  bb      漢", "  [red]c  ", ""]
    monkeypatch.setenv("COLUMNS", "44")
    terminal_output.table(rows, "a", "bb", "[red]c", has_names=False)
    shown = capsys.readouterr().out.splitlines()
    assert len(shown) == 4 and all(name in shown[0] for name in ("a", "bb", "[red]c"))
