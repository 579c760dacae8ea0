"""Writers of bags: MCAP as one file or a folder that rosbag2 plays, and rosbag2 folders of SQLite files.

The base class writes the files of a bag one after the other, and ``metadata.yaml`` of a folder. ROS 2 Humble to Kilted
play the folders. rosbag2 compresses whole files or single messages, with zstd. Chunks inside MCAP files are compressed
independently of that.
"""

from __future__ import annotations

import sqlite3
import time
from collections import Counter
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from rosidl_py_gen import __version__, type_hash, type_name
from rosidl_py_gen.bags.common import (
    OFFERED_QOS,
    TYPE_HASH,
    BagError,
    BagTopic,
    DurableFile,
    checked_time,
    require_printable,
)
from rosidl_py_gen.bags.definition_lookup import definition_of, same_definition
from rosidl_py_gen.bags.metadata import FileStatistics, OfferedQoS, metadata_text, write_metadata
from rosidl_py_gen.bags.storage.bag_files import SUFFIX
from rosidl_py_gen.bags.storage.mcap_output import McapOutput
from rosidl_py_gen.bags.storage.mcap_records import COMPRESSIONS
from rosidl_py_gen.bags.storage.storage_api import MAX_UNPACKED_BYTES
from rosidl_py_gen.bags.storage.zstd import ZstdCompressor
from rosidl_py_gen.base.stamps import NS_PER_S

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.bags.common import RawMessage
    from rosidl_py_gen.bags.storage.mcap_records import StoredAttachment, StoredMetadata
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime import QoSProfile

CompressionMode = Literal["none", "file", "message"]
_ZSTD_LEVEL = 1
"""Compression level of zstd that rosbag2 uses."""
_BLOCK_BYTES = 1 << 20


def compress_file(source: Path, zstd: ZstdCompressor | None = None) -> Path:
    """Replace a bag file by its zstd-compressed form, as rosbag2 does in mode ``file``, and return the new path.

    At any moment one of the two files is complete, also after a power cut or on a full disk; readers open that one.
    """
    target = source.with_name(source.name + SUFFIX)
    with DurableFile(target) as partial, source.open("rb") as plain, partial.open("wb") as compressed:
        size = source.stat().st_size
        (zstd or ZstdCompressor(_ZSTD_LEVEL)).copy_stream(plain, compressed, size=size, read_size=_BLOCK_BYTES)
    source.unlink()
    return target


def topic_of(topic: str, msg_type: type[Message] | BagTopic, qos: Sequence[QoSProfile] = ()) -> BagTopic:
    """Return the `BagTopic` that a bag stores for a message class, or for the topic of another bag.

    Raises:
        TypeNotFoundError: `msg_type` is not a message class.
    """
    if isinstance(msg_type, BagTopic):
        renamed = msg_type if msg_type.name == topic else replace(msg_type, name=topic)
        return replace(renamed, offered_qos=OfferedQoS(qos).text) if qos else renamed
    definition = definition_of(msg_type)
    return BagTopic(
        topic, type_name(msg_type), *definition, type_hash=type_hash(msg_type), offered_qos=OfferedQoS(qos).text
    )


