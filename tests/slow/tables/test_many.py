"""Datasets of many bags, written by this process: repeated runs, failures, file systems."""

from __future__ import annotations

import os
import sys
import warnings
from itertools import pairwise
from pathlib import Path
from typing import Any

import fsspec
import polars as pl
import pyarrow.parquet as pq
import pytest
from std_msgs.msg import Int64, String
from support.bag_datasets import bag_of, rows, said

from rosidl_py_gen.bags import BagError, BagReader, BagWarning, BagWriter, writer
from rosidl_py_gen.tables import bag_tasks, multi_bag, write_dataset, write_datasets
from rosidl_py_gen.tables.bag_tasks import run_task
from rosidl_py_gen.tables.multi_bag import names_of
from rosidl_py_gen.tables.query import Database


def stamps(out: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}


def test_second_run_converts_only_new_changed_and_missing_bags(tmp_path: Path) -> None:
    out = tmp_path / "out"
    bags = [bag_of(tmp_path / f"{name}.mcap", 1, 2, text="old") for name in "ab"]
    assert said(write_datasets(bags, out)) == (["a", "b"], [], [])
    before = stamps(out)
    assert said(write_datasets(bags, out)) == ([], ["a", "b"], [])
    assert stamps(out) == before
    bag_of(bags[1], 3, 4, 5)
    assert said(write_datasets(bags, out)) == (["b"], ["a"], [])
    assert rows(out) == [("a", 1), ("a", 2), ("b", 3), ("b", 4), ("b", 5)]
    assert rows(out, "s") == [("a", "old")], "files of topics that the bag lacks now are removed"
    assert {key: value for key, value in stamps(out).items() if "bag=a" in key} == {
        key: value for key, value in before.items() if "bag=a" in key
    }
    (out / "topic=%2Fn/bag=a").joinpath(os.listdir(out / "topic=%2Fn/bag=a")[0]).unlink()
    assert said(write_datasets(bags, out)) == (["a"], ["b"], []), "a removed file is converted again"
    assert said(write_datasets([*bags, bag_of(tmp_path / "c.mcap", 6)], out)) == (["c"], ["a", "b"], [])
    frame = pl.scan_parquet(f"{out}/topic=*n/**/*.parquet", hive_partitioning=True).collect()
    assert sorted(frame["bag"].to_list()) == ["a", "a", "b", "b", "b", "c"]


def test_changed_modification_time_alone_converts_a_bag_again(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "a.mcap", 1)
    write_datasets([bag], tmp_path / "out")
    before = bag.stat()
    os.utime(bag, ns=(before.st_atime_ns, before.st_mtime_ns + 1_000_000_000))
    assert said(write_datasets([bag], tmp_path / "out")) == (["a"], [], [])


def test_failed_bags_are_reported_with_reason_and_others_are_converted(tmp_path: Path) -> None:
    out = tmp_path / "out"
    good = [bag_of(tmp_path / "a.mcap", 1), bag_of(tmp_path / "z.mcap", 2)]
    (tmp_path / "cut.mcap").write_bytes(good[0].read_bytes()[:200])
    (tmp_path / "junk.mcap").write_bytes(b"junk" * 100)
    (tmp_path / "text.txt").write_text("no bag")
    (tmp_path / "empty").mkdir()
    with BagWriter(tmp_path / "broken.mcap") as made:
        made.add_topic("/s", String)
        made.write("/s", String(data="x").encode()[:9], 7)
    wrong = [tmp_path / name for name in ("cut.mcap", "junk.mcap", "text.txt", "empty", "broken.mcap", "gone.mcap")]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BagWarning)
        report = write_datasets([good[0], *wrong, good[1]], out)
    assert sorted(report.files) == ["a", "z"] and rows(out) == [("a", 1), ("z", 2)]
    told = {Path(place).name: reason for place, reason in report.failed.items()}
    assert told.keys() >= {"junk.mcap", "text.txt", "empty", "broken.mcap", "gone.mcap"}
    assert (
        "does not begin with the magic bytes of MCAP" in told["junk.mcap"]
        and "expected .mcap, .db3" in told["text.txt"]
    )
    assert "broken.mcap: /s at 7 ns: std_msgs/msg/String.data" in told["broken.mcap"]
    assert told["gone.mcap"].endswith("gone.mcap: there is no such bag") and "has no files" in told["empty"]
    assert not list(out.rglob("*broken*.parquet")) and not list(out.rglob("*.partial"))
    bag_of(tmp_path / "gone.mcap", 3)
    report = write_datasets([*good, tmp_path / "gone.mcap"], out)
    assert said(report) == (["gone"], ["a", "z"], [])


