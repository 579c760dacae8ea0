"""Bags without definitions: the definition that is used, and errors if it differs from the recording's."""

from __future__ import annotations

import sqlite3
import struct
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from support.bag_samples import write_foreign, write_humble

from rosidl_py_gen import compile_definition, get_message, type_hash
from rosidl_py_gen.bags import BagError, BagReader, BagTopic, BagWarning, BagWriter, SqliteWriter
from rosidl_py_gen.bags.definition_lookup import WrongDefinitionError
from rosidl_py_gen.bags.writer import topic_of
from rosidl_py_gen.errors import RosidlError

Empty: Any = get_message("std_msgs/msg/Empty")
String: Any = get_message("std_msgs/msg/String")
NAME = "old_msgs/msg/Reading"
OLD, NEW, LONG = "float32 value\nfloat32 weight\n", "float32 value\n", "float32 value\nfloat32 weight\nstring unit\n"


def package(folder: Path, text: str) -> Path:
    """Write a source package with one message."""
    (folder / "msg").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>old_msgs</name></package>")
    (folder / "msg" / "Reading.msg").write_text(text)
    return folder


def humble_bag(folder: Path, name: str, samples: list[bytes], *, hash: str = "") -> Path:
    """Write a folder as rosbag2 of Humble does; `hash` is in metadata.yaml, as in later distributions."""
    folder.mkdir()
    write_humble(folder / "bag_0.db3", ("/reading", name, enumerate(samples, 1)))
    topic = {"name": "/reading", "type": name, "serialization_format": "cdr", "offered_qos_profiles": ""}
    told = {
        "version": 5,
        "storage_identifier": "sqlite3",
        "relative_file_paths": ["bag_0.db3"],
        "topics_with_message_count": [
            {"topic_metadata": {**topic, "type_description_hash": hash}, "message_count": len(samples)}
        ],
    }
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": told}))
    return folder


def reading(text: str, **values: Any) -> Any:
    return compile_definition(NAME, text)(**values)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return humble_bag(tmp_path / "bag", NAME, [reading(OLD, value=n, weight=2.0).encode() for n in range(200)])


def test_definition_from_search_path_or_typestore_is_used_with_a_warning(
    bag: Path, tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    folder = package(tmp_path / "then" / "old_msgs", OLD)
    with BagReader(bag, search_path=folder) as reader:
        found = reader.definition("/reading")
        assert found.origin.endswith("old_msgs/msg/Reading.msg") and not found.is_recorded
        assert [item.message.value for item in reader] == list(range(200))
        assert len(list(reader)) == 200
    (warned,) = recwarn.list  # once, not for each message or topic
    said = str(warned.message)
    assert warned.category is BagWarning and found.origin in said
    assert "contains neither definition nor hash of old_msgs/msg/Reading (/reading)" in said
    for given in (OLD, compile_definition(NAME, OLD)):
        with BagReader(bag, typestore={"old_msgs/Reading": given}) as reader:
            assert reader.definition("/reading").origin == "typestore"
            assert next(iter(reader)).message.weight == 2.0
    with BagReader(bag) as reader, pytest.raises(BagError, match="has no definition of old_msgs/msg/Reading, and"):
        reader.definition("/reading")
    wrong = package(tmp_path / "ros1" / "old_msgs", "Header header")
    with (
        BagReader(bag, search_path=wrong) as reader,
        pytest.raises(BagError, match=r".msg:1:1: unknown type.*$") as told,
    ):
        reader.definition("/reading")
    assert "\n" not in str(told.value)  # `bag table` prints it in one line, as the reason why it skips a topic
    with pytest.raises(TypeError, match="typestore: old_msgs/Reading: expected a message class"):
        BagReader(bag, typestore={"old_msgs/Reading": 1})  # type: ignore[dict-item]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (NEW, "4 of 12 bytes of a message are after its last field; typestore, used because the bag has no definition"),
        (LONG, "a message of 12 bytes: old_msgs/msg/Reading.unit: at byte 12: expected 4 bytes.*; typestore, used"),
    ],
)
def test_messages_that_do_not_fit_the_guessed_definition_are_never_returned(bag: Path, text: str, said: str) -> None:
    with BagReader(bag, typestore={NAME: text}) as reader:
        with pytest.warns(BagWarning, match=f"skipped /reading: {said}") as told:
            for _ in range(2):
                assert list(reader.messages()) == []
        assert len(told) == 2  # the guess, and the skipped messages
        assert reader.skipped["/reading"].count == 400
        with pytest.raises(WrongDefinitionError, match=f"/reading: {said}"):
            list(reader.messages("/reading"))


@pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")
def test_size_of_each_fixed_size_message_is_checked(tmp_path: Path) -> None:
    """With on_error="skip" a damaged message between intact messages is skipped alone."""
    good, long = reading(NEW, value=1.0).encode(), reading(OLD, value=2.0).encode()
    samples = [good] * 100 + [long]
    bag = humble_bag(tmp_path / "bag", NAME, samples)
    with BagReader(bag, typestore={NAME: NEW}) as reader:
        assert len(list(reader)) == 100
        assert reader.skipped["/reading"].count == 1
    bag = humble_bag(tmp_path / "damaged", NAME, [good, good[:6], good])
    with BagReader(bag, typestore={NAME: NEW}) as reader:
        assert len(list(reader.messages("/reading", on_error="skip"))) == 2


@pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")
def test_padding_and_unterminated_empty_strings_fit_the_guessed_definition(tmp_path: Path) -> None:
    samples = [String(data="a" * size).encode() for size in range(8)]
    padded = [sample + bytes(-len(sample) % 4) for sample in samples]
    without_end = b"\0\1\0\0" + struct.pack("<I", 0)
    bag = humble_bag(tmp_path / "bag", "std_msgs/msg/String", [without_end, *samples, *padded])
    with BagReader(bag) as reader:
        assert [len(item.message.data) for item in reader] == [0, *range(8), *range(8)]
        assert reader.definition("/reading").origin in ("bundled", "module std_msgs.msg._string")
        assert reader.skipped == {}


@pytest.mark.parametrize("kind", [BagTopic("/go", "std_msgs/msg/Empty"), Empty], ids=["no definition", "definition"])
def test_messages_without_fields_are_read_with_and_without_padding(tmp_path: Path, kind: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing is guessed there
        with BagWriter(tmp_path / "a.mcap") as writer:
            writer.add_topic("/go", kind)
            for number, end in enumerate((b"", b"\0", bytes(4))):
                writer.write("/go", b"\0\1\0\0" + end, number)
        for number in range(3):
            with BagReader(tmp_path / "a.mcap") as reader:
                found = [item.message for item in reader.messages(start_ns=number)]
                assert found == [Empty()] * (3 - number)


def test_only_a_definition_with_the_recorded_hash_is_used(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    then = compile_definition(NAME, OLD)
    samples = [then(value=1.0, weight=2.0).encode()]
    now, right = package(tmp_path / "now" / "old_msgs", NEW), package(tmp_path / "then" / "old_msgs", OLD)
    bag = humble_bag(tmp_path / "bag", NAME, samples, hash=type_hash(then))
    with BagReader(bag, search_path=right) as reader:
        assert reader.definition("/reading").is_recorded and next(iter(reader)).message.weight == 2.0
    swapped = compile_definition("old_msgs/msg/Other", OLD)  # no definition with the recorded name has this hash
    other = humble_bag(tmp_path / "other", NAME, samples, hash=type_hash(swapped))
    for options in ({"search_path": now}, {"typestore": {NAME: NEW}, "search_path": [now]}):
        with BagReader(other, **options) as reader, pytest.raises(BagError) as caught:
            next(reader.messages("/reading"))
        assert type_hash(swapped) in str(caught.value) and type_hash(compile_definition(NAME, NEW)) in str(caught.value)
    assert recwarn.list == []


def test_type_hash_of_an_mcap_channel_selects_the_definition(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.add_topic("/s", BagTopic("/s", "std_msgs/msg/String", type_hash=type_hash(String)))
        writer.write("/s", String(data="a").encode(), 1)
        writer.add_topic("/t", BagTopic("/t", "std_msgs/msg/String", type_hash="RIHS01_" + "0" * 64))
        writer.write("/t", String(data="b").encode(), 2)
    with BagReader(tmp_path / "a.mcap") as reader:
        assert reader.definition("/s").is_recorded
        assert [item.message.data for item in reader.messages("/s")] == ["a"]
        with pytest.raises(RosidlError, match="/t: the bag has no definition of std_msgs/msg/String, but its hash"):
            list(reader.messages("/t"))


def test_sqlite_writer_refuses_two_definitions_of_one_type(tmp_path: Path) -> None:
    texts, samples = ("int32 a\nint32 b", "int32 b\nint32 a"), []
    for topic, text in zip(("/one", "/two"), texts, strict=True):
        cls: Any = compile_definition("my/msg/Pair", text)
        samples.append((topic, "my/msg/Pair", text, [(1, cls(a=1, b=2).encode())]))
    with BagReader(write_foreign(tmp_path / "two.mcap", *samples)) as reader:
        assert {(item.message.a, item.message.b) for item in reader} == {(1, 2)}
        with SqliteWriter(tmp_path / "bag") as writer:
            one, two = reader.channels
            writer.add_raw_topic(one)
            with pytest.raises(BagError, match="/two and /one have messages of two definitions of my/msg/Pair"):
                writer.add_raw_topic(two)
            writer.add_topic("/three", replace(one, name="/three", definition=f"# the same\n{one.definition}"))


@pytest.mark.filterwarnings("ignore::rosidl_py_gen.bags.BagWarning")
def test_stored_definition_with_another_hash_is_not_used_for_a_topic(tmp_path: Path) -> None:
    right: Any = compile_definition("my/msg/Pair", "int32 a\nint32 b")
    with SqliteWriter(tmp_path / "bag") as writer:
        for topic in ("/one", "/two"):
            writer.add_topic(topic, topic_of(topic, right))
            writer.write(topic, right(a=1, b=2).encode(), 1)
    with sqlite3.connect(tmp_path / "bag" / "bag_0.db3") as base:
        base.execute("update topics set type_description_hash = ? where name = '/two'", ("RIHS01_" + "0" * 64,))
    with BagReader(tmp_path / "bag" / "bag_0.db3") as reader:
        assert [item.topic for item in reader] == ["/one"]
        assert reader.skipped["/two"].count == 1
