"""Writer of MCAP bags: one file, or a folder that rosbag2 plays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import __version__, encode
from rosidl_py_gen.bags.common import OFFERED_QOS, TYPE_HASH, BagError, BagTopic, checked_time, require_printable
from rosidl_py_gen.bags.splitting_writer import SplittingWriter, topic_of
from rosidl_py_gen.bags.storage.mcap_chunks import COMPRESSIONS
from rosidl_py_gen.bags.storage.mcap_output import McapOutput
from rosidl_py_gen.bags.storage.storage_api import MAX_UNPACKED_BYTES
from rosidl_py_gen.errors import EncodeError

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

    from rosidl_py_gen.bags.common import RawMessage
    from rosidl_py_gen.bags.splitting_writer import CompressionMode
    from rosidl_py_gen.bags.storage.mcap_extras import StoredAttachment, StoredMetadata
    from rosidl_py_gen.cdr import Message

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
        from rosidl_py_gen.tables.writing import located, messages_of, stream_of, topic_of_schema

        self._require_open()
        stream = stream_of(table)
        if msg_type is None:
            known, msg_type = topic_of_schema(stream.schema, topic)
        elif topic is None:
            raise BagError("name the topic that messages of this type are written to")
        else:
            known = topic_of(topic, msg_type)
        self.add_topic(known.name, known if known.definition else topic_of(known.name, msg_type))
        count = 0
        for message, log_time, publish_time in messages_of(stream, msg_type, known.name):
            try:
                data = encode(message)
            except EncodeError as error:
                raise located(error, known.name, log_time) from None
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
