"""Base class of the bag writers, which writes the files of a bag one after the other, and ``metadata.yaml`` of a
folder.

rosbag2 compresses whole files or single messages, with zstd. Chunks inside MCAP files are compressed independently of
that (`mcap_writer.py`).
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from rosidl_py_gen import type_hash, type_name
from rosidl_py_gen.bags.common import BagError, BagTopic, checked_time, written_durably
from rosidl_py_gen.bags.definition_lookup import definition_of
from rosidl_py_gen.bags.metadata import FileStatistics, metadata_text, qos_text, write_metadata
from rosidl_py_gen.bags.storage.bag_files import SUFFIX
from rosidl_py_gen.bags.storage.zstd import ZstdCompressor
from rosidl_py_gen.base.stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from typing_extensions import Self

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
    with written_durably(target) as partial, source.open("rb") as plain, partial.open("wb") as compressed:
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
        return replace(renamed, offered_qos=qos_text(qos)) if qos else renamed
    definition = definition_of(msg_type)
    return BagTopic(topic, type_name(msg_type), *definition, type_hash=type_hash(msg_type), offered_qos=qos_text(qos))


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
