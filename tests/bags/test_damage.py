"""Damaged parts of recordings: what is intact is read, and what is lost is reported.

Full versions: `tests/support/bag_damage.py`.
"""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from mcap.writer import CompressionType, IndexType, Writer
from support.bag_damage import COUNT, String, blocks, chunks, found, kills, mutations, recording, zeroed_chunk
from support.bag_samples import STRING, require_error, write_foreign

from rosidl_py_gen.bags import BagError, BagReader, BagWarning, BagWriter, SqliteWriter
from rosidl_py_gen.bags.common import BagTopic
from rosidl_py_gen.bags.reindexing import reindex_file, reindex_folder


def test_mutated_files_give_intact_messages_or_an_error_and_more_of_them_with_skip_damaged(tmp_path: Path) -> None:
    figures = mutations(tmp_path, 250)
    assert figures["skipping: messages"] > 2 * figures["strict: messages"]
    assert figures["slowest ms"] < 2000


@pytest.mark.parametrize("compression", ["", "zstd"])
def test_files_cut_and_zeroed_at_every_block_lose_what_is_there(tmp_path: Path, compression: str) -> None:
    figures = blocks(tmp_path, compression, 600, step=4 * 4096)
    for kind in ("closed", "killed"):
        assert figures[f"{kind}, cut: read strictly"] == figures[f"{kind}, cut: cases"]
        zeros = figures[f"{kind}, zeros to the end: cases"] - figures[f"{kind}, zeros to the end: read strictly"]
        assert zeros == 1  # from the first byte on, it is no MCAP file
        assert figures[f"{kind}, a block of zeros: lost without a report"] == 0
        assert figures[f"{kind}, zeros to the end: lost without a report"] == 0
    assert figures["closed, a block of zeros: messages lost, at most"] <= 120  # three chunks of small messages


@pytest.mark.parametrize("mode", ["zstd", "file"])
def test_a_killed_recorder_leaves_all_that_was_flushed(tmp_path: Path, mode: str) -> None:
    kills(tmp_path, mode, 1)


# ------------------------------------------------------------------------------------------------------------ one part


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
@pytest.mark.parametrize("has_index", [True, False])
def test_a_damaged_chunk_is_an_error_with_its_place_or_is_skipped_and_reported(
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


def test_a_message_outside_of_chunks_that_may_end_with_lost_blocks_is_dropped(tmp_path: Path) -> None:
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


def test_after_a_hole_in_the_records_the_next_chunk_is_found_but_not_one_in_a_message(tmp_path: Path) -> None:
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


def test_a_chunk_that_is_too_large_is_not_taken_for_damaged(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recording(path, COUNT)
    require_error(path, "max_decompressed_bytes", skip_damaged=True, max_decompressed_bytes=9)


# ------------------------------------------------------------------------------------------------------------ commands


@pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")
def test_reindex_writes_what_is_intact_and_keeps_what_was(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    path = folder / "bag_0.mcap"
    zeroed_chunk(path, 2)
    before = path.read_bytes()
    done = reindex_folder(folder)
    assert (done.messages, len(done.damaged)) == (COUNT - 40, 1)
    done = reindex_file(path)
    assert (done.messages, len(done.damaged), done.backup and done.backup.read_bytes()) == (COUNT - 40, 1, before)
    assert found(path, COUNT, skip_damaged=False) == (COUNT - 40, 0)
    with pytest.raises(BagError, match="already has an index, and no damage; it needs no reindexing"):
        reindex_file(path)


# ------------------------------------------------------------------------------------------------------------- the rest


def test_chunks_that_overlap_are_read_in_linear_time(tmp_path: Path) -> None:
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
def test_log_times_that_arrays_have_no_room_for_are_an_error(tmp_path: Path, times: list[int]) -> None:
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


def test_messages_of_a_chunk_that_lost_its_head_are_not_read_without_their_checksum(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    data = bytearray(recording(path, COUNT, ""))
    (first, _), (begin, _) = chunks(bytes(data))[1:3]
    data[first + 200] ^= 1  # damage, and then a chunk without its head of 49 bytes, in which a text is wrong
    data[begin + 200] ^= 1
    path.write_bytes(data[:begin] + data[begin + 49 : -60])
    with pytest.warns(BagWarning, match="have no checksum"), BagReader(path, skip_damaged=True) as reader:
        assert [one.log_time for one in reader] == [*range(40), *range(120, COUNT)]
