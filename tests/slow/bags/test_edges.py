"""Corner cases of bags: large chunks, many files, odd times, damage that looks like an end, journals."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from support.bag_samples import STRING, String, memory_limit, require_error, write_foreign, write_strings
from zstandard import ZstdCompressor

from rosidl_py_gen.bags import BagError, BagReader, BagWarning, BagWriter, SqliteWriter
from rosidl_py_gen.bags import writer as writers
from rosidl_py_gen.bags.common import BagTopic
from rosidl_py_gen.bags.storage import storage_api
from rosidl_py_gen.errors import DecodeError

MB = 1 << 20


def write_file(path: Path, sizes: list[int], times: list[int] | None = None, **options: Any) -> Path:
    """Write an MCAP file with strings of the given sizes at the given times."""
    texts = [chr(97 + number % 26) * size for number, size in enumerate(sizes)]
    samples = zip(times or range(len(sizes)), (String(data=text).encode() for text in texts), strict=True)
    return write_foreign(path, ("/s", *STRING, samples), **{"chunk_size": 1 << 40, **options})


def read_strings(path: Path, **options: Any) -> list[tuple[int, str, int]]:
    """Return time, first letter and length of each string."""
    with BagReader(path, **options) as reader:
        return [(item.log_time, item.message.data[:1], len(item.message.data)) for item in reader]


# -------------------------------------------------------------------------------------------------------------- memory


@pytest.mark.parametrize("has_index", [True, False])
@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
def test_large_chunk_is_read_in_bounded_memory(tmp_path: Path, compression: CompressionType, has_index: bool) -> None:
    sizes = [MB - 100, 3 * MB, 5, 100] * 20
    path = write_file(tmp_path / "a.mcap", sizes, compression=compression)
    if not has_index:
        path.write_bytes(path.read_bytes()[:-60])
    if compression is CompressionType.ZSTD:
        assert path.stat().st_size < 300_000
    with memory_limit(64 * MB):
        found = read_strings(path)
    assert found == [(number, chr(97 + number % 26), size) for number, size in enumerate(sizes)]


def test_messages_of_an_unordered_large_chunk_are_sorted(tmp_path: Path) -> None:
    times = [3, 1, 2, 0] * 5
    path = write_file(tmp_path / "a.mcap", [MB] * 20, times)
    assert [time for time, _, _ in read_strings(path)] == sorted(times)


def test_damage_in_a_large_chunk_is_reported_before_its_first_message(tmp_path: Path) -> None:
    path = write_file(tmp_path / "a.mcap", [MB] * 20, compression=CompressionType.NONE)
    data = bytearray(path.read_bytes())
    data[15 * MB] ^= 1
    path.write_bytes(data)
    with BagReader(path) as reader, pytest.raises(BagError, match=r"a\.mcap: damaged: the checksum of a chunk"):
        next(iter(reader))


def test_large_and_small_chunks_are_merged_in_time_order(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        writer.add_topic("/s", String)
        times = [10, 50, 5, 60, 20, 55, 30]
        for time in times:
            writer.write("/s", String(data="x" * (9 * MB if time in (10, 60) else MB)), time)
    assert [time for time, _, _ in read_strings(path)] == sorted(times)


def test_files_of_a_bag_are_decompressed_sequentially_in_bounded_memory(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    for number in range(30):
        write_file(folder / f"bag_{number:02}.mcap", [2 * MB] * 3, [number * 3 + more for more in range(3)])
    with memory_limit(64 * MB):
        assert [time for time, _, _ in read_strings(folder)] == list(range(90))


def test_files_whose_times_overlap_are_merged(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    for number, times in enumerate(([1, 4, 9], [2, 3, 20], [4, 5, 6])):
        write_file(folder / f"bag_{number}.mcap", [1] * 3, times)
    assert [time for time, _, _ in read_strings(folder)] == [1, 2, 3, 4, 4, 5, 6, 9, 20]
    with BagReader(folder) as reader:
        assert [item.log_time for item in reader.messages(start_ns=4, end_ns=9)] == [4, 4, 5, 6]


@pytest.mark.parametrize("has_size", [True, False])
def test_file_that_decompresses_beyond_the_limit_is_refused(tmp_path: Path, has_size: bool) -> None:
    path = tmp_path / "a.db3.zstd"
    compressor = ZstdCompressor(level=1, write_content_size=has_size).compressobj(*([30 * MB] if has_size else []))
    path.write_bytes(compressor.compress(bytes(30 * MB)) + compressor.flush())
    text = r"decompresses to \d+ bytes; expected at most \d+, unless max_decompressed_bytes is more"
    require_error(path, text, max_decompressed_bytes=MB)


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_large_messages_of_the_writer_are_never_refused_as_too_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compression: str
) -> None:
    """The limit is 1 MiB instead of 1023 MiB; zeros are compressed to less than a thousandth."""
    assert writers.MAX_COMPRESSED_BYTES + writers.CHUNK_BYTES < storage_api.MAX_UNPACKED_BYTES
    monkeypatch.setattr(writers, "MAX_COMPRESSED_BYTES", 1 << 20)
    large = String(data="\0" * (5 << 20)).encode()
    small = String(data="x" * 1000).encode()
    path = tmp_path / "b.mcap"
    with BagWriter(path, compression=compression) as bag:
        bag.add_topic("/s", String)
        for number, data in enumerate([small, large, small, large]):
            bag.write("/s", data, number)
    with BagReader(path, max_decompressed_bytes=2 << 20) as reader:
        assert [len(item.message) for item in reader.messages(raw=True)] == [len(small), len(large)] * 2
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        compressions = [chunk.compression for chunk in summary.chunk_indexes]
    assert compressions == [compression, "", compression, ""]  # only large messages are not compressed


# --------------------------------------------------------------------------------------------------------------- times


def test_largest_possible_log_times_are_read(tmp_path: Path) -> None:
    times = [0, (1 << 63) - 1, 1 << 63, (1 << 64) - 2]
    assert [one for one, _, _ in read_strings(write_file(tmp_path / "a.mcap", [1] * 4, times))] == times
    with SqliteWriter(tmp_path / "bag") as writer:
        writer.add_topic("/s", BagTopic("/s", *STRING))
        writer.write("/s", String(data="a").encode(), (1 << 63) - 1)
    assert read_strings(tmp_path / "bag") == [((1 << 63) - 1, "a", 1)]


# -------------------------------------------------------------------------------------------------------------- damage


def test_schema_id_with_two_different_definitions_is_refused(tmp_path: Path) -> None:
    path = write_file(tmp_path / "a.mcap", [1, 1], use_chunking=False, index_types=IndexType.NONE, use_statistics=False)
    data = path.read_bytes()
    first = data.index(b"std_msgs/msg/String") - 15
    length = 9 + struct.unpack_from("<Q", data, first + 1)[0]
    assert data[first] == 3
    other = data[first : first + length].replace(b"string data", b"uint8[] abc")
    path.write_bytes(data[: first + length] + other + data[first + length : -60])
    require_error(path, "schema 1 has two different definitions")


def test_damage_in_the_middle_of_a_file_is_not_treated_as_its_end(tmp_path: Path) -> None:
    path = write_file(tmp_path / "a.mcap", [1] * 5, use_chunking=False, index_types=IndexType.NONE)
    data = bytearray(path.read_bytes())
    at = data.index(String(data="c").encode()) - 31
    assert data[at] == 5
    data[at + 6] = 1  # a length of a terabyte
    data[-40:-12] = bytes(28)  # and the footer speaks of no index
    path.write_bytes(data)
    require_error(path, "no valid record at byte")
    path.write_bytes(data[:-20])  # without footer, damage is where the recorder was killed
    assert [time for time, _, _ in read_strings(path)] == [0, 1]


def test_chunk_with_messages_outside_its_stated_times_is_refused(tmp_path: Path) -> None:
    path = write_file(tmp_path / "a.mcap", [1] * 3, [5, 6, 7], enable_crcs=False)
    data = bytearray(path.read_bytes())
    for at in range(len(data) - 16):  # in the chunk, the index and the statistics
        if data[at : at + 16] == struct.pack("<QQ", 5, 7):
            data[at + 8] = 6
    path.write_bytes(data)
    require_error(path, "states messages from 5 to 6 ns, and contains some")


def test_damaged_message_is_an_error_or_is_skipped_on_request(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        writer.add_topic("/s", String)
        for number, data in enumerate((String(data="a").encode(), b"\0\1\0\0\xff\0\0\0a", String(data="b").encode())):
            writer.write("/s", data, number)
    with BagReader(path) as reader:
        with pytest.raises(DecodeError, match="/s at 1 ns"):
            list(reader)
        with pytest.warns(BagWarning, match="/s at 1 ns"):
            found = [item.message.data for item in reader.messages("/s", on_error="skip")]
        assert found == ["a", "b"] and reader.skipped["/s"].count == 1
        with pytest.raises(ValueError, match="on_error"):
            reader.messages(on_error="ignore")  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------------- files beside files


def test_journal_that_names_other_files_is_refused_and_deletes_no_file(tmp_path: Path) -> None:
    write_strings(tmp_path / "bag", ["a"], storage="sqlite3")
    file, victim = tmp_path / "bag" / "bag_0.db3", tmp_path / "victim"
    victim.write_bytes(b"mine")
    name, magic = str(victim).encode(), bytes.fromhex("d9d505f920a163d7")
    head = magic + struct.pack(">IIIII", 0, 0, file.stat().st_size // 4096, 512, 4096)
    tail = struct.pack(">I", 262145) + name + struct.pack(">II", len(name), sum(name)) + magic
    Path(f"{file}-journal").write_bytes(head.ljust(512, b"\0") + tail)
    require_error(file, "its -journal belongs to several databases")
    assert victim.read_bytes() == b"mine"


def test_messages_whose_topic_row_is_missing_are_counted_and_reported(tmp_path: Path) -> None:
    write_strings(tmp_path / "bag", ["a"] * 3, storage="sqlite3")
    file = tmp_path / "bag" / "bag_0.db3"
    with sqlite3.connect(file) as changed:
        changed.execute("update messages set topic_id = 7 where timestamp = 2")
    name = "(no topic has id 7)"
    with BagReader(file) as reader:
        with pytest.warns(BagWarning, match=r"skipped \(no topic has id 7\)"):
            assert [item.log_time for item in reader] == [0, 1]
        assert reader.skipped[name].count == 1
        assert [item.log_time for item in reader.messages(raw=True)] == [0, 1, 2]
        assert [item.log_time for item in reader.messages(name, raw=True)] == [2]
        with pytest.raises(BagError, match="no topic has id 7"):
            list(reader.messages(name))
