"""Helpers of tests that write bags, and of tests of bag commands."""

from __future__ import annotations

import asyncio
import sqlite3
import tracemalloc
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import pytest
from mcap.writer import CompressionType, Writer

from rosidl_py_gen import compile_definition, get_message
from rosidl_py_gen.bags import BagError, BagReader, BagTopic, BagWriter, SqliteWriter
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from rosidl_py_gen.runtime import Node

String: Any = get_message("std_msgs/msg/String")
STRING = "std_msgs/msg/String", "string data"
"""Name and definition of a type."""
HUMBLE = """
create table schema(schema_version integer primary key, ros_distro text not null);
insert into schema values (3, 'humble');
create table topics(id integer primary key, name text not null, type text not null,
  serialization_format text not null, offered_qos_profiles text not null);
create table messages(id integer primary key, topic_id integer not null, timestamp integer not null,
  data blob not null);
create index timestamp_idx on messages (timestamp asc);
"""
ROSBAG2_SERVICES = {
    "burst": "uint64 num_messages\n---\nuint64 actually_burst\n",
    "get_rate": "---\nfloat64 rate\n",
    "is_paused": "---\nbool paused\n",
    "play": "builtin_interfaces/Time start_offset\nbuiltin_interfaces/Duration playback_duration\n"
    "builtin_interfaces/Time playback_until_timestamp\n---\nbool success\n",
    "play_next": "---\nbool success\n",
    "seek": "builtin_interfaces/Time time\n---\nbool success\n",
    "set_rate": "float64 rate\n---\nbool success\n",
    "snapshot": "---\nbool success\n",
}
"""Definitions of services of rosbag2_interfaces that are not empty."""
STORAGES: dict[str, Any] = {"mcap": BagWriter, "sqlite3": SqliteWriter}


def write_strings(
    path: Path, texts: Iterable[Any], topic: str = "/s", storage: str = "mcap", step_ns: int = 1, **options: Any
) -> Path:
    """Write a bag of strings; bytes are written as they are."""
    with STORAGES[storage](path, **options) as writer:
        writer.add_topic(topic, BagTopic(topic, "std_msgs/msg/String", "string data"))
        for number, text in enumerate(texts):
            writer.write(topic, text if isinstance(text, bytes) else String(data=text).encode(), number * step_ns)
    return path


def write_map_and_words(path: Path, count: int = 20, step_ns: int = NS_PER_S // 20, **options: Any) -> Path:
    """Write a bag of strings, w0, w1, ... on /words from 1000 s on, and one latched on /map."""
    with BagWriter(path, **options) as bag:
        bag.add_topic("/map", String, qos=[QoSProfile().transient_local()])
        bag.add_topic("/words", String, qos=[QoSProfile().best_effort()])
        bag.write("/map", String(data="map"), 1000 * NS_PER_S)
        for number in range(count):
            bag.write("/words", String(data=f"w{number}"), 1000 * NS_PER_S + number * step_ns)
    return path


def copy_to_sqlite(source: Path, path: Path) -> Path:
    """Write the messages of a bag into a folder with a database."""
    with SqliteWriter(path) as bag, BagReader(source) as reader:
        for message in reader.raw_messages():
            bag.write_raw(message)
    return path


_COMPRESSION = CompressionType.ZSTD if find_spec("zstandard") else CompressionType.NONE
"""Default compression of `mcap`, if zstandard is available for this Python."""


def write_foreign(path: Path, *channels: tuple[str, str, str, Iterable[tuple[int, bytes]]], **options: Any) -> Path:
    """Write channels with the package `mcap`: topic, type, definition, and messages with their times."""
    with path.open("wb") as stream:
        writer = Writer(stream, **{"compression": _COMPRESSION, **options})
        writer.start("ros2", "somebody")
        for topic, type_name, text, messages in channels:
            schema = writer.register_schema(type_name, "ros2msg", text.encode())
            channel = writer.register_channel(topic, "cdr", schema)
            for log_time, data in messages:
                writer.add_message(channel, log_time, data, log_time)
        writer.finish()
    return path


def write_humble(path: Path, *topics: tuple[str, str, Iterable[tuple[int, bytes]]]) -> Path:
    """Write a database without definitions, as rosbag2 of Humble: topic, type, and messages with their times."""
    with sqlite3.connect(path) as base:
        base.executescript(HUMBLE)
        for number, (topic, type_name, messages) in enumerate(topics, 1):
            base.execute("insert into topics values (?, ?, ?, 'cdr', '')", (number, topic, type_name))
            rows = ((number, *message) for message in messages)
            base.executemany("insert into messages(topic_id, timestamp, data) values (?, ?, ?)", rows)
    base.close()
    return path


def require_error(path: Path, text: str, **options: Any) -> None:
    """Read all messages, which must raise a `BagError`."""
    with pytest.raises(BagError, match=text), BagReader(path, **options) as reader:
        list(reader)


@contextmanager
def memory_limit(max_bytes: int) -> Iterator[None]:
    """Fail if Python allocates more memory inside the block."""
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < max_bytes, f"{peak >> 20} MB"


def count_of(path: Path) -> int:
    """Return the number of messages, also of a bag that is recorded."""
    try:
        with BagReader(path) as reader:
            return sum(topic.count or 0 for topic in reader.topics.values())
    except BagError:  # the file is new, and has no tables yet
        return 0


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """Limit the size of files of this process, as a full disk does."""
    import resource

    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


class Rosbag2Services:
    """Services of a player or recorder, as a program with rosbag2_interfaces calls them."""

    def __init__(self, node: Node, prefix: str) -> None:
        self._node, self._prefix = node, prefix

    async def __call__(self, name: str, **values: Any) -> Any:
        """Return the response of a service."""
        kind = "".join(map(str.title, name.split("_")))
        cls: Any = compile_definition(f"rosbag2_interfaces/srv/{kind}", ROSBAG2_SERVICES.get(name, "---\n"))
        client = self._node.create_client(cls, f"{self._prefix}/{name}")
        response = await client.call(cls.Request(**values), timeout_s=20)
        client.close()
        return response


async def wait_for_lines(process: Any, *texts: str) -> None:
    """Read standard error until its lines have contained all `texts`, in any order."""
    missing = {*texts}
    while missing:
        line = (await asyncio.wait_for(process.stderr.readline(), 25)).decode()
        assert line, f"ended before it printed {missing}"
        missing = {text for text in missing if text not in line}
