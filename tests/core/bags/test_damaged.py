"""Damaged files yield correct data or our error, in bounded time and memory; losses are reported.

Full versions: `tests/support/bag_damage.py`; any damage of any bag: `tests/slow/bags/test_damage_machine.py`.
"""

from __future__ import annotations

import contextlib
import os
import re
import sqlite3
import struct
import time
import warnings
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import CompressionType, IndexType, Writer
from support.bag_damage import COUNT, String, blocks, chunks, kills, recording, text, zeroed_chunk
from support.bag_samples import STRING, memory_limit, require_error, write_foreign
from zstandard import ZstdCompressor

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagError, BagReader, BagWarning, BagWriter, SqliteWriter
from rosidl_py_gen.bags.common import BagTopic
from rosidl_py_gen.bags.metadata import OfferedQoS
from rosidl_py_gen.bags.rewriting import reindex
from rosidl_py_gen.bags.storage.mcap_file import McapFile

pytestmark = pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")  # damaged messages are skipped
Bool: Any = get_message("std_msgs/msg/Bool")


RIGHT = [("/a", Bool(data=True), number, number) for number in range(3)]


def read(path: Path) -> list[Any]:
    with BagReader(path) as reader:
        return list(reader)


@pytest.mark.parametrize("has_index", [True, False])
def test_chunk_that_decompresses_beyond_the_limit_is_refused(tmp_path: Path, has_index: bool) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path, compression="zstd") as writer:
        writer.write("/a", String(data="a" * 100_000), 0)
    if not has_index:
        path.write_bytes(path.read_bytes()[:-60])
    with BagReader(path, max_decompressed_bytes=101_000) as reader:
        assert [len(one.message.data) for one in reader] == [100_000]
    limit = r"a chunk of \d+ bytes states 1\d{5} bytes; expected at most 10000, unless max_decompressed_bytes is more"
    for skip_damaged in (False, True):  # it is not damaged
        require_error(path, limit, max_decompressed_bytes=10_000, skip_damaged=skip_damaged)


def test_compressed_message_without_stated_size_is_read_with_little_memory(tmp_path: Path) -> None:
    with SqliteWriter(tmp_path / "bag", compression_mode="message") as writer:
        writer.add_topic("/a", BagTopic("/a", *STRING))
        writer.write("/a", b"", 1)
    data = ZstdCompressor(write_content_size=False).compress(String(data="a").encode())
    with contextlib.closing(sqlite3.connect(tmp_path / "bag" / "bag_0.db3", isolation_level=None)) as base:
        base.execute("update messages set data = ?", (data,))
    with memory_limit(1 << 27):  # not the gigabyte that a message may have
        assert [one.message.data for one in read(tmp_path / "bag")] == ["a"]


def test_index_that_lists_a_chunk_repeatedly_is_not_used(tmp_path: Path) -> None:
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
def test_search_for_an_index_uses_little_memory(tmp_path: Path, start: int, checksum: int) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        stream.write(b"\x89MCAP0\r\n")
        stream.seek(1 << 25)
        stream.write(struct.pack("<BQQQI", 2, 20, start, 0, checksum) + b"\x89MCAP0\r\n")
    with memory_limit(1 << 23):
        file = McapFile(path, True)
    file.close()
    assert not file.is_whole


@pytest.mark.slow
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
            assert len(read(cut)) == 0
            with BagReader(cut) as reader:
                assert reader.unread_bytes == end - begin
    metadata = after
    while data[metadata] != 12:
        metadata += 9 + struct.unpack_from("<Q", data, metadata + 1)[0]
    name_end = metadata + 9 + len(b"\x07\0\0\0rosbag2")
    for end in range(metadata + 1, name_end):  # it may be a metadata record of the user
        cut.write_bytes(data[:end])
        with pytest.warns(BagWarning, match=f"its last {end - metadata} bytes are lost"):
            assert len(read(cut)) == 3
    for end in (begin, *range(after, metadata + 1), *range(name_end, len(data))):  # only records of the index are cut
        cut.write_bytes(data[:end])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert len(read(cut)) == (0 if end == begin else 3)


