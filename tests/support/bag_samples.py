"""Helpers of tests that write bags, and of tests of bag commands."""

from __future__ import annotations

import asyncio
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagError, BagReader, BagTopic, BagWriter, SqliteWriter

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

String: Any = get_message("std_msgs/msg/String")
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


async def wait_for_lines(process: Any, *texts: str) -> None:
    """Read standard error until its lines have contained all `texts`, in any order."""
    missing = {*texts}
    while missing:
        line = (await asyncio.wait_for(process.stderr.readline(), 25)).decode()
        assert line, f"ended before it printed {missing}"
        missing = {text for text in missing if text not in line}
