"""``rosidl-py bag merge``: order, joined channels, offsets, and what differs between bags."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from mcap.writer import CompressionType, Writer
from support.bag_damage import COUNT, zeroed_chunk
from support.bag_samples import memory_limit, write_humble, write_strings
from support.mcap_records import attachment_record, metadata_record, read_contents

from rosidl_py_gen import compile_definition, get_message, type_name
from rosidl_py_gen.bags import BagReader, BagTopic, BagWriter, SqliteWriter
from rosidl_py_gen.bags.metadata import OfferedQoS
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from pathlib import Path

S = 1_000_000_000
String: Any = get_message("std_msgs/msg/String")
OLD, NEW = "string data\n", "string data\nint8 more\n"


def read(path: Path) -> list[tuple[str, str, int]]:
    with BagReader(path) as reader:
        return [(one.topic, one.message.data, one.log_time) for one in reader.messages()]


@pytest.mark.parametrize(("first", "second"), [("a.mcap", "b.mcap"), ("a.mcap", "b"), ("a", "b"), ("a", "b.mcap")])
@pytest.mark.parametrize("target", ["out.mcap", "out", "sqlite3"])
def test_merge_writes_messages_by_log_time_in_one_channel(
    run_here: Any, tmp_path: Path, first: str, second: str, target: str
) -> None:
    for name, start in ((first, 0), (second, 1)):
        with (BagWriter if name.endswith(".mcap") else SqliteWriter)(tmp_path / name) as bag:
            bag.add_topic("/s", String, qos=[QoSProfile().best_effort()])
            for number in range(3):
                bag.write("/s", String(data=name), S + 2 * number + start)
    out = tmp_path / target
    options = ["--storage", "sqlite3"] if target == "sqlite3" else []
    done = run_here("bag", "merge", str(out), str(tmp_path / first), str(tmp_path / second), *options)
    assert done == (0, f"6 messages of 1 topic of 2 bags in {out}\n", "")
    assert read(out) == [("/s", [first, second][number % 2], S + number) for number in range(6)]
    with BagReader(out) as reader:
        channel, *others = (one.channel for one in reader.raw_messages())
        assert all(one is channel for one in others)
        assert OfferedQoS.parse(channel.offered_qos) == [QoSProfile().best_effort()] and channel.type_hash


def test_equal_times_are_ordered_by_the_arguments(run_here: Any, tmp_path: Path) -> None:
    bags = [str(write_strings(tmp_path / f"{name}.mcap", [name] * 3, f"/{name}", step_ns=0)) for name in "cab"]
    assert run_here("bag", "merge", str(tmp_path / "out"), *bags)[0] == 0
    assert [data for _, data, _ in read(tmp_path / "out")] == list("cccaaabbb")


def test_offsets_are_exact_and_apply_to_log_and_publish_times(run_here: Any, tmp_path: Path) -> None:
    a, b, out = tmp_path / "a.mcap", tmp_path / "b=1", tmp_path / "out.mcap"
    start = 1_732_880_000_123_456_789
    for path in (a, b):
        with BagWriter(path) as bag:
            bag.write("/s", String(data=path.name), start, start - 7)
    offsets = "--offset", f"{b}/=-0.000000001", "--offset", f"{a}=1.25"
    assert run_here("bag", "merge", str(out), str(a), str(b), *offsets)[0] == 0
    with BagReader(out) as reader:
        times = [(one.message.data, one.log_time, one.publish_time) for one in reader]
    assert times == [("b=1", start - 1, start - 8), ("a.mcap", start + S * 5 // 4, start + S * 5 // 4 - 7)]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--offset", "a=x"), "--offset a=x: got 'x'; expected a number of seconds below"),
        (("--offset", "a=nan"), "--offset a=nan: got 'nan'; expected a number"),
        (("--offset", "a=1e30"), "--offset a=1e30: got '1e30'; expected a number"),
        (("--offset", "a=1e1000000"), "--offset a=1e1000000: got '1e1000000'; expected a number"),
        (("--offset", "c=1"), "--offset c=1: expected BAG=SECONDS with a bag of the arguments"),
        (("--offset", "1"), "--offset 1: expected BAG=SECONDS with a bag of the arguments"),
        (("--offset", "a=1", "--offset", "a=2"), "--offset a=2: a has an offset already"),
        (("a/",), "a/ is given twice"),
    ],
)
def test_wrong_offsets_and_repeated_bags_are_refused(
    run_here: Any, tmp_path: Path, monkeypatch: Any, options: tuple[str, ...], reason: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run_here("bag", "merge", "out", "a", "b", *options)
    assert (code, out) == (2, "") and reason in err, err


def test_offset_to_times_before_1970_fails_and_leaves_no_bag(run_here: Any, tmp_path: Path) -> None:
    a = write_strings(tmp_path / "a.mcap", ["x"])
    for out in (tmp_path / "out", tmp_path / "out.mcap"):
        code, _, err = run_here("bag", "merge", str(out), str(a), "--offset", f"{a}=-1")
        assert code == 1 and "/s: log time -1000000000 is not from 0" in err
        assert not out.exists()


def test_unknown_publish_times_stay_unknown(run_here: Any, tmp_path: Path) -> None:
    a = tmp_path / "a.mcap"
    with BagWriter(a) as bag:
        bag.write("/s", get_message("std_msgs/msg/String")(data="x"), log_time_ns=9_000_000_000, publish_time_ns=0)
    out = tmp_path / "out.mcap"
    assert run_here("bag", "merge", str(out), str(a), "--offset", f"{a}=-2")[0] == 0
    with BagReader(out) as bag:
        assert [(one.log_time, one.publish_time) for one in bag.raw_messages()] == [(7_000_000_000, 0)]


def test_existing_output_is_refused(run_here: Any, tmp_path: Path) -> None:
    a = write_strings(tmp_path / "a.mcap", ["x"])
    before = a.read_bytes()
    assert run_here("bag", "merge", str(a), str(a)) == (1, "", f"error: {a} exists already\n")
    assert a.read_bytes() == before


@pytest.mark.parametrize("other", [("std_msgs/msg/String", NEW), ("other_msgs/msg/Text", OLD)])
def test_other_type_or_definition_has_a_channel_of_its_own_and_a_note(
    run_here: Any, tmp_path: Path, other: tuple[str, str]
) -> None:
    a, b = write_strings(tmp_path / "a.mcap", ["old"]), tmp_path / "b.mcap"
    with BagWriter(b) as bag:
        bag.write("/s", compile_definition(*other)(data="new"), 5)
    out = tmp_path / "out"
    code, printed, err = run_here("bag", "merge", str(out), str(a), str(b))
    assert (code, printed) == (0, f"2 messages of 1 topic of 2 bags in {out}\n")
    types = ", ".join(dict.fromkeys(["std_msgs/msg/String", other[0]]))
    assert err == f"/s has messages of 2 definitions, of {types}; each has its own channel\n"
    with BagReader(out) as reader:
        channels = [one.channel for one in reader.raw_messages()]
        assert [(one.type_name, one.definition) for one in channels] == [
            ("std_msgs/msg/String", "string data"),
            (other[0], next(one.definition for one in BagReader(b).channels)),
        ]
        assert [type_name(type(one.message)) for one in reader] == ["std_msgs/msg/String", other[0]]
        assert [one.message.data for one in reader] == ["old", "new"]
    code, _, err = run_here("bag", "merge", str(tmp_path / "sql"), str(a), str(b), "--storage", "sqlite3")
    assert code == 1 and "SQLite bags have one definition per topic; write MCAP files" in err
    assert not (tmp_path / "sql").exists()


def test_sqlite_output_omits_unused_definition_of_type_with_two_definitions(run_here: Any, tmp_path: Path) -> None:
    a, b = tmp_path / "a.mcap", write_strings(tmp_path / "b.mcap", ["x"])
    with a.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2", "somebody")
        writer.register_schema("std_msgs/msg/String", "ros2msg", NEW.encode())
        writer.finish()
    code, _, err = run_here("bag", "merge", str(tmp_path / "out"), str(a), str(b), "--storage", "sqlite3")
    assert code == 0 and "1 schema without a topic is not carried over" in err
    with BagReader(tmp_path / "out") as reader:
        assert reader.topics["/s"].definition == "string data" and read(tmp_path / "out") == [("/s", "x", 0)]


def test_other_qos_is_another_channel_and_both_profiles_in_sqlite(run_here: Any, tmp_path: Path) -> None:
    profiles = [QoSProfile().best_effort(), QoSProfile().transient_local()]
    bags = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    for path, profile in zip(bags, profiles, strict=True):
        with BagWriter(path) as bag:
            bag.add_topic("/s", String, qos=[profile])
            bag.write("/s", String(data="x"), 1)
    out, sql = tmp_path / "out.mcap", tmp_path / "sql"
    assert run_here("bag", "merge", str(out), *map(str, bags))[0::2] == (0, "")
    with BagReader(out) as reader:
        stored = [OfferedQoS.parse(one.channel.offered_qos) for one in reader.raw_messages()]
        assert stored == [[profiles[0]], [profiles[1]]] and len(reader.channels) == 1
    assert run_here("bag", "merge", str(sql), *map(str, bags), "--storage", "sqlite3")[0::2] == (0, "")
    with BagReader(sql) as reader:
        assert OfferedQoS.parse(reader.topics["/s"].offered_qos) == profiles


def with_records(path: Path, *records: bytes) -> Path:
    """Write a file without index, with a message and other records."""
    data = write_strings(path, ["x"], compression="").read_bytes()
    path.write_bytes(data[: data.index(b"\x0f\x04\0\0\0\0\0\0\0")] + b"".join(records))
    return path


def test_attachments_and_metadata_of_all_bags_are_kept(run_here: Any, tmp_path: Path) -> None:
    a = with_records(tmp_path / "a.mcap", attachment_record("a", "", b"1"), metadata_record("site", {"robot": "a"}))
    b = with_records(tmp_path / "b.mcap", attachment_record("b", "", b"2"), metadata_record("site", {"robot": "b"}))
    out = tmp_path / "out.mcap"
    code, _, err = run_here("bag", "merge", str(out), str(a), str(b), "--offset", f"{b}=1")
    assert code == 0 and f"{b}: attachments keep their times; --offset is for messages\n" in err
    assert f"{a}: attachments" not in err
    contents = read_contents(out)
    assert sorted(contents.attachments) == [("a", "", 1, 2, b"1"), ("b", "", 1, 2, b"2")]
    assert sorted(contents.metadata) == [("site", (("robot", "a"),)), ("site", (("robot", "b"),))]


def test_custom_data_of_all_bags_is_merged_and_conflicts_are_counted(run_here: Any, tmp_path: Path) -> None:
    for name, custom in (("a", {"place": "hall", "x": "1"}), ("b", {"place": "yard", "y": "2"})):
        write_strings(tmp_path / name, ["x"], custom_data=custom)
    out = tmp_path / "out"
    code, _, err = run_here("bag", "merge", str(out), str(tmp_path / "a"), str(tmp_path / "b"))
    assert code == 0
    assert "value of custom_data" in err or "values of custom_data" in err
    information = yaml.safe_load((out / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["custom_data"] == {"place": "yard", "x": "1", "y": "2"}


def test_damaged_parts_of_a_bag_are_reported_and_the_rest_is_merged(run_here: Any, tmp_path: Path) -> None:
    a, b, out = tmp_path / "a.mcap", write_strings(tmp_path / "b.mcap", ["x"] * 5, "/b"), tmp_path / "out.mcap"
    zeroed_chunk(a, 2)
    intact = COUNT * 4 // 5
    code, printed, err = run_here("bag", "merge", str(out), str(a), str(b), "--json")
    document = json.loads(printed)
    assert code == 3 and err.startswith(f"warning: {a}: skipped a damaged part")
    assert document["messages"] == intact + 5 and document["bags"] == 2
    assert [one["file"] for one in document["damaged"]] == [str(a)]
    with BagReader(out) as reader:
        assert sum(1 for _ in reader) == intact + 5


def test_bag_without_definitions_gets_them_or_is_refused(run_here: Any, tmp_path: Path) -> None:
    a = write_strings(tmp_path / "a.mcap", ["x"])
    humble = write_humble(
        tmp_path / "humble.db3",
        ("/s", "std_msgs/msg/String", [(5, String(data="h").encode())]),
        ("/odd", "nobody_has/msg/Odd", [(6, b"\0\1\0\0\1")]),
    )
    out = tmp_path / "out"
    code, _, err = run_here("bag", "merge", str(out), str(a), str(humble))
    assert code == 1 and "no definitions of nobody_has/msg/Odd" in err and not out.exists()
    code, _, err = run_here("bag", "merge", str(out), str(a), str(humble), "--without-definitions")
    assert code == 0 and "/odd [nobody_has/msg/Odd] is written without a definition" in err
    with BagReader(out) as reader:
        assert [one.message.data for one in reader.messages("/s")] == ["x", "h"]
        assert [one.message for one in reader.messages("/odd", raw=True)] == [b"\0\1\0\0\1"]


def test_memory_does_not_grow_with_the_size_of_bags(run_here: Any, tmp_path: Path) -> None:
    text = String(data="x" * 100_000).encode()
    bags = []
    for number in range(4):
        path = tmp_path / f"{number}.mcap"
        bags.append(str(path))
        with BagWriter(path, compression="") as bag:
            bag.add_topic("/s", BagTopic("/s", "std_msgs/msg/String", OLD))
            for index in range(200):
                bag.write("/s", text, number + index * 4)
    with memory_limit(24 << 20):
        assert run_here("bag", "merge", str(tmp_path / "out.mcap"), *bags, "--compression", "none")[0] == 0
    with BagReader(tmp_path / "out.mcap") as reader:
        assert [one.log_time for one in reader.raw_messages()] == list(range(800))
