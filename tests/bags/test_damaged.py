"""Damaged files: right data or our error, soon, and without much memory."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import struct
import warnings
from pathlib import Path
from typing import Any

import pytest
from support.bag_samples import memory_limit, require_error
from zstandard import ZstdCompressor

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader, BagWarning, BagWriter, SqliteWriter
from rosidl_py_gen.bags.common import BagTopic
from rosidl_py_gen.bags.metadata import qos_profiles
from rosidl_py_gen.bags.reindexing import reindex_folder
from rosidl_py_gen.bags.storage.mcap_file import McapFile

pytestmark = pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")  # what is damaged is left out
Bool: Any = get_message("std_msgs/msg/Bool")
String: Any = get_message("std_msgs/msg/String")


RIGHT = [("/a", Bool(data=True), number, number) for number in range(3)]


def read(path: Path) -> list[Any]:
    with BagReader(path) as reader:
        return list(reader)


@pytest.mark.parametrize("has_index", [True, False])
def test_a_chunk_that_becomes_too_large_is_refused(tmp_path: Path, has_index: bool) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path, compression="zstd") as writer:
        writer.write("/a", String(data="a" * 100_000), 0)
    if not has_index:
        path.write_bytes(path.read_bytes()[:-60])
    with BagReader(path, max_decompressed_bytes=101_000) as reader:
        assert [len(one.message.data) for one in reader] == [100_000]
    told = r"a chunk of \d+ bytes states 1\d{5} bytes; expected at most 10000, unless max_decompressed_bytes is more"
    require_error(path, told, max_decompressed_bytes=10_000)


def test_an_index_that_names_a_chunk_many_times_is_not_used(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        for topic, message, log_time, _ in RIGHT:
            writer.write(topic, message, log_time)
    data = path.read_bytes()
    at = struct.unpack_from("<Q", data, len(data) - 28)[0]
    while data[at] != 8:  # a chunk's row of the index
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    end = at + 9 + struct.unpack_from("<Q", data, at + 1)[0]
    no_checksum = bytes(4)
    path.write_bytes(data[:end] + data[at:end] * 9 + data[end:-12] + no_checksum + data[-8:])
    with BagReader(path) as reader:
        assert (list(reader), reader.has_index) == (RIGHT, False)


@pytest.mark.parametrize(("start", "checksum"), [(0, 0), (0, 1), (8, 1)])
def test_looking_for_an_index_takes_little_memory(tmp_path: Path, start: int, checksum: int) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        stream.write(b"\x89MCAP0\r\n")
        stream.seek(1 << 25)
        stream.write(struct.pack("<BQQQI", 2, 20, start, 0, checksum) + b"\x89MCAP0\r\n")
    with memory_limit(1 << 23):
        file = McapFile(path, True)
    file.close()
    assert not file.is_whole


def test_what_breaks_off_says_how_much_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        for number in range(3):
            writer.write("/a", Bool(data=True), number)
    data = path.read_bytes()
    begin = len(b"\x89MCAP0\r\n")
    while data[begin] != 6:  # a chunk
        begin += 9 + struct.unpack_from("<Q", data, begin + 1)[0]
    after = begin + 9 + struct.unpack_from("<Q", data, begin + 1)[0]
    cut = tmp_path / "b.mcap"
    for end in range(begin + 1, after):
        cut.write_bytes(data[:end])
        with pytest.warns(BagWarning, match=f"b.mcap breaks off within a record; its last {end - begin} bytes"):
            assert (len(read(cut)), BagReader(cut).unread_bytes) == (0, end - begin)
    for end in (begin, *range(after, len(data))):  # only of the index something is missing
        cut.write_bytes(data[:end])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert len(read(cut)) == (0 if end == begin else 3)


@pytest.mark.parametrize(
    ("script", "said"),
    [
        (
            "drop table messages; create view messages as with recursive n(i) as "
            "(select 1 union all select i + 1 from n limit 9) select i id, 1 topic_id, i timestamp, x'00' data from n;",
            "messages is a view or virtual table",
        ),
        (
            "drop table Topics; create view Topics as "
            "select 1 id, '/s' name, 'std_msgs/msg/Bool' type, 'cdr' serialization_format;",
            "topics is a view or virtual table",
        ),
        (
            "drop table messages; create table messages(id integer primary key, topic_id integer, timestamp integer, "
            "data blob generated always as (zeroblob(1000)));",
            "messages has generated columns",
        ),
        (
            "drop table topics; create table topics(id integer primary key, name text, type text as ('a'), "
            "serialization_format text);",
            "topics has generated columns",
        ),
        (
            "drop table messages; create virtual table messages using fts5(id, topic_id, timestamp, data);",
            "messages is a view or virtual table",
        ),
    ],
    ids=["view of messages", "view of topics", "column of data", "column of topics", "virtual table"],
)
def test_a_database_that_computes_its_rows_is_refused(tmp_path: Path, script: str, said: str) -> None:
    with SqliteWriter(tmp_path / "bag") as writer:
        writer.add_topic("/s", BagTopic("/s", "std_msgs/msg/Bool"))
        writer.write("/s", b"\0\1\0\0\1", 1)
    path = tmp_path / "bag" / "bag_0.db3"
    assert len(read(path)) == 1
    base = sqlite3.connect(path)
    base.executescript(script)
    base.close()
    require_error(path, said)


BOMB = "a0: &a0 [x, x]\n" + "".join(f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]\n" for n in range(1, 30))
MERGED = "a0: &a0 {k: 1}\n" + "".join(f"a{n}: &a{n} {{<<: [*a{n - 1}, *a{n - 1}]}}\n" for n in range(1, 30))


def told(**wrong: str) -> str:
    """A metadata file with wrong values."""
    right = {"files": "[a.mcap]", "storage": "mcap", "topic": "/a", "count": "1", "qos": '""'}
    return (
        "rosbag2_bagfile_information: {{relative_file_paths: {files}, storage_identifier: {storage}, "
        "topics_with_message_count: [{{message_count: {count}, topic_metadata: {{name: {topic}, type: a/msg/B, "
        "serialization_format: cdr, offered_qos_profiles: {qos}}}}}]}}"
    ).format(**(right | wrong))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "not in the format of rosbag2: .*; recreate it with `rosidl-py bag reindex`"),
        ("{", "not YAML: "),
        ("rosbag2_bagfile_information: 3", "not in the format of rosbag2"),
        ("rosbag2_bagfile_information: {relative_file_paths: [a.mcap]}", "KeyError 'storage_identifier'"),
        ("a: !!int ''", "not YAML: "),
        ("a: !!bool x", "not YAML: "),
        ("a: !!timestamp x", "not YAML: "),
        (
            "[" * 200_000,
            "not YAML: .*(more than 100 levels|exceeded maximum nesting depth)",
        ),  # the latter: libyaml 0.2.6
        (told(qos="[" * 900 + "]" * 900), "not YAML: .*more than 100 levels"),
        (MERGED, "not YAML: "),
        (told(count=".inf"), "OverflowError"),
        (BOMB + told(files="[*a29]"), "more than 1000000 values, aliases written out"),
        (BOMB + told(topic="*a29"), "more than 1000000 values, aliases written out"),
        (BOMB + told(storage="*a29"), "more than 1000000 values, aliases written out"),
        (told(files='["a\\0.mcap"]'), "a file name with a zero byte"),
        ("a: &a [x, x]\nb: &b [*a, *a]\nrosbag2_bagfile_information: [*b, *b]", "not in the format of rosbag2"),
    ],
)
@pytest.mark.usefixtures("little_memory")
def test_metadata_that_is_none_is_told(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "metadata.yaml").write_text(text)
    require_error(tmp_path, said)


@pytest.mark.parametrize(
    "text",
    [
        "!!int ''",
        "[" * 200_000,
        MERGED,
        "- {history: [&a0 [x, x], " + ", ".join(f"&a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 30)) + "]}",
        "- {history: 1, reliability: 1, durability: 1, liveliness: 1, deadline: {sec: .inf, nsec: 0}}",
    ],
    ids=["int", "deep", "merged", "bomb", "infinity"],
)
@pytest.mark.usefixtures("little_memory")
def test_qos_that_is_none_gives_no_profiles(text: str) -> None:
    assert qos_profiles(text) == []


def test_metadata_does_not_lead_out_of_its_folder(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "secret.mcap") as writer:
        writer.write("/s", Bool())
    bag = tmp_path / "bag"
    bag.mkdir()
    text = "rosbag2_bagfile_information: {relative_file_paths: [../secret.mcap], storage_identifier: mcap}"
    (bag / "metadata.yaml").write_text(text)
    require_error(bag, r"bag.metadata\.yaml refers to secret\.mcap, which does not exist$")


# ------------------------------------------------------------------------------------------------- killed recorders


@pytest.mark.parametrize("writer", [BagWriter, SqliteWriter])
def test_a_recorder_killed_while_it_compresses_a_file_leaves_every_message_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, writer: Any
) -> None:
    class Killed(BaseException): ...

    for step in ("fsync", "replace", "unlink"):
        folder = tmp_path / step
        with monkeypatch.context() as patch, contextlib.suppress(Killed):
            bag = writer(folder, compression_mode="file", split_bytes=1)
            bag.add_topic("/a", BagTopic("/a", "std_msgs/msg/Bool", "bool data"))
            for number in range(3):
                if number == 2:  # the second file is compressed now
                    patch.setattr(Path, "unlink", raising(Killed))  # a killed process tidies nothing
                    patch.setattr(os if step == "fsync" else Path, step, raising(Killed))
                bag.write("/a", Bool(data=True).encode(), number)
        with BagReader(folder) as reader:
            assert [one.log_time for one in reader.messages(raw=True)] == [0, 1], step
        done = reindex_folder(folder)
        assert (done.messages, done.files) == (2, 2), step
        with BagReader(folder) as reader:
            assert [one.log_time for one in reader.messages(raw=True)] == [0, 1], step
            assert all(file.suffix == ".zstd" for file in reader.files), step


def raising(error: type[BaseException]) -> Any:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    return fail


@pytest.mark.parametrize("writer", [BagWriter, SqliteWriter])
def test_of_a_plain_file_and_its_compressed_form_the_complete_one_is_read(tmp_path: Path, writer: Any) -> None:
    folder = tmp_path / "bag"
    with writer(folder) as bag:
        bag.add_topic("/a", BagTopic("/a", "std_msgs/msg/Bool", "bool data"))
        for number in range(3):
            bag.write("/a", Bool(data=True).encode(), number)
    (folder / "metadata.yaml").unlink()
    (plain,) = folder.iterdir()
    packed = plain.with_name(plain.name + ".zstd")
    data, compressed = plain.read_bytes(), ZstdCompressor().compress(plain.read_bytes())
    for whole, part in ((data, compressed), (data, compressed[:-50]), (data[:-50], compressed), (b"", compressed)):
        plain.write_bytes(whole)
        packed.write_bytes(part)
        with BagReader(folder) as reader:
            assert [one.log_time for one in reader.messages(raw=True)] == [0, 1, 2]
            assert reader.files == [plain if whole == data else packed]


def test_files_are_on_the_disk_before_they_get_their_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[tuple[str, str]] = []
    sync, replace = os.fsync, Path.replace

    def note_sync(descriptor: int) -> None:
        steps.append(("sync", Path(f"/proc/self/fd/{descriptor}").resolve().name))
        sync(descriptor)

    def note_rename(self: Path, target: Path) -> Path:
        steps.append(("rename", target.name))
        return replace(self, target)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(Path, "replace", note_rename)
    with BagWriter(tmp_path / "bag", compression_mode="file") as bag:
        bag.write("/s", get_message("std_msgs/msg/String")(data="x"), log_time_ns=1)
    for name in ("bag_0.mcap.zstd", "metadata.yaml"):
        at = steps.index(("rename", name))
        assert steps[at - 1 : at + 2] == [("sync", f".{name}"), ("rename", name), ("sync", "bag")]
