"""Writer of rosbag2 folders of SQLite files, which ROS 2 Humble to Kilted play."""

from __future__ import annotations

import sqlite3
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.bags.common import BagError, require_printable
from rosidl_py_gen.bags.definition_lookup import same_definition
from rosidl_py_gen.bags.splitting_writer import SplittingWriter

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Mapping

    from rosidl_py_gen.bags.common import BagTopic, RawMessage
    from rosidl_py_gen.bags.splitting_writer import CompressionMode

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


class SqliteWriter(SplittingWriter):
    """Writer of a rosbag2 folder of ``.db3`` files with ``metadata.yaml``. Use it with ``with``, or call `close`.

    Compared with `BagWriter`, a topic and a type have one definition in the bag, and messages have no publish times.

    Args:
        split_bytes: size of messages after which a new file is started, in bytes.
        split_s: log time after which a new file is started, in seconds.
        compression_mode: rosbag2's modes, with zstd: ``"file"`` compresses each finished file, ``"message"`` each
            message.
        compression_threads: number of threads of zstd; 0 uses the calling thread, -1 one for each core.
        custom_data: texts for the metadata.

    Raises:
        BagError: `path` exists already, or it cannot be written.
        OSError: the folder cannot be created.
    """

    _storage = "sqlite3"
    _suffix = ".db3"

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
        folder = Path(path)
        if folder.suffix in (".mcap", ".db3"):
            raise BagError(f"{folder}: a bag of SQLite files is a folder; pass a name without {folder.suffix}")
        super().__init__(folder, True, split_bytes, split_s, compression_mode, compression_threads, custom_data)
        self.path.mkdir(parents=True)
        self._open()

    def _open(self) -> None:
        # Each file contains the topics of the files before.
        self._ids: dict[str, int] = {}
        self._described: set[str] = set()
        with self._as_bag_error():
            self._database = sqlite3.connect(self._next_path(), isolation_level=None, check_same_thread=False)
            self._database.executescript(_TABLES)
            self._database.execute("begin")
        self._insert_distro()
        for topic in self._topics.values():
            self._insert(topic)

    @contextmanager
    def _as_bag_error(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, UnicodeEncodeError) as error:
            raise BagError(f"{self.path}: {error}") from None

    def _register_topic(self, known: BagTopic) -> None:
        topic = known.name
        previous = self._topics.get(topic)
        if previous is not None and previous.key != known.key:
            raise BagError(
                f"{self.path}: {topic} has messages of two definitions, of {previous.type_name} and {known.type_name}; "
                "SQLite bags have one definition per topic; write MCAP files"
            )
        if previous is not None:
            return
        same_type = next((other for other in self._topics.values() if other.type_name == known.type_name), known)
        if not same_definition(same_type, known):
            raise BagError(
                f"{self.path}: {topic} and {same_type.name} have messages of two definitions of {known.type_name}; "
                "SQLite bags have one definition per type; write MCAP files"
            )
        require_printable(topic)
        self._insert(known)
        self._topics[topic] = known

    def _insert(self, known: BagTopic) -> None:
        with self._as_bag_error():
            added = self._database.execute(
                "insert into topics(name, type, serialization_format, offered_qos_profiles, type_description_hash) "
                "values (?, ?, ?, ?, ?)",
                (known.name, known.type_name, known.message_encoding, known.offered_qos, known.type_hash),
            )
            self._ids[known.name] = int(added.lastrowid or 0)
            if known.definition and known.type_name not in self._described:
                self._insert_definition(known)

    def _insert_definition(self, known: BagTopic) -> None:
        data = known.definition_bytes
        text = known.definition if data == known.definition.encode() else data
        with self._as_bag_error():
            self._database.execute(
                "insert into message_definitions"
                "(topic_type, encoding, encoded_message_definition, type_description_hash) values (?, ?, ?, ?)",
                (known.type_name, known.encoding, text, known.type_hash),
            )
        self._described.add(known.type_name)

    def add_raw_topic(self, known: BagTopic) -> None:
        """Register one of `BagReader.channels` as a topic.

        Raises:
            BagError: the topic or type has another definition already, or the bag is closed or cannot be written.
        """
        self.add_topic(known.name, known)

    def write_raw(self, message: RawMessage, channel: BagTopic | None = None) -> None:
        """Write a message of `BagReader.raw_messages`, without its publish time and sequence number.

        Args:
            channel: the channel to write to; None is the message's own.

        Raises:
            BagError: the topic or type has another definition already, a time is out of range, or the bag is closed or
                cannot be written.
            OSError: the disk is full.
        """
        known, data, log_time_ns, publish_time_ns, sequence = message
        known = channel or known
        if self._topics.get(known.name) is not known:
            self.add_topic(known.name, known)
        self._require_open()
        self._write(known.name, data, log_time_ns, publish_time_ns)
        if sequence:
            self._omitted["sequence_numbers"] += 1
        if publish_time_ns != log_time_ns:
            self._omitted["publish_times"] += 1

    def _inherit(
        self, profile: str, ros_distro: str, custom_data: Mapping[str, str], values: Mapping[str, str]
    ) -> None:
        super()._inherit(profile, ros_distro, custom_data, values)
        self._insert_distro()

    def _insert_distro(self) -> None:
        with self._as_bag_error():
            self._database.execute("update schema set ros_distro = ?", (self._ros_distro,))

    def _add_schema(self, schema: BagTopic) -> None:
        """Add a message definition that no topic uses to the bag.

        Count it as omitted if its type has a definition already.
        """
        if schema.type_name in self._described:
            self._omitted["schemas"] += 1
        else:
            self._insert_definition(schema)

    def _write(self, topic: str, data: bytes, log_time_ns: int | None, publish_time_ns: int | None) -> None:
        log_time = self._log_time(topic, log_time_ns)
        self._split_if_full(log_time)
        with self._as_bag_error():
            row = self._ids[topic], log_time, self._compress_message(bytes(data))
            self._database.execute("insert into messages(topic_id, timestamp, data) values (?, ?, ?)", row)
        self._add_message(topic, log_time, len(data))

    def flush(self) -> None:
        """Pass written messages to the operating system, so that they survive the end of this process.

        Raises:
            BagError: the messages cannot be written.
        """
        if not self._closed:
            with self._as_bag_error():
                self._database.execute("commit")
                self._database.execute("begin")

    def _close_file(self, metadata: str) -> None:
        try:
            with self._as_bag_error():
                self._database.execute("insert into metadata(metadata_version, metadata) values (8, ?)", (metadata,))
                self._database.execute("commit")
        finally:
            self._database.close()