class SplittingWriter:
    """Base of `BagWriter` and `SqliteWriter`: starts files, counts their messages and writes the metadata.

    Subclasses implement `_open`, `_close_file`, `_register_topic`, and `_write`, which calls `_split_if_full` and
    `_add_message`.

    Raises:
        BagError: a bag of one file must not be split, have a `compression_mode` or `custom_data`; a limit is not a
            number above 0; or `custom_data` contains other values than texts.
    """

    _storage: str
    _suffix: str

    def __init__(
        self,
        path: Path,
        is_folder: bool,
        split_bytes: int | None,
        split_s: float | None,
        compression_mode: CompressionMode,
        compression_threads: int,
        custom_data: Mapping[str, str] | None,
    ) -> None:
        if compression_mode not in get_args(CompressionMode):
            modes = ", ".join(get_args(CompressionMode))
            raise BagError(f'compression_mode: got "{compression_mode}"; expected one of {modes}')
        if path.exists():
            raise BagError(f"{path} exists already")
        self.path, self._is_folder = path, is_folder
        if split_bytes or split_s:
            self._require_folder()
        if not is_folder and (compression_mode != "none" or custom_data):
            raise BagError(f"{path} is one file; only a folder can have compression_mode or custom_data")
        for key, value in (custom_data or {}).items():
            if not (isinstance(key, str) and isinstance(value, str)):
                raise BagError(f"custom_data: got {key!r:.80}: {value!r:.80}; expected texts")
        self._split_bytes = split_bytes
        self._split_ns = None if split_s is None else round(split_s * NS_PER_S)
        self._compression_mode: CompressionMode = compression_mode
        self._custom_data = dict(custom_data or {})
        self._ros_distro = ""
        self._omitted: Counter[str] = Counter()  # what was given to `write_raw`, and the files have no place for
        self._zstd = None if compression_mode == "none" else ZstdCompressor(_ZSTD_LEVEL, threads=compression_threads)
        self._topics: dict[str, BagTopic] = {}
        self._statistics: list[FileStatistics] = []
        self._file_bytes = 0
        self._closed = False

    def _open(self) -> None:
        raise NotImplementedError

    def _register_topic(self, known: BagTopic) -> None:
        raise NotImplementedError

    def _write(self, topic: str, data: bytes, log_time_ns: int | None, publish_time_ns: int | None) -> None:
        raise NotImplementedError

    def _close_file(self, metadata: str) -> None:
        raise NotImplementedError

    def _inherit(
        self, profile: str, ros_distro: str, custom_data: Mapping[str, str], values: Mapping[str, str]
    ) -> None:
        """Set the metadata that a copied bag takes from the original recording, before anything else is written.

        Args:
            profile: profile for the header of MCAP files.
            values: further values in the metadata record of rosbag2.
        """
        self._ros_distro, self._custom_data = ros_distro, dict(custom_data)

    @property
    def _is_open(self) -> bool:
        return not self._closed

    def _require_open(self) -> None:
        if not self._is_open:
            raise BagError(f"{self.path} is closed")

    def _require_folder(self) -> None:
        if not self._is_folder:
            raise BagError(f"{self.path} is one file; only a folder can be split")

    def _next_path(self) -> Path:
        name = f"{self.path.name}_{len(self._statistics)}{self._suffix}" if self._is_folder else self.path.name
        self._statistics.append(FileStatistics(name))
        self._file_bytes = 0
        return self.path / name if self._is_folder else self.path

    def _log_time(self, topic: str, log_time_ns: int | None) -> int:
        return time.time_ns() if log_time_ns is None else checked_time(log_time_ns, topic, "log")

    def _split_if_full(self, log_time: int) -> None:
        first = self._statistics[-1].first
        is_long = self._split_ns is not None and first is not None and log_time - first >= self._split_ns
        if is_long or (self._split_bytes is not None and self._file_bytes >= self._split_bytes):
            self._next_file()

    def _add_message(self, topic: str, log_time_ns: int, size: int) -> None:
        self._statistics[-1].add(topic, log_time_ns)
        self._file_bytes += size

    def _compress_message(self, data: bytes) -> bytes:
        return self._zstd.compress(data) if self._zstd is not None and self._compression_mode == "message" else data

    def add_topic(self, topic: str, msg_type: type[Message] | BagTopic, *, qos: Sequence[QoSProfile] = ()) -> None:
        """Register a topic, which is needed before serialized messages are written.

        Args:
            msg_type: the class, or a `BagTopic` of a reader, whose name, and QoS if given, are replaced.
            qos: profiles of the publishers, which rosbag2 plays with.

        Raises:
            BagError: the topic has another type already, its name has control characters, the bag is closed or cannot
                be written, or a bag of SQLite files has another definition of the type.
            TypeNotFoundError: `msg_type` is not a message class.
        """
        self._require_open()
        self._register_topic(topic_of(topic, msg_type, qos))

    def write(
        self, topic: str, message: Message | bytes, log_time_ns: int | None = None, publish_time_ns: int | None = None
    ) -> None:
        """Write a message object or CDR bytes; for bytes, `add_topic` must have registered the topic's type before.

        Args:
            log_time_ns: None means now.
            publish_time_ns: None means `log_time_ns`; bags of SQLite files have no publish times.

        Raises:
            BagError: bytes for an unknown topic, a message of another type, a time below 0, or the bag is closed or
                cannot be written.
            EncodeError: a value of the message is out of range.
            OSError: the disk is full.
        """
        self._require_open()
        if isinstance(message, bytes | bytearray | memoryview):
            data = message
            if topic not in self._topics:
                raise BagError(f"{topic} has no type yet: call add_topic before bytes are written")
        else:
            data = message.encode()
            known = self._topics.get(topic)
            if known is None or known.type_hash != type_hash(message):
                self.add_topic(topic, type(message))
        self._write(topic, data, log_time_ns, publish_time_ns)

    def split(self) -> None:
        """Continue writing in a new file of the bag's folder, unless the current file has no messages.

        Raises:
            BagError: the bag is closed, is a single file, or cannot be written.
            OSError: the disk is full.
        """
        self._require_open()
        self._require_folder()
        if self._statistics[-1].first is not None:
            self._next_file()

    def _next_file(self) -> None:
        self._finish_file()
        self._open()

    def _finish_file(self) -> None:
        self._close_file(self._metadata(self._statistics[-1:]))
        if self._zstd is not None and self._compression_mode == "file":
            current = self._statistics[-1]
            current.path = compress_file(self.path / current.path, self._zstd).name

    def _metadata(self, files: Iterable[FileStatistics]) -> str:
        mode = "" if self._compression_mode == "none" else self._compression_mode
        topics = self._topics.values()
        return metadata_text(
            self._storage,
            files,
            topics,
            compression_mode=mode,
            custom_data=self._custom_data,
            ros_distro=self._ros_distro,
        )

    def close(self) -> None:
        """Finish the current file, and write ``metadata.yaml`` of a folder; may be called repeatedly.

        Raises:
            BagError: the bag cannot be written.
            OSError: the disk is full. Messages written before can be read.
        """
        if self._closed:
            return
        has_file = self._is_open
        self._closed = True
        try:
            if has_file:
                self._finish_file()
        finally:
            if self._is_folder:
                write_metadata(self.path, self._metadata(self._statistics))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


