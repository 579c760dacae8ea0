"""``rosidl-py bag`` with damaged bags, bags without index or definitions, and bags with types that are not of ROS 2."""

from __future__ import annotations

import json
import shutil
import sqlite3
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import yaml
import zstandard
from mcap.reader import make_reader
from mcap.writer import IndexType
from rosbags.rosbag2 import Reader as RosbagsReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore
from support.bag_damage import COUNT, String, zeroed_chunk
from support.bag_samples import copy_to_sqlite, write_foreign, write_humble, write_map_and_words

from rosidl_py_gen import compile_definition, type_hash
from rosidl_py_gen.bags import BagReader, BagTopic, BagWriter, RawMessage
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from support.worlds import World


S = 1_000_000_000
LATCHED = QoSProfile().transient_local()
NAME = "old_msgs/msg/Reading"
OLD_TEXT, NEW_TEXT = "float32 value\nfloat32 weight\n", "float32 value\n"


def package(folder: Path, text: str) -> str:
    (folder / "msg").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>old_msgs</name></package>")
    (folder / "msg" / "Reading.msg").write_text(text)
    return str(folder)


@pytest.fixture
def humble(tmp_path: Path) -> str:
    then = compile_definition(NAME, OLD_TEXT)
    readings = [(stamp, then(value=stamp, weight=2.0).encode()) for stamp in (1, 2, 3)]
    texts = [(stamp, String(data="a").encode()) for stamp in (1, 2, 3)]
    topics = ("/reading", NAME, readings), ("/s", "std_msgs/msg/String", texts), ("/silent", "old_msgs/msg/Never", [])
    return str(write_humble(tmp_path / "humble.db3", *topics))


def test_convert_adds_definitions_from_path_to_bag_without_definitions(
    run_here: Any, humble: str, tmp_path: Path
) -> None:
    out, folder = tmp_path / "out.mcap", package(tmp_path / "then" / "old_msgs", OLD_TEXT)
    code, printed, err = run_here("bag", "convert", humble, str(out), "--path", folder)
    assert code == 0 and printed == f"6 messages of 3 topics in {out}\n", err
    assert "definitions that the bag does not contain are written: old_msgs/msg/Reading from " in err
    assert "/silent [old_msgs/msg/Never] is written without a definition" in err
    with BagReader(out) as reader:
        assert reader.topics["/reading"].definition.startswith(OLD_TEXT)
        assert reader.topics["/reading"].type_hash == type_hash(compile_definition(NAME, OLD_TEXT))
        assert reader.definition("/reading").origin == "the bag"
        assert [item.message.value for item in reader.messages("/reading")] == [1, 2, 3]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_convert_fails_for_types_without_definition_unless_permitted(
    run_here: Any, humble: str, tmp_path: Path, storage: str
) -> None:
    out = tmp_path / "out"
    code, _, err = run_here("bag", "convert", humble, str(out), "-s", storage)
    assert code == 1 and not out.exists()
    assert ": no definitions of old_msgs/msg/Reading: /reading: the bag has no definition" in err
    assert "msg/Never" not in err and "msg/String" not in err  # nothing is lost of what was never sent
    assert run_here("bag", "convert", humble, str(tmp_path / "part"), "--topics", "/s")[0] == 0
    code, _, err = run_here("bag", "convert", humble, str(out), "-s", storage, "--without-definitions")
    assert code == 0 and "/reading [old_msgs/msg/Reading] is written without a definition" in err
    with BagReader(out) as reader:
        assert len(list(reader.messages("/reading", raw=True))) == 3


def test_convert_refuses_definition_that_does_not_fit_messages(run_here: Any, humble: str, tmp_path: Path) -> None:
    folder = package(tmp_path / "now" / "old_msgs", NEW_TEXT)
    code, _, err = run_here("bag", "convert", humble, str(tmp_path / "out.mcap"), "--path", folder)
    assert code == 1 and not (tmp_path / "out.mcap").exists()
    assert "4 of 12 bytes of a message are after its last field" in err and "Reading.msg" in err


