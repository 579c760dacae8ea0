"""Bags of other tools and of killed recorders are read completely and correctly."""

from __future__ import annotations

import random
import shutil
import sqlite3
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import CompressionType, IndexType
from support.bag_samples import STRING, String, memory_limit, require_error, write_foreign, write_strings
from zstandard import ZstdCompressor

from rosidl_py_gen import compile_definition
from rosidl_py_gen.bags import (
    BagError,
    BagReader,
    BagTopic,
    BagWarning,
    BagWriter,
    RawMessage,
    SkippedMessages,
    SqliteWriter,
)
from rosidl_py_gen.bags.writer import topic_of

COUNT = 20


def foreign(path: Path, count: int = COUNT, order: Any = range, **options: Any) -> Path:
    """Write a file of strings "0", "1", ... with the package mcap, in the given order of times."""
    samples = [(number, String(data=str(number)).encode()) for number in order(count)]
    return write_foreign(path, ("/s", *STRING, samples), **{"chunk_size": 100, **options})


def words(path: Path, **options: Any) -> list[str]:
    with BagReader(path, **options) as reader:
        return [item.message.data for item in reader]


RIGHT = [str(number) for number in range(COUNT)]

# ------------------------------------------------------------------------------------------------------------ two types

OLD, NEW = "int32 x\nint32 y", "int32 y\nint32 x"


def write_two_definitions(path: Path) -> Path:
    data = b"\0\1\0\0" + struct.pack("<ii", 1, 2)
    channels = (("/place", "my_msgs/msg/Place", text, [(number, data)]) for number, text in enumerate((OLD, NEW)))
    return write_foreign(path, *channels)


def test_messages_of_one_topic_are_decoded_and_copied_with_their_own_definitions(tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    with BagReader(write_two_definitions(tmp_path / "a.mcap")) as reader:
        assert [(item.message.x, item.message.y) for item in reader] == [(1, 2), (2, 1)]
        assert reader.to_arrays("/place", ["x"])["x"].tolist() == [1, 2]
        assert [topic.definition for topic in reader.channels] == [OLD, NEW]
        assert reader.topics["/place"].count == 2
        with pytest.raises(BagError, match="/place was recorded with 2 definitions"):
            reader.message_class("/place")
        found = list(reader.raw_messages())
    with BagWriter(copy, split_s=1e-9) as writer, SqliteWriter(tmp_path / "base") as base:
        for item in found:
            writer.write_raw(item)
        base.write_raw(found[0])
        with pytest.raises(BagError, match="/place has messages of two definitions"):
            base.write_raw(found[1])
    with BagReader(copy) as reader:
        assert len(reader.files) == 2
        assert [(item.message.x, item.message.y) for item in reader] == [(1, 2), (2, 1)]


def test_table_of_fields_whose_type_changed_is_refused(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        for number, text in enumerate(("int32 x", "float64 x")):
            cls = compile_definition("my_msgs/msg/Value", text)
            writer.add_raw_topic(known := topic_of("/v", cls))
            writer.write_raw(RawMessage(known, cls(x=number).encode(), number, number))
    with BagReader(tmp_path / "a.mcap") as reader:
        with pytest.raises(BagError, match="x has different types in the definitions"):
            reader.to_arrays("/v")
        assert [item.message.x for item in reader.messages("/v")] == [0, 1.0]


# ------------------------------------------------------------------------------------------ indexes that say less


@pytest.mark.parametrize(
    "options",
    [
        {"index_types": IndexType.NONE},
        {"index_types": IndexType.MESSAGE},
        {"index_types": IndexType.CHUNK},
        {"repeat_channels": False},
        {"repeat_schemas": False},
        {"use_statistics": False},
        {"use_statistics": False, "index_types": IndexType.CHUNK, "repeat_channels": False},
        {"use_chunking": False},
        {"use_chunking": False, "repeat_channels": False, "use_statistics": False},
        {"use_summary_offsets": False},
    ],
    ids=str,
)
@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4])
def test_messages_and_topics_missing_from_an_index_are_found(
    tmp_path: Path, options: dict[str, Any], compression: CompressionType
) -> None:
    path = foreign(tmp_path / "a.mcap", compression=compression, **options)
    assert words(path) == RIGHT
    with BagReader(path) as reader:
        assert (list(reader.topics), reader.start_ns, reader.end_ns) == (["/s"], 0, COUNT - 1)
        assert reader.topics["/s"].count in (COUNT, None)
        assert [item.message.data for item in reader.messages("/s", start_ns=5, end_ns=8)] == ["5", "6", "7"]