# ----------------------------------------------------------------------------------------------------------------- MCAP


MAX_COMPRESSED_BYTES = MAX_UNPACKED_BYTES - (1 << 20)
"""Maximum size in bytes of a message that is stored in a compressed chunk, because readers decompress at most 1 GiB by
default."""
_MAX_KNOWN = 10_000
"""Maximum number of channels in the cache with which `write_raw` recognizes channel objects; a full cache is emptied.
"""
CHUNK_BYTES = 768 << 10
"""Size in bytes of collected records at which a chunk is written to the file, as in rosbag2. With chunks of 4 MB,
reading takes 20 % longer, because every chunk is in new memory."""


class BagWriter(SplittingWriter):
    """Writer of MCAP bags with the definitions of messages. Use it with ``with``; without `close` a bag has no index.

    A `path` that ends with ``.mcap`` becomes one file, any other path a folder with ``metadata.yaml`` that rosbag2
    accepts.

    Args:
        compression: ``"zstd"``, ``"lz4"`` or ``""``, of chunks inside the file. Messages of 1023 MiB and more are not
            compressed, because readers do not decompress so much.
        split_bytes: size of messages after which a new file is started, in bytes; for folders.
        split_s: log time after which a new file is started, in seconds; for folders.
        compression_mode: rosbag2's modes, with zstd: ``"file"`` compresses each finished file, ``"message"`` each
            message; for folders.
        compression_threads: number of threads of zstd; 0 uses the calling thread, -1 one for each core.
        custom_data: texts for the metadata; for folders.

    Raises:
        BagError: `path` exists already, the compression is unknown, or one file is to be split.
        OSError: the file cannot be created.
    """

    _storage = "mcap"
    _suffix = ".mcap"

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        compression: str = "zstd",
        split_bytes: int | None = None,
        split_s: float | None = None,
        compression_mode: CompressionMode = "none",
        compression_threads: int = 0,
        custom_data: Mapping[str, str] | None = None,
    ) -> None:
        if compression not in COMPRESSIONS:
            known = ", ".join(filter(None, COMPRESSIONS))
            raise BagError(f'compression: got "{compression}"; expected one of {known}, or ""')
        target = Path(path)
        is_folder = target.suffix != ".mcap"
        if target.suffix == ".db3":
            raise BagError(f"{target}: BagWriter writes MCAP files; pass a name that ends with .mcap, or a folder")
        super().__init__(target, is_folder, split_bytes, split_s, compression_mode, compression_threads, custom_data)
        self._compression = compression
        self._numbers: dict[str, int] = {}
        self._added: dict[tuple[str, ...], int] = {}  # channels of `add_topic`
        self._channels: dict[tuple[object, ...], int] = {}
        self._raw: dict[int, tuple[BagTopic, int]] = {}  # channels of `write_raw` by identity, as comparing takes long
        self._registered: list[BagTopic] = []
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._profile = "ros2"
        self._rosbag2_values: dict[str, str] = {}
        if is_folder:
            self.path.mkdir(parents=True)
        self._open()

    def _register_topic(self, known: BagTopic) -> None:
        topic = known.name
        before = self._topics.get(topic)
        if before is not None and (before.type_name, before.type_hash) != (known.type_name, known.type_hash):
            raise BagError(f"{topic} has the type {before.type_name} {before.type_hash}, not {known.type_name}")
        if before is None:
            self._added[known.key] = self._add(known)

    def _add(self, known: BagTopic) -> int:
        require_printable(known.name)
        number = self._channels[known.channel_key] = self._register(known)
        self._registered.append(known)
        if known.name not in self._topics:
            self._topics[known.name] = known
            self._numbers[known.name] = number
        return number

    def write_table(self, table: Any, topic: str | None = None, msg_type: type[Message] | None = None) -> int:
        """Write each row of a table as a message: the reverse of `BagReader.table`. Needs the extra ``tables``.

        Args:
            table: any object with ``__arrow_c_stream__``: a ``pyarrow.Table`` or ``RecordBatchReader``, a data frame of
                polars or pandas, a result of DuckDB. It has a column ``log_time``, optionally ``publish_time``, and
                columns of fields; fields without a column have their defaults.
            topic: None uses the topic in the table's metadata.
            msg_type: None uses the type in the table's metadata, which polars and DuckDB do not retain.

        Returns:
            Number of messages.

        Raises:
            BagError: topic or type is missing, a column is unknown, a value is missing or of another kind, or the bag
                is closed or cannot be written.
            EncodeError: a value is out of range; names the topic, the time and the field.
            OSError: the disk is full.
        """
        from rosidl_py_gen.tables import MessageTable

        self._require_open()
        rows = MessageTable(table)
        if msg_type is None:
            known, msg_type = rows.topic_and_class(topic)
        elif topic is None:
            raise BagError("name the topic that messages of this type are written to")
        else:
            known = topic_of(topic, msg_type)
        self.add_topic(known.name, known if known.definition else topic_of(known.name, msg_type))
        count = 0
        for data, log_time, publish_time in rows.encoded(msg_type, known.name):
            self._write(known.name, data, log_time, publish_time)
            count += 1
        return count

    def add_raw_topic(self, known: BagTopic) -> None:
        """Register one of `BagReader.channels`, even if its topic has another definition already.

        Raises:
            BagError: the bag is closed.
        """
        self._require_open()
        self._number_of(known)

    def _number_of(self, known: BagTopic) -> int:
        entry = self._raw.get(id(known))
        if entry is not None:
            return entry[1]
        number = self._added.get(known.key, self._channels.get(known.channel_key))
        if number is None:
            number = self._add(known)
        if len(self._raw) >= _MAX_KNOWN:
            self._raw.clear()
        self._raw[id(known)] = known, number  # the reference retains the identity
        return number

    def write_raw(self, message: RawMessage, channel: BagTopic | None = None) -> None:
        """Write a message of `BagReader.raw_messages` with the definition of its channel.

        A topic can have messages of several definitions this way, as in the bag that is copied.

        Args:
            channel: the channel to write to; None is the message's own.

        Raises:
            BagError: the bag is closed or cannot be written, or a time is out of range.
            OSError: the disk is full.
        """
        known, data, log_time_ns, publish_time_ns, sequence = message
        known = channel or known
        self._require_open()
        self._write(known.name, data, log_time_ns, publish_time_ns, self._number_of(known), sequence)

    def _write(
        self,
        topic: str,
        data: bytes,
        log_time_ns: int | None,
        publish_time_ns: int | None,
        channel: int | None = None,
        sequence: int = 0,
    ) -> None:
        if channel is None or log_time_ns is None or self._is_folder:
            log_time = self._log_time(topic, log_time_ns)  # rosbag2 reads times from metadata.yaml as int64
        else:
            log_time = checked_time(log_time_ns, topic, "log", 64)
        bits = 63 if channel is None else 64
        published = log_time if publish_time_ns is None else checked_time(publish_time_ns, topic, "publish", bits)
        self._split_if_full(log_time)
        number = self._numbers[topic] if channel is None else channel
        self._add_message(topic, log_time, len(data))
        data = self._compress_message(data)
        if len(data) <= MAX_COMPRESSED_BYTES:
            self._output.add_message(number, sequence, log_time, published, data)
            return
        self.flush()
        self._output.add_message(number, sequence, log_time, published, data, is_compressed=False)
        self.flush()

    def flush(self) -> None:
        """Pass buffered messages to the operating system, so that they survive the end of this process.

        Each call ends a chunk, so frequent calls make compression worse.

        Raises:
            OSError: the disk is full.
        """
        if not self._stream.closed:
            self._output.flush()

    @property
    def _is_open(self) -> bool:
        return not self._stream.closed  # False also if a full disk prevented the next file

    def _register(self, topic: BagTopic) -> int:
        has_schema = topic.metadata is None or topic.schema_data is not None or topic.type_name or topic.definition
        schema = self._add_schema(topic) if has_schema else 0
        metadata = dict(topic.metadata or {})
        for key, value in ((OFFERED_QOS, topic.offered_qos), (TYPE_HASH, topic.type_hash)):
            if value or key in metadata or topic.metadata is None:
                metadata[key] = value
        return self._output.add_channel(schema, topic.name, topic.message_encoding, metadata)

    def _add_schema(self, topic: BagTopic) -> int:
        key = topic.type_name, topic.encoding, topic.definition_bytes
        if key not in self._schemas:
            self._schemas[key] = self._output.add_schema(*key)
        return self._schemas[key]

    def _copy_metadata(self, record: StoredMetadata) -> None:
        """Copy a metadata record of another MCAP file byte by byte."""
        self._output.copy_metadata(record.name, record.pieces())

    def _copy_attachment(self, attachment: StoredAttachment) -> None:
        """Copy an attachment of another MCAP file byte by byte."""
        self._output.copy_attachment(attachment.head, attachment.pieces())

    def _inherit(
        self, profile: str, ros_distro: str, custom_data: Mapping[str, str], values: Mapping[str, str]
    ) -> None:
        super()._inherit(profile, ros_distro, custom_data, values)
        self._rosbag2_values = dict(values)
        if profile != self._profile:
            self._profile = profile
            self._stream.seek(0)
            self._stream.truncate()
            self._start_file()

    def _open(self) -> None:
        self._stream = self._next_path().open("xb", buffering=1 << 16)
        self._start_file()

    def _start_file(self) -> None:
        library = f"rosidl-py-gen {__version__}"
        self._output = McapOutput(self._stream, self._profile, library, self._compression, CHUNK_BYTES)
        self._stream.flush()  # an empty bag from now on
        self._schemas = {}
        for topic in self._registered:
            self._register(topic)

    def _close_file(self, metadata: str) -> None:
        try:
            self._output.add_metadata("rosbag2", {**self._rosbag2_values, "serialized_metadata": metadata})
            self._output.finish()
        finally:
            self._stream.close()


# --------------------------------------------------------------------------------------------------------------- SQLite


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
