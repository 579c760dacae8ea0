"""Tables of random definitions and values, and of topics in blocks of chunks, compared with `messages`."""

from __future__ import annotations

import random
import tempfile
import warnings
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from support.definition_strategies import World, values, worlds
from support.example_counts import examples
from support.reference_cdr import Reference
from support.table_values import of_message, rows, same

from rosidl_py_gen import get_message, type_hash
from rosidl_py_gen.bags import BagReader, BagWriter
from rosidl_py_gen.bags.storage.mcap_file import McapFile
from rosidl_py_gen.bags.storage.storage_api import MessageBlock, as_table_input
from rosidl_py_gen.tables import reading


@st.composite
def worlds_and_many_values(draw: st.DrawFn) -> tuple[World, Reference, list[dict[str, Any]]]:
    world = draw(worlds())
    reference = world.reference()
    some = draw(st.lists(values(reference, world.top), min_size=1, max_size=4))
    return world, reference, some * draw(st.sampled_from((1, 1, 3, 12)))


def _bag(path: Path, world: World, data: list[bytes]) -> Path:
    with BagWriter(path) as writer:
        writer.add_topic("/t", world.compile())
        for number, one in enumerate(data):
            writer.write("/t", one, number, number // 2)
    return path


@settings(max_examples=examples(400))
@given(worlds_and_many_values(), st.integers(0, 2**32), st.booleans())
def test_table_has_the_values_of_messages_and_is_written_to_an_equal_bag(
    case: tuple[World, Reference, list[dict[str, Any]]], seed: int, one_by_one: bool
) -> None:
    world, reference, many = case
    pad = random.Random(seed).randbytes
    data = [reference.encode(world.top, value, pad=pad) for value in many]
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        if one_by_one:
            patch.setattr(reading, "read_program_for", lambda cls: None)
        path = _bag(Path(folder) / "a.mcap", world, data)
        with BagReader(path) as bag:
            messages = list(bag.messages("/t"))
            table = bag.table("/t")
            assert same(rows(table), [of_message(one.message) or {} for one in messages])
            assert table.column("log_time").cast("int64").to_pylist() == [one.log_time for one in messages]
            assert table.column("publish_time").cast("int64").to_pylist() == [one.publish_time for one in messages]
        again = Path(folder) / "b.mcap"
        with BagWriter(again) as writer:
            assert writer.write_table(table) == len(messages)
        with BagReader(again) as bag:
            found = list(bag.messages("/t"))
            assert [repr(one) for one in found] == [repr(one) for one in messages]
            assert same([of_message(one.message) for one in found], [of_message(one.message) for one in messages])
            assert bag.channels[0].type_hash == type_hash(world.compile())


@settings(max_examples=examples(200))
@given(worlds_and_many_values(), st.integers(0, 2**32))
def test_valid_messages_are_read_in_bulk_without_the_slow_path(
    case: tuple[World, Reference, list[dict[str, Any]]], seed: int
) -> None:
    world, reference, many = case
    if not reference.definition(world.top).fields:
        return
    pad = random.Random(seed).randbytes
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(reading, "column", None)
        path = _bag(Path(folder) / "a.mcap", world, [reference.encode(world.top, value, pad=pad) for value in many])
        with BagReader(path) as bag:
            assert bag.table("/t").num_rows == len(many)


@settings(max_examples=examples(300))
@given(worlds_and_many_values(), st.data())
def test_damaged_bytes_raise_equal_errors_for_tables_and_messages(
    case: tuple[World, Reference, list[dict[str, Any]]], draw: st.DataObject
) -> None:
    world, reference, many = case
    data = [reference.encode(world.top, value) for value in many]
    which = draw.draw(st.integers(0, len(data) - 1))
    wrong = bytearray(data[which])
    for _ in range(draw.draw(st.integers(1, 3))):
        wrong[draw.draw(st.integers(0, len(wrong) - 1))] = draw.draw(st.integers(0, 255))
    data[which] = bytes(wrong[: draw.draw(st.integers(0, len(wrong)))] if draw.draw(st.booleans()) else wrong)
    with tempfile.TemporaryDirectory() as folder:
        path = _bag(Path(folder) / "a.mcap", world, data)
        with BagReader(path) as bag:
            assert _result(lambda: rows(bag.table("/t"))) == _result(
                lambda: [of_message(one.message) or {} for one in bag.messages("/t")]
            )
        with BagReader(path) as one, BagReader(path) as other, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            table = one.table("/t", on_error="skip")
            messages = list(other.messages("/t", on_error="skip"))
            assert same(rows(table), [of_message(item.message) or {} for item in messages])
            assert one.skipped == other.skipped


def _result(call: Any) -> str:
    try:
        return repr(call())
    except ValueError as error:
        return f"{type(error).__name__}: {error}"


String: Any = get_message("std_msgs/msg/String")


def bag(path: Path, messages: list[tuple[str, str, int]], *, chunk: int = 4096, **options: Any) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk, compression=CompressionType.LZ4, **options)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channels = {
            name: writer.register_channel(name, "cdr", schema) for name in dict.fromkeys(m[0] for m in messages)
        }
        for name, text, time in messages:
            writer.add_message(channels[name], time, String(data=text).encode(), time + 1)
        writer.finish()
    return path