@pytest.mark.parametrize(
    ("script", "error_text"),
    [
        (
            "drop table messages; create view Messages as with recursive n(i) as "
            "(select 1 union all select i + 1 from n limit 9) select i id, 1 topic_id, i timestamp, x'00' data from n;",
            "messages is a view or virtual table",
        ),
        (
            "drop table messages; create table messages(id integer primary key, topic_id integer, timestamp integer, "
            "data blob generated always as (zeroblob(1000)));",
            "messages has generated columns",
        ),
        (
            "drop table messages; create virtual table messages using fts5(id, topic_id, timestamp, data);",
            "messages is a view or virtual table",
        ),
    ],
    ids=["view", "column", "virtual table"],
)
def test_a_database_that_computes_its_rows_is_refused(tmp_path: Path, script: str, error_text: str) -> None:
    with SqliteWriter(tmp_path / "bag") as writer:
        writer.add_topic("/s", BagTopic("/s", "std_msgs/msg/Bool"))
        writer.write("/s", b"\0\1\0\0\1", 1)
    path = tmp_path / "bag" / "bag_0.db3"
    assert len(read(path)) == 1
    base = sqlite3.connect(path)
    base.executescript(script)
    base.close()
    require_error(path, error_text)


BOMB = "a0: &a0 [x, x]\n" + "".join(f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]\n" for n in range(1, 30))
MERGED = "a0: &a0 {k: 1}\n" + "".join(f"a{n}: &a{n} {{<<: [*a{n - 1}, *a{n - 1}]}}\n" for n in range(1, 30))


def metadata_text(**wrong: str) -> str:
    """Return the text of a metadata file with wrong values."""
    right = {"files": "[a.mcap]", "storage": "mcap", "topic": "/a", "count": "1", "qos": '""'}
    return (
        "rosbag2_bagfile_information: {{relative_file_paths: {files}, storage_identifier: {storage}, "
        "topics_with_message_count: [{{message_count: {count}, topic_metadata: {{name: {topic}, type: a/msg/B, "
        "serialization_format: cdr, offered_qos_profiles: {qos}}}}}]}}"
    ).format(**(right | wrong))


@pytest.mark.parametrize(
    ("text", "error_text"),
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
        (metadata_text(qos="[" * 900 + "]" * 900), "not YAML: .*more than 100 levels"),
        (MERGED, "not YAML: "),
        (metadata_text(count=".inf"), "OverflowError"),
        (BOMB + metadata_text(files="[*a29]"), "more than 1000000 values, aliases written out"),
        (BOMB + metadata_text(topic="*a29"), "more than 1000000 values, aliases written out"),
        (BOMB + metadata_text(storage="*a29"), "more than 1000000 values, aliases written out"),
        (metadata_text(files='["a\\0.mcap"]'), "a file name with a zero byte"),
        ("a: &a [x, x]\nb: &b [*a, *a]\nrosbag2_bagfile_information: [*b, *b]", "not in the format of rosbag2"),
    ],
)
@pytest.mark.usefixtures("little_memory")
def test_invalid_metadata_is_reported(tmp_path: Path, text: str, error_text: str) -> None:
    (tmp_path / "metadata.yaml").write_text(text)
    require_error(tmp_path, error_text)


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
def test_invalid_qos_text_is_parsed_as_no_profiles(text: str) -> None:
    assert OfferedQoS.parse(text) == []


def split_bag(folder: Path) -> list[Path]:
    """Write a bag of three MCAP files with 10 messages on each of two topics, and return the files."""
    with BagWriter(folder, compression="") as writer:
        for number in range(30):
            if number in (10, 20):
                writer.split()
            writer.write("/s", String(data=str(number)), number)
            writer.write("/t", String(data=str(number)), number)
    return sorted(folder.glob("*.mcap"))