def test_convert_and_migrate_report_damaged_page_not_missing_definition(run_here: Any, tmp_path: Path) -> None:
    messages = [(1, String(data="x" * 10_000).encode())]  # more than a page
    bag = write_humble(tmp_path / "humble.db3", ("/s", "std_msgs/msg/String", messages))
    data, page = bytearray(bag.read_bytes()), 4096
    for at in range(0, len(data), page):
        if data[at + 4 : at + 8] == b"xxxx":
            data[at : at + 4] = b"\x7f\xff\xff\xff"  # the next page
    bag.write_bytes(data)
    definitions = tmp_path / "std_msgs"
    (definitions / "msg").mkdir(parents=True)
    (definitions / "msg" / "String.msg").write_text("string data\nint8 more\n")
    for command, *options in (("convert", str(tmp_path / "out.mcap")), ("migrate", "--dry-run", "--path", definitions)):
        code, _, err = run_here("bag", command, str(bag), *map(str, options))
        assert code == 1 and "disk image is malformed\n" in err, err


def test_verbose_info_prints_origin_of_definitions(run_here: Any, humble: str, tmp_path: Path) -> None:
    folder = package(tmp_path / "then" / "old_msgs", OLD_TEXT)
    out = run_here("bag", "info", humble, "--verbose", "--path", folder)[1]
    assert "old_msgs/msg/Reading.msg (guessed by name)" in out
    bag_information = {
        one["name"]: one for one in json.loads(run_here("bag", "info", humble, "-v", "--json")[1])["topics"]
    }
    assert (
        bag_information["/reading"]["definition"] is None and "no definition" in bag_information["/reading"]["problem"]
    )
    assert bag_information["/s"]["is_recorded"] is False and bag_information["/s"]["definition_hash"] == type_hash(
        String
    )
    assert "Types:      3 have no definition in the bag; --verbose prints" in run_here("bag", "info", humble)[1]
    assert "definition" not in json.loads(run_here("bag", "info", humble, "--json")[1])["topics"][0]


def odd_bag(path: Path) -> Path:
    """Write a bag of topics that are invalid in ROS 2, between two valid ones."""
    with BagWriter(path) as writer:
        rows = {"/good": "std_msgs/msg/String", "/none": "", "/one": "String", "/four": "std_msgs/msg/String/x"}
        rows |= {"/two": "nobody_has/Thing", "no slash": "std_msgs/msg/String", "/ros1": "std_msgs/String"}
        for number, (name, kind) in enumerate(rows.items(), 1):
            writer.add_topic(name, BagTopic(name, kind, message_encoding="ros1" if name == "/ros1" else "cdr"))
            writer.write(name, String(data=name).encode(), number)
    return path


async def test_play_skips_topics_with_invalid_name_type_or_encoding(memory: World, tool: Any, tmp_path: Path) -> None:
    node = memory.node("robot", enable_rosout=False, parameter_events=False)
    received = node.create_subscription(String, "/good")
    process = await tool.start("bag", "play", str(odd_bag(tmp_path / "odd.mcap")))
    assert (await received.receive(timeout_s=20)).data == "/good"
    ended = await tool.end(process)
    assert ended.code == 0 and "published 2 messages of 2 topics" in ended.err, ended.err
    for text in (
        '/none [] is skipped: "" is not an interface name',
        '/one [String] is skipped: "String" is not an interface name',
        "/four [std_msgs/msg/String/x] is skipped",
        "no slash [std_msgs/msg/String] is skipped",
        "/ros1 [std_msgs/String] is skipped: messages are ros1; expected cdr",
    ):
        assert text in ended.err, ended.err


