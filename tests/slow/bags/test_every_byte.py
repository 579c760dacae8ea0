"""Small files with each byte wrong once, and cut at every length, yield our error or correct messages."""

from __future__ import annotations

import os
import sqlite3
import warnings
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest
from mcap.writer import CompressionType, IndexType
from support.bag_samples import write_foreign
from support.example_counts import examples
from zstandard import ZstdCompressor

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader, BagWriter, SqliteWriter
from rosidl_py_gen.bags.common import BagTopic
from rosidl_py_gen.errors import RosidlError

pytestmark = pytest.mark.usefixtures("little_memory")
Bool: Any = get_message("std_msgs/msg/Bool")
TRUE = Bool(data=True).encode()
COUNT = 3
MIN_POSITIONS = 200
RIGHT = [("/a", Bool(data=True), number) for number in range(COUNT)]


def mcap(path: Path, data: bytes = TRUE, **options: Any) -> None:
    channel = "/a", "std_msgs/msg/Bool", "bool data", [(number, data) for number in range(COUNT)]
    write_foreign(path, channel, **{"chunk_size": 60, "enable_data_crcs": True, **options})


def write_bag(path: Path) -> None:
    path.unlink(missing_ok=True)
    with BagWriter(path, compression="zstd") as writer:
        for topic, message, log_time in RIGHT:
            writer.write(topic, message, log_time)


NO_INDEX = {
    "index_types": IndexType.NONE,
    "use_statistics": False,
    "repeat_channels": False,
    "repeat_schemas": False,
    "use_summary_offsets": False,
}
KINDS: dict[str, Callable[[Path], None]] = {
    "plain": lambda path: mcap(path, compression=CompressionType.NONE),
    "zstd": lambda path: mcap(path, compression=CompressionType.ZSTD),
    "lz4": lambda path: mcap(path, compression=CompressionType.LZ4),
    "no index": lambda path: mcap(path, **NO_INDEX),
    "no chunks": lambda path: mcap(path, use_chunking=False, use_summary_offsets=False),
    "no chunks, no index": lambda path: mcap(path, use_chunking=False, **NO_INDEX),
    "our writer": write_bag,
    "compressed messages": lambda path: mcap(path, ZstdCompressor().compress(TRUE)),
}


def read_messages(path: Path) -> tuple[list[Any], bool] | None:
    """Return the messages and True if any were skipped; None if the file is refused."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with BagReader(path) as reader:
                messages = [(item.topic, item.message, item.log_time) for item in reader]
                return messages, bool(reader.skipped)
    except RosidlError as error:
        assert str(error)
        return None


def positions(count: int) -> range:
    """Return the positions to try below `count`."""
    step = max(1, count // max(MIN_POSITIONS, examples(count)))
    return range(Random(os.environ.get("ROSIDL_TEST_SEED")).randrange(step), count, step)


def flips(data: bytes) -> list[bytes]:
    """Return copies of the data, each with one wrong byte: all bits or one bit flipped."""
    return [
        data[:at] + bytes([data[at] ^ (0xFF if at % 2 else 1 << at // 2 % 8)]) + data[at + 1 :]
        for at in positions(len(data))
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_wrong_byte_of_an_mcap_file_is_reported_or_changes_nothing(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.mcap"
    KINDS[kind](path)
    assert read_messages(path) == (RIGHT, False)
    wrong = [
        (at, result)
        for at, data in enumerate(flips(path.read_bytes()))
        if path.write_bytes(data) and (result := read_messages(path)) not in (None, (RIGHT, False))
    ]
    assert wrong == []


@pytest.mark.parametrize("kind", KINDS)
def test_mcap_file_cut_at_any_length_has_the_messages_before_the_cut(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "a.mcap"
    KINDS[kind](path)
    data = path.read_bytes()
    counts = []
    for end in sorted({0, *positions(len(data)), len(data) - 1}):
        path.write_bytes(data[:end])
        result = read_messages(path)
        assert result is not None
        assert result == (RIGHT[: len(result[0])], False), end
        counts.append(len(result[0]))
    assert counts == sorted(counts) and counts[0] == 0 and counts[-1] == COUNT


@pytest.fixture
def database(tmp_path: Path) -> Path:
    with SqliteWriter(tmp_path / "bag") as writer:
        writer.add_topic("/a", BagTopic("/a", "std_msgs/msg/Bool", "bool data"))
        for number in range(COUNT):
            writer.write("/a", TRUE, number)
    path = tmp_path / "bag" / "bag_0.db3"
    base = sqlite3.connect(path, isolation_level=None)
    base.executescript("delete from metadata; pragma page_size=512; vacuum")
    base.close()
    return path


@pytest.mark.parametrize("is_packed", [False, True], ids=["database", "compressed database"])
def test_wrong_byte_or_truncation_of_a_database_raises_only_our_errors(database: Path, is_packed: bool) -> None:
    """A database has no checksums, so a wrong value is detected only where it breaks the format."""
    data, path = database.read_bytes(), database
    if is_packed:
        data, path = ZstdCompressor().compress(data), database.with_suffix(".db3.zstd")
    for wrong in (*flips(data), *(data[:end] for end in positions(len(data)))):
        path.write_bytes(wrong)
        result = read_messages(path)
        assert result is None or len(result[0]) <= COUNT or len(wrong) == len(data)
    path.write_bytes(data)
    assert read_messages(path) == (RIGHT, False)