@pytest.mark.parametrize(
    ("left", "note"), [(0, r"20 messages of 2 topics"), (None, r"\d+ messages of 2 topics")], ids=["empty", "cut"]
)
def test_messages_that_metadata_lists_and_files_lack_are_reported(tmp_path: Path, left: int | None, note: str) -> None:
    files = split_bag(tmp_path / "bag")
    assert len(files) == 3
    data = files[1].read_bytes()
    files[1].write_bytes(data[: data.index(String(data="15").encode()) if left is None else left])
    expected = rf"bag: {note} that metadata\.yaml lists are lost: a file of the bag was cut off, replaced or removed"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with BagReader(tmp_path / "bag") as reader:
            found = [*reader.messages(raw=True)]
        reindex(tmp_path / "bag")
    told = [str(one.message) for one in caught if "lists" in str(one.message)]
    assert len(told) == 2 and re.search(expected, told[0]) and re.search(expected, told[1])
    assert f"{60 - len(found)} messages" in told[0] and told[0] == told[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        BagReader(tmp_path / "bag").close()


def test_metadata_cannot_refer_to_files_outside_the_bag_folder(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "secret.mcap") as writer:
        writer.write("/s", Bool())
    bag = tmp_path / "bag"
    bag.mkdir()
    text = "rosbag2_bagfile_information: {relative_file_paths: [../secret.mcap], storage_identifier: mcap}"
    (bag / "metadata.yaml").write_text(text)
    require_error(bag, r"bag.metadata\.yaml refers to secret\.mcap, which does not exist$")


# ------------------------------------------------------------------------------------------------- killed recorders


@pytest.mark.parametrize("writer", [BagWriter, SqliteWriter])
def test_recorder_killed_during_file_compression_leaves_each_message_exactly_once(
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
        done = reindex(folder)
        assert (done.messages, done.files) == (2, 2), step
        with BagReader(folder) as reader:
            assert [one.log_time for one in reader.messages(raw=True)] == [0, 1], step
            assert all(file.suffix == ".zstd" for file in reader.files), step


def test_progress_of_reindexing_never_decreases(tmp_path: Path) -> None:
    size, states = len(recording(tmp_path / "a_0.mcap", COUNT)), []
    reindex(tmp_path, lambda *state: states.append(state))
    assert states == sorted(states) and states[-1] == (size, size)


def raising(error: type[BaseException]) -> Any:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    return fail


@pytest.mark.parametrize("writer", [BagWriter, SqliteWriter])
def test_complete_file_is_read_if_plain_and_compressed_form_exist(tmp_path: Path, writer: Any) -> None:
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


def test_files_are_synced_to_disk_before_they_are_renamed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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


@pytest.mark.parametrize("compression", ["", "zstd"])
def test_losses_of_files_cut_or_zeroed_at_any_block_are_bounded_and_reported(tmp_path: Path, compression: str) -> None:
    figures = blocks(tmp_path, compression, 600, step=4 * 4096)
    for kind in ("closed", "killed"):
        assert figures[f"{kind}, cut: read strictly"] == figures[f"{kind}, cut: cases"]
        zeros = figures[f"{kind}, zeros to the end: cases"] - figures[f"{kind}, zeros to the end: read strictly"]
        assert zeros == 1  # from the first byte on, it is no MCAP file
        assert figures[f"{kind}, a block of zeros: lost without a report"] == 0
        assert figures[f"{kind}, zeros to the end: lost without a report"] == 0
    assert figures["closed, a block of zeros: messages lost, at most"] <= 120  # three chunks of small messages


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["zstd", "file"])
def test_killed_recorder_leaves_all_flushed_messages(tmp_path: Path, mode: str) -> None:
    kills(tmp_path, mode, 1)


# ------------------------------------------------------------------------------------------------------------ one part


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
@pytest.mark.parametrize("has_index", [True, False])
def test_damaged_chunk_is_an_error_with_its_position_or_is_skipped_and_reported(
    tmp_path: Path, has_index: bool, compression: str
) -> None:
    path = tmp_path / "a.mcap"
    begin, end = zeroed_chunk(path, 2, has_index=has_index, compression=compression)
    place = f"{end - begin} bytes at byte {begin}, log times from 80 to 119 ns, topics /t0, /t1"
    require_error(path, place)
    with pytest.warns(BagWarning, match=place), BagReader(path, skip_damaged=True) as reader:
        for _ in range(2):  # reported once
            assert [one.log_time for one in reader] == [*range(80), *range(120, COUNT)]
        table = reader.to_arrays("/t0")
    (part,) = reader.damaged
    assert (part.offset, part.size, part.start_ns, part.end_ns, part.topics) == (
        *(begin, end - begin, 80, 119),
        ("/t0", "/t1"),
    )
    assert len(table) == (COUNT - 40) // 2


@pytest.mark.parametrize("mode", ["none", "message"])
@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
def test_bag_whose_first_chunk_is_damaged_is_reindexed_without_that_chunk(
    tmp_path: Path, compression: str, mode: Any
) -> None:
    with BagWriter(tmp_path / "bag", compression=compression, compression_mode=mode) as writer:
        for number in range(4):
            writer.write("/t", String(data=text(number)), number)
            if number % 2:
                writer.flush()
    file = tmp_path / "bag" / "bag_0.mcap"
    data = bytearray(file.read_bytes())
    begin, end = chunks(bytes(data))[0]
    data[begin + 60 : end] = bytes(end - begin - 60)
    file.write_bytes(data)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    done = reindex(tmp_path / "bag")
    assert done.messages == 2 and [one.offset for one in done.damaged] == [begin]
    with BagReader(tmp_path / "bag") as reader:
        assert [(one.log_time, one.message.data) for one in reader] == [(number, text(number)) for number in (2, 3)]


def test_zeros_in_the_last_chunk_are_the_end_of_a_file_without_index(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    data = recording(path, COUNT)
    begin, end = chunks(data)[-1]
    for tail in (b"", bytes(10_000)):
        for zeros in (begin + 20, (begin + end) // 2, end - 1):
            path.write_bytes(data[:zeros] + bytes(end - zeros) + tail)
            with pytest.warns(BagWarning, match=f"its last {end - begin + len(tail)} bytes"), BagReader(path) as reader:
                assert len(list(reader)) == COUNT - 40
                assert sum(one.count or 0 for one in reader.topics.values()) == COUNT - 40


def test_unchunked_message_that_may_end_in_lost_blocks_is_dropped(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False, index_types=IndexType.NONE)
        writer.start("ros2", "x")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/t0", "cdr", schema)
        ends = []
        for number in range(3):
            writer.add_message(channel, number, b"\0\1\0\0\x05\0\0\0abcd\0", number)
            stream.flush()
            ends.append(stream.tell())
    data = path.read_bytes()[: ends[-1]]
    for made, count in ((data, 3), (data + bytes(5000), 2), (data[:-4] + bytes(5004), 2), (data[:-20] + bytes(9), 2)):
        path.write_bytes(made)
        with BagReader(path) as reader:
            assert [one.message.data for one in reader] == ["abcd"] * count


def test_search_after_damage_finds_the_next_chunk_but_no_chunk_inside_a_message(tmp_path: Path) -> None:
    inner = recording(tmp_path / "inner.mcap", COUNT, "")
    path = tmp_path / "a.mcap"
    with BagWriter(path, compression="") as writer:
        writer.add_topic("/file", BagTopic("/file", "std_msgs/msg/String", "string data"))
        for number in range(4):
            writer.write("/file", b"\0\1\0\0" + inner, number)
            writer.flush()
    data = path.read_bytes()
    (begin, _), (after, _) = chunks(data)[1:3]
    path.write_bytes(data[:begin] + bytes(60) + data[begin + 60 : -60])  # of a chunk that a recording is in
    with pytest.warns(BagWarning, match="unknown topics"), BagReader(path, skip_damaged=True) as reader:
        assert [(one.topic, one.log_time) for one in reader.messages(raw=True)] == [("/file", one) for one in (0, 2, 3)]
    assert [(one.offset, one.size) for one in reader.damaged] == [(begin, after - begin)]


# ------------------------------------------------------------------------------------------------------------- the rest


@pytest.mark.slow
def test_overlapping_chunks_are_read_in_linear_time(tmp_path: Path) -> None:
    """Every chunk ends after all others: with a list that is sorted for each, 12 000 took 20 s."""
    path, count = tmp_path / "a.mcap", 12_000
    samples = ((log_time, bytes(8)) for number in range(count) for log_time in (number, 10**9 - number))
    write_foreign(path, ("/t0", *STRING, samples), chunk_size=70, compression=CompressionType.NONE)
    assert len(chunks(path.read_bytes())) > count
    began = time.process_time()
    with BagReader(path) as reader:
        times = [one.log_time for one in reader.messages(raw=True)]
    assert times == sorted(times) and len(times) == 2 * count
    assert time.process_time() - began < 8


@pytest.mark.parametrize("times", [[1 << 63], [5, (1 << 64) - 1]])
def test_log_times_beyond_the_range_of_arrays_are_an_error(tmp_path: Path, times: list[int]) -> None:
    path = write_foreign(tmp_path / "a.mcap", ("/s", *STRING, [(one, String(data="x").encode()) for one in times]))
    with BagReader(path) as reader, pytest.raises(BagError, match=f"/s at {times[-1]} ns: arrays have log times up to"):
        reader.to_arrays("/s")


def test_a_topic_name_with_control_characters_is_not_written(tmp_path: Path) -> None:
    for number, name in enumerate(("/a\x1b[31m", "/a\nb", "/a\x00", "/a\u202eb", "/a\ud800")):
        known = BagTopic(name, "std_msgs/msg/String", "string data")
        with BagWriter(tmp_path / f"m{number}") as mcap, SqliteWriter(tmp_path / f"s{number}") as sqlite:
            for add in (mcap.add_raw_topic, sqlite.add_raw_topic, lambda one: mcap.add_topic(one.name, String)):
                with pytest.raises(BagError, match="expected a name without control characters") as caught:
                    add(known)
                assert str(caught.value).isprintable()


def test_messages_of_a_chunk_without_header_are_skipped_for_lack_of_checksum(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    data = bytearray(recording(path, COUNT, ""))
    (first, _), (begin, _) = chunks(bytes(data))[1:3]
    data[first + 200] ^= 1  # damage, and then a chunk without its head of 49 bytes, in which a text is wrong
    data[begin + 200] ^= 1
    path.write_bytes(data[:begin] + data[begin + 49 : -60])
    with pytest.warns(BagWarning, match="have no checksum"), BagReader(path, skip_damaged=True) as reader:
        assert [one.log_time for one in reader] == [*range(40), *range(120, COUNT)]
