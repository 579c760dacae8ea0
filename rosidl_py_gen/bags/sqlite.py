"""Writing rosbag2 folders of SQLite files, which Humble to Kilted play."""

from __future__ import annotations

import sqlite3
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.bags.common import BagError, BagTopic, checked_time, require_printable
from rosidl_py_gen.bags.definition_lookup import same_definition
from rosidl_py_gen.bags.file_splitter import FileSplitter

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Mapping

    from typing_extensions import Self

    from rosidl_py_gen.bags.common import RawMessage
    from rosidl_py_gen.bags.file_splitter import CompressionMode

# Version 4 of rosbag2's own tables.
_TABLES = """
create table schema(schema_version integer primary key, ros_distro text not null);
insert into schema values (4, '');
create table metadata(id integer primary key, metadata_version integer not null, metadata text not null);
create table topics(id integer primary key, name text not null, type text not null,
  serialization_format text not null, offered_qos_profiles text not null, type_description_hash text not null);
create table message_definitions(id integer primary key, topic_type text not null, encoding text not null,
  encoded_message_definition text not null, type_description_hash text not null);
create table messages(id integer primary key, topic_id integer not null, timestamp integer not null,
  data blob not null);
create index timestamp_idx on messages (timestamp asc);
"""


class SqliteWriter:
    """A folder of ``.db3`` files with ``metadata.yaml``. Use it with ``with``; what is not flushed needs `close`.

    Args:
        split_bytes: as for `BagWriter`. split_s: so is this.
        compression_mode: so is this. compression_threads: so is this. custom_data: so is this.

    Raises:
        BagError: there is something at `path` already, or it cannot be written. OSError: the folder cannot be made.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        split_bytes: int | None = None,
        split_s: float | None = None,
        compression_mode: CompressionMode = "none",
        compression_threads: int = 0,
        custom_data: Mapping[str, str] | None = None,
    ) -> None:
        self.path = Path(path)
        if self.path.exists():
            raise BagError(f"{self.path} exists already")
        if self.path.suffix in (".mcap", ".db3"):
            raise BagError(f"{self.path}: a bag of SQLite files is a folder; give a name without {self.path.suffix}")
        self._parts = FileSplitter(
            self.path,
            "sqlite3",
            ".db3",
            split_bytes=split_bytes,
            split_s=split_s,
            packing=compression_mode,
            threads=compression_threads,
            custom_data=custom_data,
        )
        self.path.mkdir(parents=True)
        self._topics: dict[str, BagTopic] = {}
        self._closed = False
        self._open()

    def _open(self) -> None:
        """Begin a file; the topics of those before are in it, too."""
        self._ids: dict[str, int] = {}
        self._described: set[str] = set()
        with self._as_bag_error():
            self._base = sqlite3.connect(self._parts.begin(), isolation_level=None, check_same_thread=False)
            self._base.executescript(_TABLES)
            self._base.execute("begin")
        for topic in self._topics.values():
            self._insert(topic)

    @contextmanager
    def _as_bag_error(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, UnicodeEncodeError) as error:
            raise BagError(f"{self.path}: {error}") from None

    def add_topic(self, topic: str, known: BagTopic) -> None:
        """Make a topic known, as a reader gives it.

        Raises:
            BagError: it cannot be written.
        """
        before = self._topics.get(topic)
        if before is not None and before.key != known.key:
            raise BagError(
                f"{self.path}: {topic} has messages of two definitions, of {before.type_name} and {known.type_name}; "
                "bags of SQLite files have one for each topic, those of MCAP files as many as there are"
            )
        if before is not None:
            return
        alike = next((one for one in self._topics.values() if one.type_name == known.type_name), known)
        if not same_definition(alike, known):
            raise BagError(
                f"{self.path}: {topic} and {alike.name} have messages of two definitions of {known.type_name}; bags of "
                "SQLite files have one for each type, those of MCAP files as many as there are"
            )
        require_printable(topic)
        self._insert(known)
        self._topics[topic] = known

    def _insert(self, known: BagTopic) -> None:
        with self._as_bag_error():
            added = self._base.execute(
                "insert into topics(name, type, serialization_format, offered_qos_profiles, type_description_hash) "
                "values (?, ?, ?, ?, ?)",
                (known.name, known.type_name, known.message_encoding, known.offered_qos, known.type_hash),
            )
            self._ids[known.name] = int(added.lastrowid or 0)
            if known.definition and known.type_name not in self._described:
                self._base.execute(
                    "insert into message_definitions"
                    "(topic_type, encoding, encoded_message_definition, type_description_hash) values (?, ?, ?, ?)",
                    (known.type_name, known.encoding, known.definition, known.type_hash),
                )
                self._described.add(known.type_name)

    def add_raw_topic(self, known: BagTopic) -> None:
        """Make one of `BagReader.channels` known; errors as `add_topic`."""
        self.add_topic(known.name, known)

    def write_raw(self, message: RawMessage) -> None:
        """Write a message as `BagReader.raw_messages` gives it; errors as `add_topic` and `write`."""
        known, data, log_time_ns, publish_time_ns = message
        if self._topics.get(known.name) is not known:
            self.add_topic(known.name, known)
        self.write(known.name, data, log_time_ns, publish_time_ns)

    def write(self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int | None = None) -> None:
        """Write the bytes of a message; these bags have no publish times.

        Raises:
            BagError: an unknown topic, a closed bag, a time below 0, or it cannot be written.
        """
        if self._closed or topic not in self._ids:
            raise BagError(f"{self.path} is closed" if self._closed else f"{topic} has no type yet: call add_topic")
        log_time = checked_time(log_time_ns, topic, "log")
        if self._parts.needs_new_file(log_time):
            self._next_file()
        with self._as_bag_error():
            row = self._ids[topic], log_time, self._parts.compress_message(data)
            self._base.execute("insert into messages(topic_id, timestamp, data) values (?, ?, ?)", row)
        self._parts.add(topic, log_time, len(data))

    def flush(self) -> None:
        """Hand what was written to the operating system, so that it outlives this process.

        Raises:
            BagError: it cannot be written.
        """
        if not self._closed:
            with self._as_bag_error():
                self._base.execute("commit")
                self._base.execute("begin")

    def split(self) -> None:
        """Go on in a new file, unless the current one is empty.

        Raises:
            BagError: the bag is closed, or it cannot be written. OSError: the disk is full.
        """
        if self._closed:
            raise BagError(f"{self.path} is closed")
        if not self._parts.is_empty:
            self._next_file()

    def _next_file(self) -> None:
        self._finish()
        self._open()

    def _finish(self) -> None:
        text = self._parts.file_metadata(self._topics.values())
        try:
            with self._as_bag_error():
                self._base.execute("insert into metadata(metadata_version, metadata) values (8, ?)", (text,))
                self._base.execute("commit")
        finally:
            self._base.close()
        self._parts.end()

    def close(self) -> None:
        """Write everything, and ``metadata.yaml``; may be called twice.

        Raises:
            BagError: it cannot be written. OSError: the disk is full.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._finish()
        finally:
            self._parts.write_metadata(self._topics.values())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
