"""``rosidl-py bag sql``: names of any kind, values of any kind, and the forms of its command line."""

from __future__ import annotations

import csv
import json
import math
import sys
from pathlib import Path
from typing import Any

import duckdb
import pyarrow.parquet as pq
import pytest

from rosidl_py_gen import compile_definition, get_message
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.bags.remote import has_colons_in_names, is_url
from rosidl_py_gen.ros_cli import terminal_output

String: Any = get_message("std_msgs/msg/String")
Values: Any = compile_definition("a_msgs/msg/Values", "float64 d\nfloat32[] f\nstring s\nint64 i")
HOSTILE = '\x1b]0;t\x07\x9b2J\u202e"NaN\\", Infinity'


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


def test_a_topic_may_have_a_name_that_duckdb_knows(run_here: Any, tmp_path: Path) -> None:
    views = [one for (one,) in duckdb.connect().execute("select view_name from duckdb_views()").fetchall()]
    own = [
        "result of the query",
        "topics",
        "main",
        "temp",
        "range",
        "read_csv",
        "select",
        "query",
        "base",
        "a.b",
        "a'b",
    ]
    names = [*dict.fromkeys([*views, *own])]
    bag = bag_of(tmp_path / "a.mcap", *(f"/{name}" for name in names))
    for quote in "/ ":
        listed = [f'"{quote.strip()}{name}"' for name in names]
        query = "select data from (" + " union all ".join(f"select * from {one}" for one in listed) + ")"
        code, said, err = run_here("bag", "sql", query, bag)
        assert (code, err) == (0, "") and sorted(said.split("\n")[:-1]) == sorted(f"/{name}" for name in names)
    assert run_here("bag", "sql", "select '\"' || data from '/a.b'", bag) == (0, '"/a.b\n', "")
    code, _, err = run_here("bag", "sql", "select * from names", bag)
    assert code == 1 and "no topic names" in err, "variables of this package are no tables"


def test_json_is_valid_and_no_output_steers_a_terminal(run_here: Any, tmp_path: Path) -> None:
    bag = values_of(tmp_path / "a.mcap")
    query = 'select d, f, s, i, {a: [-d]} as n, s as "\x1b[1mname" from v order by log_time'
    files = {form: str(tmp_path / f"out.{form}") for form in ("csv", "json", "parquet")}
    for arguments in ((), ("--format", "csv"), ("--json",)):
        code, said, err = run_here("bag", "sql", query, bag, *arguments)
        assert (code, err) == (0, "") and said.replace("\n", "").replace("\t", "").isprintable(), arguments
    first, second = map(json.loads, said.splitlines())
    right = {"d": "NaN", "f": ["Infinity", "-Infinity", 0.5], "s": HOSTILE, "i": 2**63 - 1, "n": {"a": ["NaN"]}}
    assert first == {**right, "\x1b[1mname": HOSTILE} and second["d"] == 1e300
    for file, option in zip(files.values(), ("-o", "--output", "--out"), strict=True):
        assert run_here("bag", "sql", query, bag, option, file) == (0, "", "")
    assert Path(files["json"]).read_text(encoding="utf-8") == said
    with open(files["csv"], encoding="utf-8", newline="") as stream:
        texts = [one["s"] for one in csv.DictReader(stream)]
    assert texts == [HOSTILE, "a,\n"] == pq.read_table(files["parquet"]).column("s").to_pylist(), "files are exact"


def test_the_query_may_come_first_or_last(run_here: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    said = run_here("bag", "sql", "show tables", out, bag, "--json")[1]
    assert json.loads(said.splitlines()[0]) == {"name": "/a/b", "type": "std_msgs/msg/String", "messages": 2}
    with BagWriter(tmp_path / "none.mcap"):
        pass
    assert run_here("bag", "sql", "show tables", str(tmp_path / "none.mcap")) == (0, "", "")


def test_a_topic_may_be_longer_than_names_of_files(run_here: Any, tmp_path: Path) -> None:
    long = "/robot" + "/segment_of_a_name" * 14
    bag, out = bag_of(tmp_path / "a.mcap", "/s", long), str(tmp_path / "out")
    assert run_here("bag", "sql", f'select data, bag from "{long}"', bag) == (0, f"{long}\ta\n", "")
    code, said, err = run_here("bag", "table", bag, "-o", out)
    assert (code, said) == (0, f"1 messages of 1 topics in {out}\n")
    assert "the name of its folder would have 294 characters; expected at most 255" in err
    code, _, err = run_here("bag", "table", bag, "-o", out, "--overwrite", "--topics", long)
    assert code == 1 and "expected at most 255" in err


def test_a_topic_without_quotes_is_explained_before_anything_is_read(run_here: Any, tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "a.mcap", "/imu", "/a/imu")
    for name, near in (("/imu", ""), ("/a/imu", ""), ("a/imu", ""), ("/imi", '; did you mean "/imu"?')):
        code, said, err = run_here("bag", "sql", f"select * from {name} limit 5", bag)
        assert (code, said) == (1, "")
        assert err.endswith(f'; a topic with a slash needs double quotes: from "{name}"{near}\n'), err
    code, _, err = run_here("bag", "sql", "select 1 / 2 from imu where", bag)
    assert code == 1 and "double quotes" not in err


def test_names_of_files_may_have_signs_that_fsspec_and_duckdb_read(run_here: Any, tmp_path: Path) -> None:
    folder = tmp_path / "speed=3[a]*" / "drive::x"
    folder.mkdir(parents=True)
    bag, out = bag_of(folder / "a::b.mcap", "/s"), folder / "out::1"
    places = {"": (bag, str(out)), "file://": (f"file://{bag}", f"file://{folder}/out::2")}
    for prefix, (source, target) in places.items():
        assert run_here("bag", "table", source, "-o", target) == (0, f"1 messages of 1 topics in {target}\n", "")
        assert Path(target.removeprefix("file://"), "topic=%2Fs", "bag=a%3A%3Ab").is_dir()
        assert run_here("bag", "sql", "select data, bag from s", source) == (0, "/s\ta::b\n", "")
        code, said, _ = run_here("bag", "info", source)
        assert code == 0 and "a::b.mcap" in said, prefix
    assert run_here("bag", "sql", "select * exclude (log_time, publish_time) from s", str(out)) == (0, "/s\ta::b\n", "")
    assert run_here("bag", "sql", "select data from s", f"{tmp_path}/speed*/drive::x/a::*.mcap") == (0, "/s\n", "")
    urls = (
        "s3://b/a::b.mcap",
        "simplecache::s3://b",
        "zip://a::b",
        "zip://a::s3://b",
        "c://b",
        "/a/b://c",
        "a::b",
        "a b://c",
    )
    assert [one for one in urls if is_url(one)] == [*urls[:4]]
    assert [one for one in urls if has_colons_in_names(one)] == [urls[0]]


def test_rows_wider_than_the_terminal_are_a_line_for_each_field(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
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