def test_convert_writes_each_channel_with_definition_of_its_type_hash(run_here: Any, tmp_path: Path) -> None:
    then, now = compile_definition(NAME, OLD_TEXT), compile_definition(NAME, NEW_TEXT)
    bag, out = tmp_path / "two.mcap", tmp_path / "out.mcap"
    with BagWriter(bag) as writer:
        for number, cls in enumerate((then, now)):
            known = BagTopic("/reading", NAME, "", "", type_hash=type_hash(cls))
            writer.write_raw(RawMessage(known, cls(value=number).encode(), number, number))
    folder = package(tmp_path / "then" / "old_msgs", OLD_TEXT)  # the other one is known to this process
    assert run_here("bag", "convert", str(bag), str(out), "--path", folder)[0] == 0
    with BagReader(out) as reader:
        assert [channel.definition for channel in reader.channels] == [OLD_TEXT, NEW_TEXT]
        assert [item.message.value for item in reader] == [0, 1]
    with BagReader(bag, search_path=folder, typestore={NAME: NEW_TEXT}) as reader:
        assert [reader.definition(channel).message_class for channel in reader.channels] == [then, now]
        assert all(reader.definition(channel).is_recorded for channel in reader.channels)


async def test_play_ignores_definition_that_does_not_fit_messages(
    memory: World, tool: Any, humble: str, tmp_path: Path
) -> None:
    """With the type hash of a wrong definition, subscriptions with the right one would not match."""
    folder = package(tmp_path / "now" / "old_msgs", NEW_TEXT)
    node = memory.node("robot", enable_rosout=False, parameter_events=False)
    received = node.create_subscription(compile_definition(NAME, OLD_TEXT), "/reading")
    process = await tool.start("bag", "play", humble, "--path", folder, "--topics", "/reading")
    assert (await received.receive(timeout_s=20)).weight == 2.0
    ended = await tool.end(process)
    assert ended.code == 0 and "4 of 12 bytes of a message are after its last field" in ended.err, ended.err


def test_failed_convert_leaves_no_output(run_here: Any, tmp_path: Path) -> None:
    texts = {"/one": "int32 a\nint32 b", "/two": "int32 b\nint32 a"}
    channels = [(topic, "my/msg/Pair", text, [(1, bytes(12))]) for topic, text in texts.items()]
    source = write_foreign(tmp_path / "two.mcap", *channels)
    code, _, err = run_here("bag", "convert", str(source), str(tmp_path / "copy"), "--storage", "sqlite3")
    assert code == 1 and "two definitions of my/msg/Pair" in err
    assert not (tmp_path / "copy").exists()
    code, _, err = run_here("bag", "convert", str(source), str(tmp_path / "copy.db3"))
    assert code == 1 and "copy.db3: BagWriter writes MCAP files" in err


PLACE = "log times from 80 to 119 ns, topics /t0, /t1"
LEFT = COUNT - 40


