"""Copies of bags contain every record, or count the missing records."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections import Counter
from contextlib import closing, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from support.bag_samples import memory_limit
from support.example_counts import examples
from support.mcap_records import (
    MAGIC,
    STRING,
    RandomFile,
    attachment_record,
    mapped,
    metadata_record,
    random_files,
    read_contents,
    record,
    sized,
)

from rosidl_py_gen import get_message, ros_cli
from rosidl_py_gen.bags import BagReader, BagWriter, SqliteWriter
from rosidl_py_gen.bags.rewriting import reindex

String: Any = get_message("std_msgs/msg/String")
pytestmark = pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")


def run(*arguments: object) -> dict[str, Any]:
    """Run a bag command in this process, and return its JSON document."""
    out, errors, code = StringIO(), StringIO(), 0
    with redirect_stdout(out), redirect_stderr(errors):
        try:
            ros_cli.main(["bag", *map(str, arguments), "--json"])
        except SystemExit as end:
            code = int(end.code or 0)
    assert code == 0, errors.getvalue()
    document: dict[str, Any] = json.loads(out.getvalue())
    return document


def require_same(path: Path, *originals: RandomFile) -> None:
    """Compare a file with the contents of the originals."""
    copy = read_contents(path)
    for name in ("messages", "attachments", "metadata"):
        expected = sum((getattr(one.contents, name) for one in originals), Counter())
        assert getattr(copy, name) == expected, name
    assert copy.channels == set().union(*(one.contents.channels for one in originals))
    assert copy.schemas == set().union(*(one.contents.schemas for one in originals))
    assert copy.profile == originals[0].contents.profile
    assert len(copy.rosbag2) == 1


@settings(max_examples=examples(60))
@given(random_files())
def test_convert_and_migrate_of_a_file_copy_every_record(original: RandomFile) -> None:
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "a.mcap").write_bytes(original.data)
        (folder / "types/p/msg").mkdir(parents=True)
        (folder / "types/p/msg/T.msg").write_text("int8 x\n")
        done = run("convert", folder / "a.mcap", folder / "b.mcap", "--without-definitions")
        require_same(folder / "b.mcap", original)
        private = original.contents.private_count
        assert done["not_carried_over"] == ({"unknown_records": private} if private else {})
        done = run("migrate", folder / "a.mcap", "-o", folder / "c.mcap", "--path", folder / "types")
        require_same(folder / "c.mcap", original)
        assert done["not_carried_over"] == ({"unknown_records": private} if private else {})


@settings(max_examples=examples(40))
@given(random_files(), st.booleans())
def test_reindex_of_a_file_without_an_index_copies_every_record(original: RandomFile, in_folder: bool) -> None:
    footer = 9 + 20 + len(MAGIC)
    with TemporaryDirectory() as name:
        path = Path(name) / "a_0.mcap"
        path.write_bytes(original.data[:-footer])
        done = reindex(path.parent if in_folder else path)
        require_same(path, original)
        assert (path.parent / "a_0.mcap.unindexed").read_bytes() == original.data[:-footer]
        assert done.messages == original.contents.messages.total()
        assert done.omitted == +Counter(unknown_records=original.contents.private_count)
        if in_folder:
            before = path.read_bytes()
            assert not reindex(path.parent).repaired
            assert path.read_bytes() == before


@settings(max_examples=examples(40))
@given(random_files(for_sqlite=True))
def test_conversion_to_sqlite_counts_records_that_are_not_copied(original: RandomFile) -> None:
    contents = original.contents
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "a.mcap").write_bytes(original.data)
        done = run("convert", folder / "a.mcap", folder / "b", "--storage", "sqlite3", "--without-definitions")
        with closing(sqlite3.connect(folder / "b" / "b_0.db3")) as database:
            messages = Counter(
                database.execute(
                    "select name, serialization_format, timestamp, data from messages "
                    "join topics on topics.id = messages.topic_id"
                ).fetchall()
            )
            topics = {row[0] for row in database.execute("select name from topics")}
    expected: Counter[Any] = Counter()
    counted = Counter(
        attachments=contents.attachments.total(),
        metadata_records=contents.metadata.total(),
        unknown_records=contents.private_count,
        channel_metadata=sum("my_key" in dict(channel[2]) for channel in contents.channels),
    )
    for (channel, sequence, log_time, publish_time, data), count in contents.messages.items():
        expected[channel[0], channel[1], log_time, data] += count
        counted["sequence_numbers"] += count * (sequence != 0)
        counted["publish_times"] += count * (publish_time != log_time)
    assert messages == expected
    assert topics == {channel[0] for channel in contents.channels}
    assert done["not_carried_over"] == dict(+counted)


def without_empty_values(channel: Any) -> Any:
    """Return a channel without empty QoS and hash, which are not channels of their own in a merged bag."""
    topic, encoding, values, schema = channel
    return topic, encoding, tuple(one for one in values if one[1] or one[0] == "my_key"), schema


@settings(max_examples=examples(40))
@given(st.lists(random_files(), min_size=2, max_size=3))
def test_merge_copies_every_record_of_all_bags_in_order(originals: list[RandomFile]) -> None:
    private = sum(one.contents.private_count for one in originals)
    profiles = len({one.contents.profile for one in originals} - {originals[0].contents.profile, ""})
    with TemporaryDirectory() as name:
        paths = [Path(name) / f"{number}.mcap" for number in range(len(originals))]
        for path, original in zip(paths, originals, strict=True):
            path.write_bytes(original.data)
        done = run("merge", Path(name) / "out.mcap", *paths, "--without-definitions")
        copy = read_contents(Path(name) / "out.mcap")
        with (Path(name) / "out.mcap").open("rb") as stream:
            times = [one.log_time for one in StreamReader(stream).records if isinstance(one, Message)]
    assert done["not_carried_over"] == dict(+Counter(unknown_records=private, profiles=profiles))
    expected: Counter[Any] = Counter()
    for original in originals:
        for (channel, *values), count in original.contents.messages.items():
            expected[(without_empty_values(channel), *values)] += count
    found: Counter[Any] = Counter()
    for (channel, *values), count in copy.messages.items():
        found[(without_empty_values(channel), *values)] += count
    assert found == expected and times == sorted(times)
    for kind in ("attachments", "metadata"):
        assert getattr(copy, kind) == sum((getattr(one.contents, kind) for one in originals), Counter()), kind
    channels = [without_empty_values(one) for one in copy.channels]
    assert {*channels} == {without_empty_values(one) for each in originals for one in each.contents.channels}
    assert len({*channels}) == len(channels), "equal channels are joined"
    assert copy.schemas == set().union(*(one.contents.schemas for one in originals))


def write_folder(folder: Path, originals: list[RandomFile], version: int, **values: Any) -> None:
    folder.mkdir()
    names = [f"bag_{number}.mcap" for number in range(len(originals))]
    for name, original in zip(names, originals, strict=True):
        (folder / name).write_bytes(original.data)
    information = {
        "version": version,
        "storage_identifier": "mcap",
        "relative_file_paths": names,
        "duration": {"nanoseconds": 0},
        "starting_time": {"nanoseconds_since_epoch": 0},
        "message_count": 0,
        "topics_with_message_count": [],
        "compression_format": "",
        "compression_mode": "",
        **values,
    }
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))


@settings(max_examples=examples(25))
@given(st.lists(random_files(), min_size=2, max_size=3), st.integers(4, 9))
def test_convert_and_reindex_of_a_folder_copy_every_file(originals: list[RandomFile], version: int) -> None:
    private = sum(one.contents.private_count for one in originals)
    profiles = len({one.contents.profile for one in originals} - {originals[0].contents.profile, ""})
    custom = {"operator": "me", "number": "1.50", "flag": "yes"}
    with TemporaryDirectory() as name:
        bag, copy = Path(name) / "bag", Path(name) / "copy"
        write_folder(bag, originals, version, custom_data=custom, ros_distro="kilted")
        done = run("convert", bag, copy, "--without-definitions")
        require_same(copy / "copy_0.mcap", *originals)
        assert done["not_carried_over"] == dict(+Counter(unknown_records=private, profiles=profiles))
        assert custom_and_distro(copy) == (custom, "kilted")
        run("reindex", bag)
        assert custom_and_distro(bag) == (custom, "kilted")
        for number, original in enumerate(originals):
            if (bag / f"bag_{number}.mcap.unindexed").exists():
                require_same(bag / f"bag_{number}.mcap", original)
            else:
                assert (bag / f"bag_{number}.mcap").read_bytes() == original.data


def custom_and_distro(folder: Path) -> tuple[dict[str, str], str]:
    information = yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    return information["custom_data"], information["ros_distro"]


def one_message(*others: bytes) -> bytes:
    """Return a file without index, with a message and other records."""
    definitions = record(3, struct_id(1), sized("std_msgs/msg/String"), sized("ros2msg"), sized("string data"))
    definitions += record(4, struct_id(1), struct_id(1), sized("/a"), sized("cdr"), mapped({}))
    message = record(5, struct_id(1), bytes(20), STRING)
    return MAGIC + record(1, sized("ros2"), sized("")) + definitions + message + b"".join(others)


def struct_id(number: int) -> bytes:
    return number.to_bytes(2, "little")


WRONG = {
    "attachment with a wrong checksum": attachment_record("a", "", b"data")[:-4] + b"\1\2\3\4",
    "attachment whose data exceed it": record(9, bytes(16), sized(""), sized(""), b"\xff" * 7 + b"\x7f", bytes(4)),
    "attachment whose name exceeds it": record(9, bytes(16), b"\xff\xff\xff\x7f", bytes(4)),
    "attachment that is no text": record(9, bytes(16), sized(b"\xff"), sized(""), bytes(12)),
    "attachment without fields": record(9),
    "metadata with a huge map": record(12, sized("a"), b"\xff\xff\xff\xff"),
    "metadata with a huge key": record(12, sized("a"), sized(b"\xff\xff\xff\xff")),
    "metadata with a huge value": record(12, sized("a"), sized(sized("k") + b"\xff\xff\xff\xff")),
    "metadata that is no text": record(12, sized("a"), sized(sized(b"\xff") + sized("v"))),
    "metadata without fields": record(12),
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_damaged_attachments_and_metadata_are_reported_and_the_rest_is_copied(tmp_path: Path, wrong: bytes) -> None:
    path = tmp_path / "a.mcap"
    intact = metadata_record("site", {"robot": "r2"}), attachment_record("b", "", b"b")
    path.write_bytes(one_message(wrong, *intact) + record(15, bytes(4)))
    with memory_limit(1 << 25):
        done = reindex(path)
    assert len(done.damaged) == 1 and done.messages == 1
    copy = read_contents(path)
    assert (copy.messages.total(), copy.attachments.total(), copy.metadata.total()) == (1, 1, 1)


def test_large_attachment_is_copied_in_pieces(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    content = bytes(1 << 26)
    path.write_bytes(one_message(attachment_record("a", "", content)) + record(15, bytes(4)))
    with memory_limit(1 << 25):
        reindex(path)
    assert read_contents(path).attachments == Counter({("a", "", 1, 2, content): 1})


def test_truncated_chunk_keeps_its_whole_messages_and_counts_the_loss(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BagWriter(path, compression="") as writer:
        for number in range(100):
            writer.write("/a", String(data=f"{number:100}"), number)
    data = path.read_bytes()
    path.write_bytes(data[:8000])
    done = reindex(path)
    assert 0 < done.messages < 100 and done.unread_bytes > 0
    with BagReader(path) as reader:
        assert reader.has_index and [one.log_time for one in reader.raw_messages()] == list(range(done.messages))


def test_selection_of_topics_and_times_copies_all_attachments_and_metadata(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(one_message(attachment_record("a", "", b"x", 2**62), metadata_record("m", {})))
    run("convert", path, tmp_path / "b.mcap", "--topics", "/a", "--start-offset", "0", "--duration", "0.5")
    copy = read_contents(tmp_path / "b.mcap")
    assert (copy.attachments.total(), copy.metadata.total()) == (1, 1)


def test_note_lists_records_that_are_not_carried_over_and_the_reason(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(one_message(attachment_record("a", "", b"x") * 2, metadata_record("m", {})))
    ros_cli.main(["bag", "convert", str(path), str(tmp_path / "b"), "--storage", "sqlite3"])
    assert capsys.readouterr().err == (
        "2 attachments and 1 metadata record are not carried over: SQLite bags have no place for them; "
        "convert to MCAP to keep them\n"
    )


@pytest.mark.parametrize("step", ["write", "rename"])
def test_failed_reindex_leaves_the_bag_unchanged(tmp_path: Path, monkeypatch: Any, step: str) -> None:
    path = tmp_path / "a_0.mcap"
    data = one_message(attachment_record("a", "", b"x"))
    path.write_bytes(data)

    def fail(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        if step == "write":
            patch.setattr("rosidl_py_gen.bags.rewriting.sync_file", fail)
        else:
            patch.setattr(Path, "replace", fail)
        with pytest.raises(OSError, match="No space"):
            reindex(tmp_path)
    assert path.read_bytes() == data
    backup = tmp_path / "a_0.mcap.unindexed"
    assert {one.name for one in tmp_path.iterdir()} <= {path.name, backup.name}
    assert not backup.exists() or step == "rename"
    backup.unlink(missing_ok=True)
    assert reindex(tmp_path).messages == 1


def test_metadata_record_of_rosbag2_is_not_duplicated_and_custom_data_are_copied(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", custom_data={"k": "v"}) as writer:
        writer.write("/a", String(), 1)
    for source, target in [("bag", "b.mcap"), ("b.mcap", "c"), ("c", "d")]:
        storage = ["--storage", "sqlite3"] if target == "c" else []
        run("convert", tmp_path / source, tmp_path / target, *storage)
    assert custom_and_distro(tmp_path / "d")[0] == {"k": "v"}
    assert len(read_contents(tmp_path / "d" / "d_0.mcap").rosbag2) == 1


@pytest.mark.parametrize("ending", ["-wal", "-journal"])
@pytest.mark.parametrize("in_folder", [True, False])
@pytest.mark.parametrize("mode", ["none", "message"])
def test_sqlite_file_with_a_journal_is_complete_after_reindex(
    tmp_path: Path, ending: str, in_folder: bool, mode: Any
) -> None:
    source, folder = tmp_path / "source", tmp_path / "bag"
    with SqliteWriter(source, compression_mode=mode) as writer:
        for number in range(100):
            writer.write("/s", String(data="x" * 1000), number)
    shutil.copytree(source, folder)
    (folder / "metadata.yaml").unlink()
    (folder / "source_0.db3").unlink()
    with closing(sqlite3.connect(source / "source_0.db3", isolation_level=None)) as database:
        if ending == "-wal":
            database.execute("pragma journal_mode=wal")
            database.execute("update messages set timestamp = timestamp + 1000")
        else:  # the transaction is not complete when the recorder is killed
            database.execute("pragma cache_size=1")
            database.execute("begin")
            database.execute("update messages set timestamp = timestamp + 5000, data = data || x'00'")
        for end in ("", ending):
            shutil.copyfile(f"{source}/source_0.db3{end}", f"{folder}/source_0.db3{end}")
    file = folder / "source_0.db3"
    start = 1000 if ending == "-wal" else 0
    done = run("reindex", folder if in_folder else file)
    assert (done["messages"], done["not_carried_over"]) == (100, {})
    assert not Path(f"{file}{ending}").exists() and Path(f"{file}.unindexed{ending}").exists()
    alone = shutil.copyfile(file, tmp_path / "alone.db3")
    for path in (alone, Path(f"{file}.unindexed").rename(tmp_path / "old.db3")):
        if path.name == "old.db3":
            Path(f"{file}.unindexed{ending}").rename(f"{path}{ending}")
        with BagReader(path) as reader:
            assert [(one.log_time, one.message.data) for one in reader] == [
                (start + number, "x" * 1000) for number in range(100)
            ], path
    with closing(sqlite3.connect(alone)) as database:
        assert database.execute("pragma integrity_check").fetchone() == ("ok",)
        assert database.execute("pragma journal_mode").fetchone() == ("delete",)


ONE = b"\0\1\0\0\0\0\x80\x3f"
"""A float32 with the value 1."""


def test_definition_of_a_topic_wins_over_an_unused_one_of_its_type(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2", "tests")
        writer.register_schema("pkg/msg/A", "ros2msg", b"int32 old\n")
        used = writer.register_schema("pkg/msg/A", "ros2msg", b"float32 used\n")
        writer.add_message(writer.register_channel("/a", "cdr", used), 1, ONE, 1)
        writer.finish()
    done = run("convert", tmp_path / "a.mcap", tmp_path / "b", "--storage", "sqlite3")
    assert done["not_carried_over"]["schemas"] == 1
    with BagReader(tmp_path / "b") as reader:
        assert [item.message.used for item in reader.messages()] == [1.0]


def test_channels_that_no_index_lists_are_copied(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=1, compression=CompressionType.NONE)
        writer.start("ros2", "tests")
        schema = writer.register_schema("pkg/msg/A", "ros2msg", b"float32 value\n")
        for number, topic in enumerate(("/a", "/b")):
            writer.add_message(writer.register_channel(topic, "cdr", schema), number, ONE, number)
        state: Any = vars(writer)
        for name in ("chunk_indices", "channels"):
            of_writer = state[f"_Writer__{name}"]
            of_writer.popitem() if isinstance(of_writer, dict) else of_writer.pop()
        statistics = state["_Writer__statistics"]
        statistics.message_count = statistics.chunk_count = statistics.channel_count = 1
        statistics.channel_message_counts.pop(2)
        writer.finish()
    for target in ("b.mcap", "c"):
        run("convert", tmp_path / "a.mcap", tmp_path / target, "--storage", "mcap" if "." in target else "sqlite3")
        with BagReader(tmp_path / target) as reader:
            assert sorted(item.topic for item in reader.messages()) == ["/a", "/b"]


def test_damaged_compression_name_loses_only_its_chunk(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1, compression=CompressionType.LZ4)
        writer.start("ros2", "tests")
        schema = writer.register_schema("pkg/msg/A", "ros2msg", b"float32 value\n")
        channel = writer.register_channel("/a", "cdr", schema)
        for number in range(4):
            writer.add_message(channel, number, ONE, number)
        writer.finish()
    path.write_bytes(path.read_bytes().replace(b"\3\0\0\0lz4", b"\3\0\0\0LZ4", 1))
    done = reindex(path)
    assert done.messages == 3 and len(done.damaged) == 1
