"""Writing bags: one MCAP file, or a folder that rosbag2 plays."""

from __future__ import annotations

import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from mcap.writer import CompressionType, Writer

from rosidl_py_gen import __version__, encode, type_hash, type_name
from rosidl_py_gen.bags.common import BagError, BagTopic, checked_time, require_printable
from rosidl_py_gen.bags.file_splitter import FileSplitter
from rosidl_py_gen.bags.metadata import qos_text
from rosidl_py_gen.bags.storage.storage_api import MAX_UNPACKED_BYTES
from rosidl_py_gen.errors import EncodeError
from rosidl_py_gen.type_loading.from_description import definition_text

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Mapping, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.bags.common import RawMessage
    from rosidl_py_gen.bags.file_splitter import CompressionMode
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime import QoSProfile

_COMPRESSIONS = {"": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
MAX_COMPRESSED_BYTES = MAX_UNPACKED_BYTES - (1 << 20)
"""A larger message has a chunk of its own without compression: readers unpack so much at once without being told
otherwise, with what stands around a message in its chunk.
"""
_CHUNK = 768 << 10
"""Bytes of messages that are written, and found again, together; as rosbag2 has it. With 4 MB, reading takes a fifth
longer, because every chunk is new memory then.
"""


class _Compression:
    """What `Writer` compares with its kinds of compression whenever it ends a chunk, so that chunks may differ."""

    def __init__(self, kind: CompressionType) -> None:
        self._usual = self._kind = kind

    def __eq__(self, other: object) -> bool:
        return self._kind == other

    __hash__ = None  # type: ignore[assignment]

    @contextmanager
    def off(self) -> Iterator[None]:
        self._kind = CompressionType.NONE
        try:
            yield
        finally:
            self._kind = self._usual


def topic_of(topic: str, msg_type: type[Message], qos: Sequence[QoSProfile] = ()) -> BagTopic:
    """What a bag keeps of a topic; raises `TypeNotFoundError` when `msg_type` is no message class."""
    text = definition_text(msg_type)
    encoding = "ros2idl" if text.startswith("=") else "ros2msg"
    return BagTopic(
        topic, type_name(msg_type), text, encoding, type_hash=type_hash(msg_type), offered_qos=qos_text(qos)
    )


class BagWriter:
    """Writes messages with their definitions. Use it with ``with``; without `close` there is no index.

    A folder that rosbag2 accepts, with ``metadata.yaml``; or one file when `path` ends with ``.mcap``.

    Args:
        compression: ``"zstd"``, ``"lz4"`` or ``""``, of chunks inside the file; not of messages from 1023 MiB, as
            readers do not unpack so much.
        split_bytes: a new file is begun after so many bytes of messages; for folders.
        split_s: a new file is begun after so many seconds of log time; for folders.
        compression_mode: rosbag2's compression modes, with zstd: ``"file"`` packs each file when it ends, ``"message"``
            each message; for folders.
        compression_threads: how many zstd has; 0 is the calling one, -1 one for each core.
        custom_data: texts for the metadata; for folders.

    Raises:
        BagError: there is something at `path` already; an unknown compression, or splitting of one file.
        OSError: the file cannot be made.
    """

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
        self.path = Path(path)
        is_folder = self.path.suffix != ".mcap"
        if compression not in _COMPRESSIONS:
            raise BagError(
                f'compression "{compression}" is not known; there are {", ".join(filter(None, _COMPRESSIONS))}'
            )
        self._parts = FileSplitter(
            self.path,
            "mcap",
            ".mcap",
            is_folder=is_folder,
            split_bytes=split_bytes,
            split_s=split_s,
            packing=compression_mode,
            threads=compression_threads,
            custom_data=custom_data,
        )
        if self.path.suffix == ".db3":
            raise BagError(f"{self.path}: this writes MCAP files: a name that ends with .mcap, or a folder's")
        if self.path.exists():
            raise BagError(f"{self.path} exists already")
        self._compression = _Compression(_COMPRESSIONS[compression])
        self._topics: dict[str, BagTopic] = {}
        self._numbers: dict[str, int] = {}
        self._channels: dict[tuple[str, ...], int] = {}
        self._registered: list[BagTopic] = []
        self._schemas: dict[tuple[str, str], int] = {}
        self._closed = False
        if is_folder:
            self.path.mkdir(parents=True)
        self._open()

    # ------------------------------------------------------------------------------------------------------ writing

    def add_topic(
        self,
        topic: str,
        msg_type: type[Message] | BagTopic,
        *,
        qos: Sequence[QoSProfile] = (),
    ) -> None:
        """Make a topic known, so that raw bytes can be written to it; `write` does this for messages by itself.

        Args:
            msg_type: the class, or a `BagTopic` as a reader gives it.
            qos: of those who publish it; rosbag2 plays with it.

        Raises:
            BagError: the topic has another type already, its name has control characters, or the bag is closed.
                TypeNotFoundError: not a message class.
        """
        self._require_open()
        known = msg_type if isinstance(msg_type, BagTopic) else topic_of(topic, msg_type, qos)
        before = self._topics.get(topic)
        if before is not None and (before.type_name, before.type_hash) != (known.type_name, known.type_hash):
            raise BagError(f"{topic} has the type {before.type_name} {before.type_hash}, not {known.type_name}")
        if before is None:
            self._add(known)

    def _add(self, known: BagTopic) -> int:
        """Channels have the same number in each file, as they are registered in the same order."""
        require_printable(known.name)
        number = self._channels[known.key] = self._register(known)
        self._registered.append(known)
        if known.name not in self._topics:
            self._topics[known.name] = known
            self._numbers[known.name] = number
        return number

    def write(
        self, topic: str, message: Message | bytes, log_time_ns: int | None = None, publish_time_ns: int | None = None
    ) -> None:
        """Write a message; bytes are CDR of the type that `add_topic` named.

        Args:
            log_time_ns: None means now. publish_time_ns: None means `log_time_ns`.

        Raises:
            BagError: bytes for an unknown topic, a message of another type, a time below 0, or the bag is closed.
                EncodeError: a value of the message does not fit. OSError: the disk is full.
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
        self._write(topic, self._numbers[topic], data, log_time_ns, publish_time_ns)

    def write_table(self, table: Any, topic: str | None = None, msg_type: type[Message] | None = None) -> int:
        """Write each row as a message: the reverse of `BagReader.table`. Needs the extra ``tables``.

        Args:
            table: anything with ``__arrow_c_stream__``: a ``pyarrow.Table`` or ``RecordBatchReader``, a data frame of
                polars or pandas, what DuckDB gives. It has a column ``log_time``, perhaps ``publish_time``, and those
                of fields; fields without a column have their defaults.
            topic: None is that in the table's metadata.
            msg_type: None is what the metadata say; polars and DuckDB do not keep them.

        Returns:
            How many messages.

        Raises:
            BagError: no topic or type, an unknown column, no value, or one of another kind; and as `write`.
                EncodeError: a value does not fit; names the topic, the time and the field.
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
        number = self._numbers[known.name]
        count = 0
        for message, log_time, publish_time in messages_of(stream, msg_type, known.name):
            try:
                data = encode(message)
            except EncodeError as error:
                raise located(error, known.name, log_time) from None
            self._write(known.name, number, data, log_time, publish_time)
            count += 1
        return count

    def add_raw_topic(self, known: BagTopic) -> None:
        """Make one of `BagReader.channels` known, also where its topic has another definition already.

        Raises:
            BagError: the bag is closed.
        """
        self._require_open()
        if known.key not in self._channels:
            self._add(known)

    def write_raw(self, message: RawMessage) -> None:
        """Write a message as `BagReader.raw_messages` gives it, with the definition it has there.

        This is how a topic comes to have messages of two definitions, as it had in the bag that is copied.

        Raises:
            BagError, OSError: as `write`.
        """
        known, data, log_time_ns, publish_time_ns = message
        self.add_raw_topic(known)
        self._write(known.name, self._channels[known.key], data, log_time_ns, publish_time_ns)

    def _write(
        self, topic: str, channel: int, data: bytes, log_time_ns: int | None, publish_time_ns: int | None
    ) -> None:
        log_time = time.time_ns() if log_time_ns is None else checked_time(log_time_ns, topic, "log")
        published = log_time if publish_time_ns is None else checked_time(publish_time_ns, topic, "publish")
        if self._parts.needs_new_file(log_time):
            self._next_file()
        self._parts.add(topic, log_time, len(data))
        data = self._parts.compress_message(data)
        if len(data) <= MAX_COMPRESSED_BYTES:
            self._writer.add_message(channel, log_time, data, published)
            return
        self.flush()
        with self._compression.off():
            self._writer.add_message(channel, log_time, data, published)
            self.flush()

    def flush(self) -> None:
        """Hand what is held back to the operating system, so that it outlives this process; costs some compression.

        Raises:
            OSError: the disk is full.
        """
        if not self._stream.closed:
            self._writer.flush()  # type: ignore[no-untyped-call]

    def _require_open(self) -> None:
        if self._stream.closed:  # also when a full disk hindered the beginning of another file
            raise BagError(f"{self.path} is closed")

    def _register(self, topic: BagTopic) -> int:
        key = topic.type_name, topic.definition
        if key not in self._schemas:
            self._schemas[key] = self._writer.register_schema(
                topic.type_name, topic.encoding, topic.definition.encode()
            )
        told = {"offered_qos_profiles": topic.offered_qos, "topic_type_hash": topic.type_hash}
        return self._writer.register_channel(topic.name, topic.message_encoding, self._schemas[key], told)

    # ------------------------------------------------------------------------------------------------------- files

    def _open(self) -> None:
        self._stream = self._parts.begin().open("xb", buffering=1 << 16)
        self._writer = Writer(self._stream, chunk_size=_CHUNK, compression=cast("CompressionType", self._compression))
        self._writer.start("ros2", f"rosidl-py-gen {__version__}")
        self._stream.flush()  # an empty bag from now on
        self._schemas = {}
        for topic in self._registered:
            self._register(topic)

    def split(self) -> None:
        """Go on in a new file, unless the current one is empty; for folders.

        Raises:
            BagError: the bag is closed, or is one file. OSError: the disk is full.
        """
        self._require_open()
        self._parts.require_folder()
        if not self._parts.is_empty:
            self._next_file()

    def _next_file(self) -> None:
        self._finish()
        self._open()

    def _finish(self) -> None:
        text = self._parts.file_metadata(self._topics.values())
        try:
            self._writer.add_metadata("rosbag2", {"serialized_metadata": text})
            self._writer.finish()  # type: ignore[no-untyped-call]
        finally:
            self._stream.close()
        self._parts.end()

    def close(self) -> None:
        """Write the index, and ``metadata.yaml`` of a folder; may be called twice.

        Raises:
            OSError: the disk is full. What was written before can be read.
        """
        if self._closed:
            return
        self._closed = True
        try:
            if not self._stream.closed:
                self._finish()
        finally:
            self._parts.write_metadata(self._topics.values())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