def test_convert_table_sql_and_reindex_skip_a_damaged_chunk(run_here: Any, tmp_path: Path) -> None:
    path, copy = str(tmp_path / "a.mcap"), str(tmp_path / "copy.mcap")
    zeroed_chunk(tmp_path / "a.mcap", 2)
    code, out, err = run_here("bag", "convert", path, copy, "--json")
    document = json.loads(out)
    assert (code, document["messages"], PLACE in err, err.count("warning")) == (3, LEFT, True, 1)
    (part,) = document["damaged"]
    assert (part["topics"], part["start_ns"], part["end_ns"]) == (["/t0", "/t1"], 80, 119)
    with BagReader(copy) as reader:
        assert sum(1 for _ in reader) == LEFT
    assert run_here("bag", "convert", copy, str(tmp_path / "again.mcap"))[0] == 0

    table = ("bag", "table", path, "--workers", "1", "--out")
    code, _, err = run_here(*table, str(tmp_path / "strict"))
    assert (code, PLACE in err) == (1, True)
    code, out, err = run_here(*table, str(tmp_path / "rows"), "--skip-damaged")
    assert (code, out.startswith(f"{LEFT} messages of 2 topics"), PLACE in err) == (3, True, True)
    query = ("bag", "sql", 'select count(*) as n from "/t0"', path, "--format", "csv")
    assert run_here(*query)[0] == 1
    code, out, err = run_here(*query, "--skip-damaged")
    assert (code, out.splitlines(), PLACE in err) == (3, ["n", str(LEFT // 2)], True)

    code, out, _ = run_here("bag", "reindex", path, "--json")
    assert (code, json.loads(out)["messages"], len(json.loads(out)["damaged"])) == (3, LEFT, 1)
    assert run_here("bag", "convert", path, str(tmp_path / "whole.mcap"))[0] == 0


def test_info_counts_intact_messages_of_damaged_file_without_index(run_here: Any, tmp_path: Path) -> None:
    zeroed_chunk(tmp_path / "a.mcap", 2, has_index=False)
    code, out, err = run_here("bag", "info", str(tmp_path / "a.mcap"))
    assert (code, f"Messages:   {LEFT}" in out, "Damaged:    1 part" in out, PLACE in err) == (0, True, True, True)
    advice = "`rosidl-py bag convert` creates a complete bag"
    assert f"Index:      missing: the recorder was killed, or a file was cut off; {advice}" in out


async def test_play_publishes_intact_messages_of_damaged_file(memory: World, tool: Any, tmp_path: Path) -> None:
    zeroed_chunk(tmp_path / "a.mcap", 2)
    node = memory.node("robot", enable_rosout=False, parameter_events=False)
    received: list[str] = []
    node.create_subscription(String, "t0", lambda message: received.append(message.data), qos=QoSProfile(depth=1000))
    ended = await tool("bag", "play", str(tmp_path / "a.mcap"))
    assert (ended.code, PLACE in ended.err, len(received)) == (3, True, LEFT // 2)


def split(path: Path, files: int = 12) -> Path:
    """Write an MCAP folder with one message per second, each in its own file, and a latched message."""
    return write_map_and_words(path, files, S, split_s=1)


def bag_information(folder: Path) -> Any:
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def data_of(path: Path) -> list[tuple[str, str, int]]:
    with BagReader(path) as reader:
        return [(item.topic, item.message.data, item.log_time) for item in reader]


@pytest.mark.parametrize("left", ["missing", "empty", "no YAML", "of another bag"])
def test_reindex_restores_metadata_of_mcap_folder(run_here: Any, tmp_path: Path, left: str) -> None:
    path = split(tmp_path / "bag")
    before, items = bag_information(path), data_of(path)
    file = path / "metadata.yaml"
    if left == "missing":
        file.unlink()
    elif left == "of another bag":
        shutil.copyfile(split(tmp_path / "other", files=3) / "metadata.yaml", file)
    else:
        file.write_text("" if left == "empty" else "{")
    code, out, err = run_here("bag", "reindex", str(path))
    assert (code, out, err) == (0, f"13 messages of 2 topics in 12 files: {file}\n", "")
    assert bag_information(path) == before  # in the order of numbers, not of letters
    assert before["relative_file_paths"][1:3] == ["bag_1.mcap", "bag_2.mcap"]
    assert data_of(path) == items
    with RosbagsReader(path) as reference:
        assert reference.message_count == 13
    assert sorted(one.name for one in path.iterdir()) == sorted([*before["relative_file_paths"], "metadata.yaml"])


def test_reindex_restores_metadata_of_sqlite_folder(run_here: Any, tmp_path: Path) -> None:
    before = bag_information(copy_to_sqlite(split(tmp_path / "mcap"), tmp_path / "bag"))
    (tmp_path / "bag" / "metadata.yaml").unlink()
    code, out, _ = run_here("bag", "reindex", str(tmp_path / "bag"), "--json")
    found = json.loads(out)
    assert (code, found["messages"], found["files"], found["kept"]) == (0, 13, 1, None)
    assert bag_information(tmp_path / "bag") == before


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_reindex_restores_metadata_of_bag_written_by_rosbags(
    run_here: Any, tmp_path: Path, plugin: StoragePlugin
) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    path = tmp_path / "bag"
    with RosbagsWriter(path, version=9, storage_plugin=plugin) as writer:
        kind = "std_msgs/msg/String"
        connection = writer.add_connection("/words", kind, typestore=store)
        for number in range(5):
            data = store.serialize_cdr(store.types[kind](data=str(number)), kind)  # type: ignore[call-arg]
            writer.write(connection, number * S, data)
    before = bag_information(path)
    (path / "metadata.yaml").unlink()
    assert run_here("bag", "reindex", str(path))[0] == 0
    for name in ("storage_identifier", "relative_file_paths", "duration", "starting_time", "message_count"):
        assert bag_information(path)[name] == before[name], name
    topics = (one["topics_with_message_count"][0] for one in (bag_information(path), before))
    mine, reference = ((one["message_count"], one["topic_metadata"]["type_description_hash"]) for one in topics)
    assert mine == reference
    with RosbagsReader(path) as reader:
        assert [store.deserialize_cdr(data, one.msgtype).data for one, _, data in reader.messages()] == list("01234")  # type: ignore[attr-defined]


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_reindex_recognizes_zstd_compression_of_rosbag2(run_here: Any, tmp_path: Path, mode: str) -> None:
    path = copy_to_sqlite(split(tmp_path / "mcap", files=3), tmp_path / "bag")
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
    assert (bag_information(path)["compression_format"], bag_information(path)["compression_mode"]) == ("zstd", mode)
    assert json.loads(run_here("bag", "info", str(path), "--json")[1])["storage"] == "sqlite3"
    assert [text for _, text, _ in data_of(path)] == ["map", "w0", "w1", "w2"]


def without_index(path: Path, *, cut: int) -> Path:
    """Write an MCAP file of a killed recorder; with `cut` above zero, its last record is incomplete."""
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
def test_reindex_writes_index_and_keeps_old_file(run_here: Any, tmp_path: Path, cut: int, count: int) -> None:
    path = without_index(tmp_path / "a.mcap", cut=cut)
    before = path.read_bytes()
    with BagReader(path) as reader:
        assert not reader.has_index
        topic, items = reader.topics["/map"], list(reader.raw_messages())
    code, out, err = run_here("bag", "reindex", str(path))
    kept = tmp_path / "a.mcap.unindexed"
    assert (code, out) == (0, f"{count} messages of 1 topic in 1 file: {path}\n")
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


def test_reindex_of_a_folder_adds_missing_indexes(run_here: Any, tmp_path: Path) -> None:
    path = split(tmp_path / "bag", files=2)
    (path / "metadata.yaml").unlink()
    without_index(path / "bag_2.mcap", cut=0)
    code, out, err = run_here("bag", "reindex", str(path))
    assert code == 0 and out.startswith("53 messages of 2 topics in 3 files")
    backup = path / "bag_2.mcap.unindexed"
    assert err == f"bag_2.mcap had no index and is rewritten; the old file is renamed to {backup}\n"
    with BagReader(path) as reader:
        assert reader.has_index
    assert [one["message_count"] for one in bag_information(path)["files"]] == [2, 1, 50]


def test_reindex_counts_messages_of_file_without_summary(run_here: Any, tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    messages = [(number * S + 5, String(data=str(number)).encode()) for number in range(3)]
    channel = "/words", "std_msgs/msg/String", "string data", messages
    options: dict[str, Any] = {"index_types": IndexType.NONE, "use_statistics": False, "repeat_channels": False}
    write_foreign(tmp_path / "bag" / "x.mcap", channel, **options)
    code, out, _ = run_here("bag", "reindex", str(tmp_path / "bag"))
    assert code == 0 and out.startswith("3 messages of 1 topic in 1 file")
    assert (bag_information(tmp_path / "bag")["starting_time"], bag_information(tmp_path / "bag")["duration"]) == (
        {"nanoseconds_since_epoch": 5},
        {"nanoseconds": 2 * S},
    )


def test_reindex_reports_unsuitable_bags_and_changes_no_metadata(run_here: Any, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    mixed = split(tmp_path / "mixed", files=2)
    copy_to_sqlite(mixed, tmp_path / "db3")
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
