"""Split and compressed bags and their metadata, for both storages, read by this package and by rosbags."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.rosbag2 import Reader as RosbagsReader
from rosbags.typesys import Stores, get_typestore
from support.bag_samples import STORAGES, String, file_size_limit, write_strings

from rosidl_py_gen.bags import BagError, BagReader, BagWriter, SqliteWriter
from rosidl_py_gen.bags.writer import topic_of
from rosidl_py_gen.runtime import QoSProfile

S = 1_000_000_000


def write_numbers(path: Path, storage: str, **options: Any) -> dict[str, Any]:
    """Write ten messages, one a second, of 500 bytes each; return the metadata."""
    write_strings(path, [f"{number:0500}" for number in range(10)], "/words", storage, S, **options)
    information = yaml.safe_load((path / "metadata.yaml").read_text())
    return dict(information["rosbag2_bagfile_information"])


def read_numbers(path: Path) -> list[int]:
    """Read the numbers with rosbags, and check that this package reads the same."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with RosbagsReader(path) as theirs:
        found = [store.deserialize_cdr(data, one.msgtype).data for one, _, data in theirs.messages()]  # type: ignore[attr-defined]
    with BagReader(path) as ours:
        assert [item.message.data for item in ours] == found
    return [int(one) for one in found]


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize(("limit", "counts"), [({"split_s": 4}, [4, 4, 2]), ({"split_bytes": 1000}, [2, 2, 2, 2, 2])])
def test_bag_is_split_by_duration_or_size(
    tmp_path: Path, storage: str, limit: dict[str, Any], counts: list[int]
) -> None:
    path = tmp_path / "bag"
    custom = {"robot": "r2", "no": ""} if "split_s" in limit else None
    information = write_numbers(path, storage, custom_data=custom, **limit)
    assert information["custom_data"] == custom
    suffix = "mcap" if storage == "mcap" else "db3"
    assert information["relative_file_paths"] == [f"bag_{number}.{suffix}" for number in range(len(counts))]
    assert [one["message_count"] for one in information["files"]] == counts
    assert (information["message_count"], information["duration"]["nanoseconds"]) == (10, 9 * S)
    assert read_numbers(path) == [*range(10)]
    for number, name in enumerate(information["relative_file_paths"]):  # each file is a bag
        with BagReader(path / name) as reader:
            assert len(list(reader)) == counts[number]


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("packing", ["file", "message"])
def test_compressed_bags_have_the_layout_of_rosbag2(tmp_path: Path, storage: str, packing: str) -> None:
    path = tmp_path / "bag"
    options = {"compression": ""} if storage == "mcap" else {}
    plain = write_numbers(tmp_path / "plain", storage, **options)
    information = write_numbers(path, storage, compression_mode=packing, split_s=5, compression_threads=2, **options)
    assert (information["compression_format"], information["compression_mode"]) == ("zstd", packing.upper())
    assert (plain["compression_format"], plain["compression_mode"]) == ("", "")
    assert {name.endswith(".zstd") for name in information["relative_file_paths"]} == {packing == "file"}
    assert sorted(one.name for one in path.iterdir()) == sorted([*information["relative_file_paths"], "metadata.yaml"])
    assert read_numbers(path) == [*range(10)]
    sizes = [sum(one.stat().st_size for one in folder.iterdir()) for folder in (path, tmp_path / "plain")]
    assert storage == "sqlite3" or sizes[0] < sizes[1]


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bag_is_split_on_request(tmp_path: Path, storage: str) -> None:
    path = tmp_path / "bag"
    with STORAGES[storage](path) as bag:
        bag.split()  # nothing is in it yet
        bag.add_topic("/words", topic_of("/words", String))
        for number in range(3):
            bag.write("/words", String(data=str(number)).encode(), number)
            bag.split()
            bag.split()
    information = yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert [one["message_count"] for one in information["files"]] == [1, 1, 1, 0]
    assert read_numbers(path) == [0, 1, 2]
    with pytest.raises(BagError, match="is closed"):
        bag.split()


@pytest.mark.parametrize("storage", STORAGES)
def test_messages_are_written_with_their_definition_and_qos(tmp_path: Path, storage: str) -> None:
    with STORAGES[storage](tmp_path / "bag") as bag:
        bag.add_topic("/latched", String, qos=[QoSProfile().transient_local()])
        bag.write("/latched", String(data="hall").encode(), 1)
        bag.write("/words", String(data="now"))
        bag.write("/words", memoryview(String(data="then").encode()), 2)
        with pytest.raises(BagError, match="call add_topic before bytes are written"):
            bag.write("/other", b"\0\1\0\0", 3)
    with BagReader(tmp_path / "bag") as bag, STORAGES[storage](tmp_path / "copy") as copy:
        assert [one.message.data for one in bag] == ["hall", "then", "now"]
        assert all(bag.definition(topic).is_recorded for topic in bag.topics)
        copy.add_topic("/renamed", bag.topics["/latched"])
        copy.write("/renamed", String(data="hall").encode(), 1)
        copy.add_topic("/volatile", bag.topics["/latched"], qos=[QoSProfile()])
    with BagReader(tmp_path / "copy") as bag:
        assert [(one.topic, one.message.data) for one in bag] == [("/renamed", "hall")]
        qos = {name: yaml.safe_load(topic.offered_qos)[0]["durability"] for name, topic in bag.topics.items()}
        assert qos == {"/renamed": 1, "/volatile": 2}  # transient local, volatile


def test_flushed_messages_are_visible_to_other_sqlite_connections(tmp_path: Path) -> None:
    with SqliteWriter(tmp_path / "bag") as bag:
        bag.add_topic("/words", topic_of("/words", String))
        bag.write("/words", String(data="1").encode(), 1)
        other = sqlite3.connect(tmp_path / "bag" / "bag_0.db3")
        assert other.execute("select count(*) from messages").fetchone() == (0,)
        bag.flush()
        assert other.execute("select count(*) from messages").fetchone() == (1,)
        other.close()
    bag.flush()  # nothing more to do


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"compression_mode": "file"}, "is one file; only a folder can have"),
        ({"custom_data": {"a": "b"}}, "is one file; only a folder can have"),
        ({"compression_mode": "all"}, 'compression_mode: got "all"; expected one of none, file, message'),
        ({"split_s": 1}, "is one file; only a folder can be split"),
    ],
)
def test_single_file_bag_cannot_be_split_or_compressed(tmp_path: Path, options: Any, error: str) -> None:
    with pytest.raises(BagError, match=error):
        BagWriter(tmp_path / "a.mcap", **options)
    with (
        BagWriter(tmp_path / "b.mcap") as bag,
        pytest.raises(BagError, match="is one file; only a folder can be split"),
    ):
        bag.split()
    custom: Any = {"a": 1}
    with pytest.raises(BagError, match="custom_data: got 'a': 1; expected texts"):
        SqliteWriter(tmp_path / "c", custom_data=custom)
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize("storage", STORAGES)
def test_full_disk_on_close_leaves_no_truncated_metadata(tmp_path: Path, storage: str) -> None:
    path = tmp_path / "bag"
    bag = STORAGES[storage](path)
    bag.add_topic("/words", topic_of("/words", String))
    bag.write("/words", String(data="w").encode(), S)
    bag.flush()
    begun = {one.name for one in path.iterdir()}
    with file_size_limit(100), pytest.raises(OSError, match="File too large"):
        bag.close()
    assert {one.name for one in path.iterdir()} == begun
    with BagReader(next(path.glob("bag_0.*"))) as reader:
        assert [item.message.data for item in reader] == ["w"]