def test_internal_error_for_one_bag_does_not_stop_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bags = [bag_of(tmp_path / f"{name}.mcap", 1) for name in "ab"]
    real = bag_tasks.BagReader

    def reader(path: str, **options: Any) -> BagReader:
        if path.endswith("a.mcap"):
            raise KeyError("a bug")
        return real(path, **options)

    monkeypatch.setattr(bag_tasks, "BagReader", reader)
    report = write_datasets(bags, tmp_path / "out")
    assert said(report) == (["b"], [], [str(bags[0])])
    assert report.failed[str(bags[0])] == f"{bags[0]}: KeyError: 'a bug'"


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_large_bag_is_split_into_tasks_with_each_message_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: str
) -> None:
    monkeypatch.setattr(multi_bag, "RANGE_BYTES", 2000)
    monkeypatch.setattr(writer, "CHUNK_BYTES", 1 << 12)
    numbers = [*range(3000)]
    bag = bag_of(tmp_path / "a.mcap", *numbers, compression=compression)
    report = write_datasets([bag, bag_of(tmp_path / "b.mcap", 7)], tmp_path / "out")
    names = [Path(one.path).name for one in report.files["a"]]
    assert len(names) > 5 and names[1].endswith("-0001.parquet")
    assert rows(tmp_path / "out") == [("a", number) for number in numbers] + [("b", 7)]
    times = [pq.read_table(one.path).column("log_time") for one in report.files["a"]]
    assert all(one[len(one) - 1].value < other[0].value for one, other in pairwise(times))
    os.remove(report.files["a"][2].path)
    again = write_datasets([bag, tmp_path / "b.mcap"], tmp_path / "out")
    assert [Path(one.path).name for one in again.files["a"]] == [names[2]], "only the part that is missing"
    assert again.unchanged == ["b"]
    part = write_datasets([bag], tmp_path / "part", start_offset_s=5e-6, duration_s=1e-5)
    assert [value for _, value in rows(tmp_path / "part")] == [*range(500, 1500)] and len(part.files["a"]) > 1


def test_overlapping_chunks_are_split_by_time_without_loss(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multi_bag, "RANGE_BYTES", 2000)
    monkeypatch.setattr(writer, "CHUNK_BYTES", 1 << 12)
    with BagWriter(tmp_path / "a.mcap") as made:
        for number in range(2000):
            made.write("/n", Int64(data=number), (number * 7919) % 500)
    report = write_datasets([tmp_path / "a.mcap"], tmp_path / "out")
    assert sorted(value for _, value in rows(tmp_path / "out")) == [*range(2000)] and not report.failed