@pytest.mark.parametrize("is_chunked", [True, False])
def test_messages_without_an_index_are_ordered_by_log_time(tmp_path: Path, is_chunked: bool) -> None:
    path = foreign(
        tmp_path / "a.mcap", order=lambda count: reversed(range(count)), use_chunking=is_chunked, repeat_channels=False
    )
    assert words(path) == RIGHT
    path.write_bytes(path.read_bytes()[: -path.stat().st_size // 3])
    assert (found := words(path)) == sorted(found, key=int)
    assert found


def test_messages_outside_the_indexed_chunks_are_found(tmp_path: Path) -> None:
    path = foreign(tmp_path / "a.mcap")
    data = path.read_bytes()
    footer = struct.unpack_from("<QQI", data, len(data) - 28)
    payload = String(data="loose").encode()
    loose = struct.pack("<BQHIQQ", 5, 22 + len(payload), 1, 0, 7, 7) + payload
    at = data.index(struct.pack("<BQI", 15, 4, 0))  # the end of the messages
    moved = bytearray(data[:at] + loose + data[at:])
    struct.pack_into("<QQI", moved, len(moved) - 28, footer[0] + len(loose), 0, 0)
    path.write_bytes(moved)
    with BagReader(path) as reader:
        assert reader.has_index
        assert [item.message.data for item in reader.messages(start_ns=6, end_ns=9)] == ["6", "7", "loose", "8"]


def test_wrong_byte_in_unchunked_messages_is_reported(tmp_path: Path) -> None:
    path = foreign(tmp_path / "a.mcap", use_chunking=False, enable_data_crcs=True)
    data = path.read_bytes()
    assert words(path) == RIGHT
    path.write_bytes(data.replace(b"\x0219"[1:], b"18", 1))
    require_error(path, "the checksum of its messages is wrong")


# --------------------------------------------------------------------------------------------------------------- memory


@pytest.mark.slow
def test_bag_of_a_killed_recorder_is_read_in_bounded_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write_strings(path, ["x" * 100_000] * 300, compression="")
    path.write_bytes(path.read_bytes()[:-100])
    with memory_limit(6 << 20), BagReader(path) as reader:
        assert not reader.has_index
        assert sum(1 for _ in reader.messages(raw=True)) == 300


def test_chunks_whose_overlap_exceeds_the_memory_limit_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        writer.add_topic("/s", String)
        for number in range(10):
            for time in (number, 1000 + number):
                writer.write("/s", String(data="x" * 700_000).encode(), time)
    require_error(path, "overlap in time so much", max_decompressed_bytes=3_000_000)
    with BagReader(path) as reader:
        assert [item.log_time for item in reader.messages(raw=True)] == [*range(10), *range(1000, 1010)]


# ------------------------------------------------------------------------------------------------------------- left out


def write_undecodable_topics(path: Path) -> Path:
    with BagWriter(path) as writer:
        writer.add_topic("/bad", BagTopic("/bad", "my_msgs/msg/Bad", "int33 x"))
        writer.add_topic("/json", BagTopic("/json", "my_msgs/msg/J", "{}", "jsonschema", "json"))
        writer.add_topic("/none", BagTopic("/none", "nobody_has/msg/This", "", ""))
        writer.add_topic("/odd", BagTopic("/odd", "no name", "int32 x"))
        for number, topic in enumerate(("/bad", "/json", "/none", "/odd", "/bad")):
            writer.write(topic, b"\0\1\0\0\1\2\3\4", number)
            writer.write("/s", String(data=str(number)), number)
    return path


def test_undecodable_messages_are_skipped_counted_and_reported_by_topic(tmp_path: Path) -> None:
    with BagReader(write_undecodable_topics(tmp_path / "a.mcap")) as reader:
        with pytest.warns(BagWarning) as warned:
            assert [item.message.data for item in reader] == ["0", "1", "2", "3", "4"]
        assert len(warned) == 4
        assert {topic: out.count for topic, out in reader.skipped.items()} == {
            "/bad": 2, "/json": 1, "/none": 1, "/odd": 1,
        }  # fmt: skip
        assert "int33" in reader.skipped["/bad"].reason
        assert reader.skipped["/json"] == SkippedMessages(1, "messages are json; expected cdr")
        assert len(list(reader.messages(raw=True))) == 10
        for name in reader.skipped:
            with pytest.raises(Exception, match=r"int33|expected cdr|no definition|no name"):
                reader.messages(name)


def test_empty_definition_means_a_message_without_fields(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        writer.add_topic("/go", BagTopic("/go", "my_msgs/msg/Trigger", ""))
        writer.add_topic("/empty", BagTopic("/empty", "std_msgs/msg/Empty", ""))
        writer.add_topic("/full", BagTopic("/full", "my_msgs/msg/Full", ""))
        writer.write("/go", b"\0\1\0\0\0", 0)
        writer.write("/empty", b"\0\1\0\0\0\0\0\0", 1)
        writer.write("/full", b"\0\1\0\0\1\0\0\0", 2)
    with BagReader(path) as reader, pytest.warns(BagWarning, match="/full: no definition of my_msgs/msg/Full"):
        assert [item.topic for item in reader] == ["/go", "/empty"]


# -------------------------------------------------------------------------------------------------------------- sqlite


def database(path: Path, count: int = COUNT) -> Path:
    return write_strings(path, map(str, range(count)), storage="sqlite3") / f"{path.name}_0.db3"


@pytest.mark.parametrize("is_read_only", [False, True])
def test_messages_in_a_write_ahead_log_are_read(tmp_path: Path, is_read_only: bool) -> None:
    live = database(tmp_path / "bag", 0)
    base = sqlite3.connect(live, isolation_level=None)
    base.execute("pragma journal_mode=wal")
    rows = [(number, String(data=str(number)).encode()) for number in range(COUNT)]
    base.executemany("insert into messages(topic_id, timestamp, data) values (1, ?, ?)", rows)
    assert words(live) == RIGHT  # while it is recorded
    (tmp_path / "link.db3").symlink_to(live)
    assert words(tmp_path / "link.db3") == RIGHT
    killed = tmp_path / "killed"
    killed.mkdir()
    for end in ("", "-wal"):
        shutil.copyfile(f"{live}{end}", f"{killed / 'a.db3'}{end}")
    base.close()
    if is_read_only:  # nothing can be made beside it
        (killed / "a.db3-shm").mkdir()
    assert words(killed / "a.db3") == RIGHT
    assert words(killed) == RIGHT


def test_transaction_interrupted_by_a_crash_is_rolled_back(tmp_path: Path) -> None:
    live = database(tmp_path / "bag")
    base = sqlite3.connect(live, isolation_level=None)
    base.execute("pragma cache_size=1")
    base.execute("begin")
    base.executemany("insert into messages(topic_id, timestamp, data) values (1, ?, ?)", [(9, b"x" * 5000)] * 50)
    killed = tmp_path / "killed.db3"
    for end in ("", "-journal"):
        shutil.copyfile(f"{live}{end}", f"{killed}{end}")
    base.close()
    before = killed.read_bytes()
    assert words(killed) == RIGHT
    assert killed.read_bytes() == before


def test_several_threads_read_with_one_reader(tmp_path: Path) -> None:
    for path in 20 * (database(tmp_path / "bag"), foreign(tmp_path / "a.mcap")):
        with BagReader(path) as reader:
            found: list[list[str]] = []
            begin = threading.Barrier(4)

            def read(
                reader: BagReader = reader, found: list[list[str]] = found, begin: threading.Barrier = begin
            ) -> None:
                begin.wait()
                found.append([item.message.data for item in reader])

            threads = [threading.Thread(target=read) for _ in range(4)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert found == [RIGHT] * 4


@pytest.mark.parametrize("mode", ["none", "message"])
def test_concurrent_decompression_in_threads_returns_correct_messages(tmp_path: Path, mode: str) -> None:
    draw = random.Random(7)
    texts = [draw.randbytes(20_000).hex() for _ in range(60)]
    write_strings(tmp_path / "bag", texts, compression="zstd" if mode == "none" else "", compression_mode=mode)
    with BagReader(tmp_path / "bag") as reader, ThreadPoolExecutor(8) as threads:

        def agrees() -> bool:
            return all(item.message.data == text for item, text in zip(reader, texts, strict=True))

        assert all(agreed.result() for agreed in [threads.submit(agrees) for _ in range(16)])


def test_two_definitions_of_one_type_in_a_database_are_distinguished_by_hash(tmp_path: Path) -> None:
    path = database(tmp_path / "bag", 0)
    base = sqlite3.connect(path)
    for number, text in ((2, OLD), (3, NEW)):
        base.execute(
            "insert into topics values (?, ?, 'my_msgs/msg/Place', 'cdr', '', ?)", (number, f"/{number}", text)
        )
        base.execute(
            "insert into message_definitions(topic_type, encoding, encoded_message_definition, type_description_hash) "
            "values ('my_msgs/msg/Place', 'ros2msg', ?, ?)",
            (text, text),
        )
        data = b"\0\1\0\0" + struct.pack("<ii", 1, 2)
        base.execute("insert into messages(topic_id, timestamp, data) values (?, 0, ?)", (number, data))
    base.commit()
    base.close()
    with BagReader(path) as reader:
        assert {item.topic: item.message.x for item in reader} == {"/2": 1, "/3": 2}


# -------------------------------------------------------------------------------------------- compression of rosbag2


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("mode", ["file", "message"])
@pytest.mark.parametrize("has_metadata", [True, False])
def test_compressed_bags_of_rosbag2_are_read(tmp_path: Path, storage: str, mode: str, has_metadata: bool) -> None:
    folder = tmp_path / "bag"
    write_strings(folder, RIGHT, storage=storage, compression_mode=mode)
    if not has_metadata:
        (folder / "metadata.yaml").unlink()
    assert words(folder) == RIGHT
    (file,) = folder.glob("bag_0.*")
    assert words(file) == RIGHT


def test_damaged_compression_is_reported(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    compress = ZstdCompressor().compress
    stored = [compress(String(data="a" * 1000).encode())[:-3], compress(bytes(1_000_000))]
    write_strings(folder, stored, storage="sqlite3")
    (folder / "metadata.yaml").unlink()
    require_error(folder, "/s at 0 ns: damaged")
    with (
        BagReader(folder, max_decompressed_bytes=10_000) as reader,
        pytest.raises(BagError, match="state 1000000 bytes; expected"),
    ):
        list(reader.messages("/s", start_ns=1, raw=True))
    (file,) = folder.glob("*.db3")
    file.with_name(f"{file.name}.zstd").write_bytes(compress(file.read_bytes())[:-10])
    file.unlink()
    require_error(folder, "damaged")