def compared(path: Path, topic: str, **span: int) -> int:
    with BagReader(path) as reader:
        expected = [(one.log_time, one.publish_time, one.message.data) for one in reader.messages(topic, **span)]
        table = reader.table(topic, **span)
        columns = [table.column(name).cast("int64").to_pylist() for name in ("log_time", "publish_time")]
        assert list(zip(*columns, table.column("data").to_pylist(), strict=True)) == expected
        return len(expected)


@settings(max_examples=examples(100))
@given(
    st.lists(st.tuples(st.sampled_from("ab"), st.integers(0, 9), st.integers(1, 40), st.integers(-1, 3)), max_size=12),
    st.sampled_from((200, 4096, 1 << 20)),
    st.booleans(),
    st.tuples(st.integers(0, 60), st.integers(0, 60)),
)
def test_tables_of_chunked_and_unchunked_files_equal_their_messages(
    tmp_path_factory: pytest.TempPathFactory, runs: list[Any], chunk: int, is_chunked: bool, span: tuple[int, int]
) -> None:
    messages, time = [], 100
    for topic, size, count, step in runs:
        for _ in range(count):
            time = max(0, time + step)
            messages.append((f"/{topic}", "x" * size, time))
    path = bag(tmp_path_factory.mktemp("b") / "a.mcap", messages, chunk=chunk, use_chunking=is_chunked)
    for topic in {one[0] for one in messages}:
        assert compared(path, topic) == sum(one[0] == topic for one in messages)
        compared(path, topic, start_ns=100 + span[0], end_ns=100 + span[0] + span[1])


def test_message_blocks_are_used_only_for_channels_in_time_order(tmp_path: Path) -> None:
    texts = [(f"/{'ab'[number % 3 == 0]}", "x" * (number % 2), number) for number in range(900)]
    for name, messages in {"ordered": texts, "one": [("/a", "abc", number) for number in range(900)]}.items():
        with closing(McapFile(bag(tmp_path / f"{name}.mcap", messages), True)) as file:
            blocks = list(as_table_input([file], ["/a"], 0, 1 << 64))
            assert all(isinstance(one, MessageBlock) for one in blocks) and len(blocks) > 2
    random.Random(1).shuffle(texts)
    with closing(McapFile(bag(tmp_path / "mixed.mcap", texts), True)) as file:
        assert not isinstance(next(iter(as_table_input([file], ["/a"], 0, 1 << 64))), MessageBlock)
    compared(tmp_path / "mixed.mcap", "/a")


def test_table_of_a_large_chunk_equals_its_messages(tmp_path: Path) -> None:
    messages = [(f"/{'ab'[number % 7 == 0]}", "y" * 500, number) for number in range(20_000)]
    path = bag(tmp_path / "a.mcap", messages, chunk=1 << 24)
    assert compared(path, "/b") == 2858
