"""``rosidl-py bag reindex``: what a crash left becomes a bag again."""

from __future__ import annotations

import json
import shutil
import sqlite3
from typing import TYPE_CHECKING, Any

import pytest
import yaml
import zstandard
from mcap.reader import make_reader
from mcap.writer import IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import Reader as RosbagsReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagReader, BagWriter, SqliteWriter
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from pathlib import Path

S = 1_000_000_000
String: Any = get_message("std_msgs/msg/String")
LATCHED = QoSProfile().transient_local()


def split(path: Path, files: int = 12) -> Path:
    """An MCAP folder with a message a second, each in a file of its own, and one latched."""
    with BagWriter(path, split_s=1) as bag:
        bag.add_topic("/map", String, qos=[LATCHED])
        bag.add_topic("/words", String)
        bag.write("/map", String(data="map"), 1000 * S)
        for number in range(files):
            bag.write("/words", String(data=f"w{number}"), (1000 + number) * S)
    return path


def told(folder: Path) -> Any:
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def data_of(path: Path) -> list[tuple[str, str, int]]:
    with BagReader(path) as reader:
        return [(item.topic, item.message.data, item.log_time) for item in reader]


@pytest.mark.parametrize("left", ["missing", "empty", "no YAML", "of another bag"])
def test_a_folder_gets_the_metadata_it_had(run_here: Any, tmp_path: Path, left: str) -> None:
    path = split(tmp_path / "bag")
    before, items = told(path), data_of(path)
    file = path / "metadata.yaml"
    if left == "missing":
        file.unlink()
    elif left == "of another bag":
        shutil.copyfile(split(tmp_path / "other", files=3) / "metadata.yaml", file)
    else:
        file.write_text("" if left == "empty" else "{")
    code, out, err = run_here("bag", "reindex", str(path))
    assert (code, out, err) == (0, f"13 messages of 2 topics in 12 files: {file}\n", "")
    assert told(path) == before  # in the order of numbers, not of letters
    assert before["relative_file_paths"][1:3] == ["bag_1.mcap", "bag_2.mcap"]
    assert data_of(path) == items
    with RosbagsReader(path) as theirs:
        assert theirs.message_count == 13
    assert sorted(one.name for one in path.iterdir()) == sorted([*before["relative_file_paths"], "metadata.yaml"])


