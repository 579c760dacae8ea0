"""Topics read in blocks of chunks, compared with `messages`."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from support.example_counts import examples

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagError, BagReader
from rosidl_py_gen.bags.storage.storage_api import MessageBlock, as_table_input

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
def test_what_lies_in_chunks_is_found(
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


def test_blocks_are_taken_for_one_channel_in_order(tmp_path: Path) -> None:
    texts = [(f"/{'ab'[number % 3 == 0]}", "x" * (number % 2), number) for number in range(900)]
    for name, messages in {"ordered": texts, "one": [("/a", "abc", number) for number in range(900)]}.items():
        with BagReader(bag(tmp_path / f"{name}.mcap", messages)) as reader:
            blocks = list(as_table_input(reader._files, ["/a"], 0, 1 << 64))
            assert all(isinstance(one, MessageBlock) for one in blocks) and len(blocks) > 2
    random.Random(1).shuffle(texts)
    with BagReader(bag(tmp_path / "mixed.mcap", texts)) as reader:
        assert not isinstance(next(iter(as_table_input(reader._files, ["/a"], 0, 1 << 64))), MessageBlock)
    compared(tmp_path / "mixed.mcap", "/a")


def test_large_chunks_come_in_pieces(tmp_path: Path) -> None:
    messages = [(f"/{'ab'[number % 7 == 0]}", "y" * 500, number) for number in range(20_000)]
    path = bag(tmp_path / "a.mcap", messages, chunk=1 << 24)
    assert compared(path, "/b") == 2858


def test_damage_in_chunks_is_told_as_by_messages(tmp_path: Path) -> None:
    path = bag(tmp_path / "a.mcap", [("/a", "abc", number) for number in range(300)], use_chunking=False)
    data = np.frombuffer(path.read_bytes(), np.uint8)
    rng = np.random.default_rng(2)
    for _ in range(300):
        wrong = data.copy()
        wrong[rng.integers(0, len(data) // 2)] = rng.integers(0, 255)
        path.write_bytes(wrong.tobytes())
        try:
            with BagReader(path) as reader:
                expected = [one.message.data for one in reader.messages("/a")]
        except ValueError as error:
            with pytest.raises(type(error)) as raised, BagReader(path) as reader:
                reader.table("/a")
            assert str(raised.value) == str(error) or isinstance(error, BagError)
            continue
        try:
            with BagReader(path) as reader:
                assert reader.table("/a").column("data").to_pylist() == expected
        except BagError as error:
            assert "expected a time of at most" in str(error)