def test_an_interrupted_bag_is_written_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupted before the first file gets its name, and between two files."""
    bag, out = bag_of(tmp_path / "a.mcap", 1, 2, text="x"), tmp_path / "out"
    real = os.replace

    class Killed(BaseException):
        pass

    for count in (0, 1):

        def replace(source: str, target: str, count: int = count) -> None:
            if len(list(out.rglob("*.parquet"))) >= count:
                raise Killed
            real(source, target)

        with monkeypatch.context() as patch, pytest.raises(Killed):
            patch.setattr(os, "replace", replace)
            write_datasets([bag], out)
        assert len(list(out.rglob("*.parquet"))) == count
    (out / "topic=%2Fn" / "bag=a" / "x.parquet.0123.partial").write_bytes(b"left by a process that was killed")
    assert said(write_datasets([bag], out)) == (["a"], [], [])
    assert rows(out) == [("a", 1), ("a", 2)] and rows(out, "s") == [("a", "x")]
    assert not list(out.rglob("*.partial"))
    assert said(write_datasets([bag], out)) == ([], ["a"], [])


def test_bag_without_messages_is_unchanged_in_each_run(tmp_path: Path) -> None:
    bags = [bag_of(tmp_path / "a.mcap", 1), bag_of(tmp_path / "empty.mcap")]
    assert said(write_datasets(bags, tmp_path / "out")) == (["a"], ["empty"], [])
    assert said(write_datasets(bags, tmp_path / "out")) == ([], ["a", "empty"], [])


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are texts")
def test_bag_name_that_is_not_utf8_is_an_error(tmp_path: Path) -> None:
    name = os.fsdecode(b"\xff.mcap")
    bag_of(tmp_path / "a.mcap", 1).rename(tmp_path / name)
    with pytest.raises(BagError, match="UnicodeEncodeError"):
        write_datasets([tmp_path / name], tmp_path / "out")


@pytest.mark.parametrize(
    "damage", ["empty", "cut", "without metadata", "invalid metadata", "other keys", "other types"]
)
def test_a_file_without_a_valid_record_is_not_replaced(tmp_path: Path, damage: str) -> None:
    bag, out = bag_of(tmp_path / "a.mcap", 1), tmp_path / "out"
    write_datasets([bag], out)
    (file,) = out.rglob("*.parquet")
    table = pq.read_table(file, partitioning=None)
    if damage in ("empty", "cut"):
        file.write_bytes(b"" if damage == "empty" else file.read_bytes()[:-30])
    else:
        types = '{"bag": [1], "version": "", "options": ""}'
        text = {"invalid metadata": "[", "other keys": '{"x": 1}', "other types": types}.get(damage)
        pq.write_table(table.replace_schema_metadata({"rosidl_py_gen.task": text} if text else {}), file)
    report = write_datasets([bag], out)
    assert said(report) == ([], [], [str(bag)]) and "exists already" in report.failed[str(bag)]
    assert said(write_datasets([bag], out, overwrite=True)) == (["a"], [], [])
    assert rows(out) == [("a", 1)] and said(write_datasets([bag], out)) == ([], ["a"], [])


def test_a_part_without_messages_is_complete(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multi_bag, "RANGE_BYTES", 2000)
    monkeypatch.setattr(writer, "CHUNK_BYTES", 1 << 12)
    bag, out = bag_of(tmp_path / "a.mcap", *range(3000), text="x"), tmp_path / "out"
    assert len(write_datasets([bag], out, topics=["/s"]).files["a"]) == 1
    assert said(write_datasets([bag], out, topics=["/s"])) == ([], ["a"], [])
    assert rows(out, "s") == [("a", "x")]


def test_dataset_files_of_other_origin_are_kept_unless_overwrite_is_set(tmp_path: Path) -> None:
    bag, out = bag_of(tmp_path / "a.mcap", 1), tmp_path / "out"
    with BagReader(bag) as reader:
        write_dataset(reader, out)
    report = write_datasets([bag], out)
    assert said(report) == ([], [], [str(bag)]) and "exists already" in report.failed[str(bag)]
    assert said(write_datasets([bag], out, overwrite=True)) == (["a"], [], [])
    (tmp_path / "other").mkdir()
    other = bag_of(tmp_path / "other" / "a.mcap", 2)
    assert said(write_datasets([other], out)) == (["other/a"], [], []), "a bag keeps its name, and no other gets it"
    assert said(write_datasets([other, bag], out)) == ([], ["a", "other/a"], [])
    assert rows(out) == [("a", 1), ("other%2Fa", 2)]


def test_conversions_with_different_options_are_different_tasks(tmp_path: Path) -> None:
    bag, out = bag_of(tmp_path / "a.mcap", 1, 2, text="x"), tmp_path / "out"
    assert len(write_datasets([bag], out, topics=["/n"]).files["a"]) == 1
    assert len(write_datasets([bag], out, topics=["/s"]).files["a"]) == 1
    assert said(write_datasets([bag], out, topics=["/n"])) == ([], ["a"], [])
    short = write_datasets([bag], out, topics=["/n"], duration_s=1e-8)
    assert "exists already" in short.failed[str(bag)]
    write_datasets([bag], out, topics=["/n"], duration_s=1e-8, overwrite=True)
    assert rows(out) == [("a", 1)]
    assert said(write_datasets([bag], out, topics=["/n"], overwrite=True)) == (["a"], [], [])
    again = write_datasets([bag], out, topics=["/n"], search_path=[str(tmp_path)])
    assert "exists already" in again.failed[str(bag)], "other definitions may make something else of it"
    report = write_datasets([bag], tmp_path / "new", topics=["/nn"])
    assert 'has no topic /nn; did you mean "/n"?' in report.failed[str(bag)]
    assert "begins after its end" in write_datasets([bag], out, start_offset_s=9).failed[str(bag)]


def test_memory_file_system_may_contain_bags_and_datasets(tmp_path: Path) -> None:
    system = fsspec.filesystem("memory")
    for name, numbers in {"a": (1, 2), "b": (3,)}.items():
        system.pipe(f"/many/{name}.mcap", bag_of(tmp_path / f"{name}.mcap", *numbers).read_bytes())
    system.pipe("/many/c.mcap", b"junk" * 50)
    bag_of(tmp_path / "folder", 4)
    system.put(str(tmp_path / "folder"), "/many/folder", recursive=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = write_datasets(
            ["memory://many/*.mcap", "memory://many/folder", "memory://none/*"], "memory://many/out"
        )
    assert said(report) == (["a", "b", "folder"], [], ["memory://many/c.mcap", "memory://none/*"])
    assert report.failed["memory://none/*"] == "memory://none/*: no bag matches"
    assert rows("memory://many/out") == [("a", 1), ("a", 2), ("b", 3), ("folder", 4)]
    again = write_datasets(["memory://many/*.mcap", "memory://many/folder"], "memory://many/out")
    assert said(again) == ([], ["a", "b", "folder"], ["memory://many/c.mcap"])
    sources = Database.find_sources(["memory://many/out", "memory://many/a.mcap"])
    assert sources == ({"a": "memory://many/a.mcap"}, ["memory://many/out"])
    with Database() as base, BagReader("memory://many/a.mcap") as bag:
        query = "select bag, count(*) from n group by bag order by bag"
        base.add(query, {"again": bag}, ["memory://many/out"])
        assert [*base.run(query).rows()] == [["a", "2"], ["again", "2"], ["b", "1"], ["folder", "1"]]
    # A file that fails leaves no partial output.
    with BagWriter(tmp_path / "broken.mcap") as made:
        made.add_topic("/s", String)
        made.write("/n", Int64(data=1), 1)
        made.write("/s", String(data="x").encode()[:9], 7)
    system.pipe("/many/broken.mcap", (tmp_path / "broken.mcap").read_bytes())
    assert (
        "at 7 ns"
        in write_datasets(["memory://many/broken.mcap"], "memory://many/out").failed["memory://many/broken.mcap"]
    )
    assert not system.glob("/many/out/*/bag=broken/*")


def test_databases_and_compressed_files_at_urls_are_converted(tmp_path: Path) -> None:
    from zstandard import compress

    from rosidl_py_gen.bags import SqliteWriter

    source = bag_of(tmp_path / "b.mcap", 6)
    with SqliteWriter(tmp_path / "base") as made:
        made.add_topic("/n", BagReader(source).channels[0])
        made.write("/n", Int64(data=5).encode(), 1)
    (base,) = (tmp_path / "base").glob("*.db3")
    system = fsspec.filesystem("memory")
    system.pipe("/copied/a.db3", base.read_bytes())
    system.pipe("/copied/b.mcap.zstd", compress(source.read_bytes()))
    report = write_datasets(["memory://copied/a.db3", "memory://copied/*.zstd"], tmp_path / "out")
    assert not report.failed and rows(tmp_path / "out") == [("a", 5), ("b", 6)]


@pytest.mark.parametrize("url", ["nope://x/a.mcap", "memory://not/there.mcap", "memory://not/*.mcap"])
def test_invalid_or_missing_url_is_reported_as_an_error(tmp_path: Path, url: str) -> None:
    report = write_datasets([url], tmp_path / "out")
    assert list(report.failed) == [url] and url in report.failed[url]
    with pytest.raises((BagError, OSError)):
        BagReader(url)
    with pytest.raises(BagError, match="nope"):
        write_datasets([], "nope://x/out")


def test_timeout_of_a_file_system_is_not_reported_as_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from fsspec.implementations.memory import MemoryFile

    fsspec.filesystem("memory").pipe("/far/a.mcap", bag_of(tmp_path / "a.mcap", *range(1000)).read_bytes())

    def read(self: Any, size: int = -1) -> bytes:
        raise TimeoutError("nobody there")

    monkeypatch.setattr(MemoryFile, "read", read, raising=False)
    with pytest.raises(BagError, match=r"memory://far/a.mcap: TimeoutError: nobody there"):
        BagReader("memory://far/a.mcap")


def test_task_that_runs_twice_writes_its_rows_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag, out = bag_of(tmp_path / "a.mcap", 1, 2), tmp_path / "out"
    found: list[Any] = []

    def run_twice(task: Any, **options: Any) -> Any:
        found[:] = [run_task(task, **options) for _ in range(2)]
        return found[0]

    monkeypatch.setattr(multi_bag, "run_task", run_twice)
    write_datasets([bag], out)
    assert [one.error for one in found] == ["", ""] and found[0].files == found[1].files
    assert rows(out) == [("a", 1), ("a", 2)]


def test_progress_reports_converted_bags_and_fractions_in_order(tmp_path: Path) -> None:
    bags = [bag_of(tmp_path / f"{name}.mcap", *range(50), text="x") for name in "ab"]
    seen: list[tuple[float, int]] = []
    write_datasets(bags, tmp_path / "out", progress=lambda *told: seen.append(told))
    assert seen[0] == (0, 2) and seen[-1] == (2, 2) and seen == sorted(seen)
    assert any(0 < one < 1 for one, _ in seen) and any(1 < one < 2 for one, _ in seen), "within a bag too"


def test_dataset_names_are_unique_and_known_names_are_kept() -> None:
    assert names_of(["a/x.mcap", "y", "a/x.mcap", "/x.db3.zstd"]) == {"a/x": "a/x.mcap", "y": "y", "x": "/x.db3.zstd"}
    assert names_of(["s3://b/x.mcap", "/d/x.mcap"]) == {"b/x": "s3://b/x.mcap", "d/x": "/d/x.mcap"}
    known = {"/d/x.mcap": "x"}
    assert names_of(["/e/x.mcap", "/d/x.mcap"], known) == {"e/x": "/e/x.mcap", "x": "/d/x.mcap"}
    assert names_of(["/x.mcap"], {"/y": "x"}) == names_of(["/x.mcap"], {}, {"x"}) == {"/x.mcap": "/x.mcap"}


def test_options_scheduler_and_workers_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="either scheduler or workers"):
        write_datasets([], tmp_path, scheduler="tcp://x", workers=2)