def test_a_bag_of_sqlite_files_gets_its_metadata(run_here: Any, tmp_path: Path) -> None:
    with SqliteWriter(tmp_path / "bag") as bag, BagReader(split(tmp_path / "mcap")) as reader:
        for message in reader.raw_messages():
            bag.write_raw(message)
    before = told(tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").unlink()
    code, out, _ = run_here("bag", "reindex", str(tmp_path / "bag"), "--json")
    found = json.loads(out)
    assert (code, found["messages"], found["files"], found["kept"]) == (0, 13, 1, None)
    assert told(tmp_path / "bag") == before


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_bags_of_others_get_theirs(run_here: Any, tmp_path: Path, plugin: StoragePlugin) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    path = tmp_path / "bag"
    with RosbagsWriter(path, version=9, storage_plugin=plugin) as writer:
        kind = "std_msgs/msg/String"
        connection = writer.add_connection("/words", kind, typestore=store)
        for number in range(5):
            data = store.serialize_cdr(store.types[kind](data=str(number)), kind)  # type: ignore[call-arg]
            writer.write(connection, number * S, data)
    before = told(path)
    (path / "metadata.yaml").unlink()
    assert run_here("bag", "reindex", str(path))[0] == 0
    for name in ("storage_identifier", "relative_file_paths", "duration", "starting_time", "message_count"):
        assert told(path)[name] == before[name], name
    topics = (one["topics_with_message_count"][0] for one in (told(path), before))
    mine, theirs = ((one["message_count"], one["topic_metadata"]["type_description_hash"]) for one in topics)
    assert mine == theirs
    with RosbagsReader(path) as reader:
        assert [store.deserialize_cdr(data, one.msgtype).data for one, _, data in reader.messages()] == list("01234")  # type: ignore[attr-defined]


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_compression_of_rosbag2_is_seen(run_here: Any, tmp_path: Path, mode: str) -> None:
    path = tmp_path / "bag"
    with SqliteWriter(path) as bag, BagReader(split(tmp_path / "mcap", files=3)) as reader:
        for message in reader.raw_messages():
            bag.write_raw(message)
    file = path / "bag_0.db3"
    if mode == "FILE":
        (path / "bag_0.db3.zstd").write_bytes(zstandard.compress(file.read_bytes()))
        file.unlink()
    else:
        with sqlite3.connect(file) as base:
            base.create_function("packed", 1, zstandard.compress)
            base.execute("update messages set data = packed(data)")
    (path / "metadata.yaml").unlink()
    assert run_here("bag", "reindex", str(path))[0] == 0
    assert (told(path)["compression_format"], told(path)["compression_mode"]) == ("zstd", mode)
    assert [text for _, text, _ in data_of(path)] == ["map", "w0", "w1", "w2"]


def without_index(path: Path, *, cut: int) -> Path:
    """An MCAP file as a recorder leaves it that was killed, within a record where `cut` is more than zero."""
    with BagWriter(path) as bag:
        bag.add_topic("/map", String, qos=[LATCHED])
        for number in range(50):
            bag.write("/map", String(data=f"m{number}"), number * S, number)
            bag.flush()
        size = path.stat().st_size
    data = path.read_bytes()
    path.write_bytes(data[: size - cut])
    return path


@pytest.mark.parametrize(("cut", "count"), [(0, 50), (60, 49)])
@pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")
def test_a_file_without_index_gets_one_and_is_kept(run_here: Any, tmp_path: Path, cut: int, count: int) -> None:
    path = without_index(tmp_path / "a.mcap", cut=cut)
    before = path.read_bytes()
    with BagReader(path) as reader:
        assert not reader.has_index
        topic, items = reader.topics["/map"], list(reader.raw_messages())
    code, out, err = run_here("bag", "reindex", str(path))
    kept = tmp_path / "a.mcap.unindexed"
    assert (code, out) == (0, f"{count} messages of 1 topics in 1 files: {path}\n")
    assert f"the old file is renamed to {kept}\n" in err
    assert kept.read_bytes() == before
    with BagReader(path) as reader, path.open("rb") as stream:
        assert reader.has_index and reader.unread_bytes == 0
        assert reader.topics["/map"] == topic and list(reader.raw_messages()) == items and len(items) == count
        summary = make_reader(stream).get_summary()
        assert summary is not None and summary.statistics is not None and summary.statistics.message_count == count
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.mcap", "a.mcap.unindexed"]
    code, _, err = run_here("bag", "reindex", str(path))
    assert (code, err) == (1, f"error: {path} already has an index, and no damage; it needs no reindexing\n")


def test_a_folder_with_a_file_without_index_says_so(run_here: Any, tmp_path: Path) -> None:
    path = split(tmp_path / "bag", files=2)
    (path / "metadata.yaml").unlink()
    without_index(path / "bag_2.mcap", cut=0)
    code, out, err = run_here("bag", "reindex", str(path))
    assert code == 0 and out.startswith("53 messages of 2 topics in 3 files")
    assert err.startswith("bag_2.mcap has no index") and "`rosidl-py bag reindex` adds an index" in err
    assert [one["message_count"] for one in told(path)["files"]] == [2, 1, 50]


def test_a_file_without_any_summary_counts(run_here: Any, tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with (tmp_path / "bag" / "x.mcap").open("wb") as stream:
        writer = McapWriter(stream, index_types=IndexType.NONE, use_statistics=False, repeat_channels=False)
        writer.start("ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/words", "cdr", schema)
        for number in range(3):
            writer.add_message(channel, number * S + 5, String(data=str(number)).encode(), number)
        writer.finish()
    code, out, _ = run_here("bag", "reindex", str(tmp_path / "bag"))
    assert code == 0 and out.startswith("3 messages of 1 topics in 1 files")
    assert (told(tmp_path / "bag")["starting_time"], told(tmp_path / "bag")["duration"]) == (
        {"nanoseconds_since_epoch": 5},
        {"nanoseconds": 2 * S},
    )


def test_what_cannot_be_reindexed_is_told_and_left_alone(run_here: Any, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    mixed = split(tmp_path / "mixed", files=2)
    with SqliteWriter(tmp_path / "db3") as bag, BagReader(mixed) as reader:
        for message in reader.raw_messages():
            bag.write_raw(message)
    shutil.copyfile(tmp_path / "db3" / "db3_0.db3", mixed / "x_2.db3")
    packed = split(tmp_path / "packed", files=2)
    (packed / "packed_2.mcap.zstd").write_bytes(zstandard.compress((packed / "packed_1.mcap").read_bytes()))
    damaged = split(tmp_path / "damaged", files=2)
    (damaged / "damaged_1.mcap").write_bytes(b"no bag")
    taken = without_index(tmp_path / "taken.mcap", cut=0)
    (tmp_path / "taken.mcap.unindexed").write_bytes(b"mine")
    for place, text in (
        (tmp_path / "empty", "folder contains neither metadata.yaml nor bag files"),
        (tmp_path / "nowhere", "file does not exist"),
        (mixed, "its files are mcap and sqlite3; expected files of one kind"),
        (packed, "its files are compressed and not compressed"),
        (damaged, "damaged_1.mcap: damaged"),
        (tmp_path / "db3" / "db3_0.db3", "only MCAP files have an index; pass the folder of the file"),
        (taken, "taken.mcap.unindexed exists already"),
    ):
        metadata = place / "metadata.yaml"
        before = metadata.read_text() if metadata.exists() else None
        code, _, err = run_here("bag", "reindex", str(place))
        assert (code, text in err, "Traceback" in err) == (1, True, False), (place, err)
        assert (metadata.read_text() if metadata.exists() else None) == before
