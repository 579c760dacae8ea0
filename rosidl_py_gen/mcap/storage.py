"""The files a bag can consist of: MCAP and SQLite. Each gives its topics and raw messages in order of log time.

Whatever a damaged file makes the libraries raise becomes a `BagError` that names the file.
"""

from __future__ import annotations

import contextlib
import heapq
import sqlite3
import struct
import zlib
from bisect import bisect_left
from dataclasses import replace
from functools import cached_property
from io import SEEK_END
from operator import attrgetter, itemgetter
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, DataEnd, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC
from zstandard import frame_content_size

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.mcap.common import BagError, BagTopic

if TYPE_CHECKING:
    from collections.abc import Collection, Container, Iterator, Mapping
    from pathlib import Path

    from mcap.summary import Summary

_MOST_INT = (1 << 63) - 1
_RECORD = struct.Struct("<BQ")
"""Kind and length of a record of MCAP."""
_MESSAGE = struct.Struct("<BQHIQQ")
"""The same of a message, then channel, sequence, log time and publish time; the rest of the record is its data."""
_FOOTER = struct.Struct("<BQQQI8s")
"""The end of a file: kind, length, where the index begins, a part of it, checksum of the index and of what is left of
the checksum here, and the magic bytes.
"""
_FOOTER_CRC = 12
"""Where the checksum is, from the end."""
_LARGE = 8
"""A message is large when its chunk has at most so many times its size."""
Raw: TypeAlias = "tuple[str, bytes | memoryview, int, int]"
"""What a `BagMessage` has, before decoding; a plain tuple is made in a third of the time. Large messages view the chunk
they are in, and so do the arrays that are decoded from them.
"""
_LOG_TIME = itemgetter(2)
_MOST_CHUNK_BYTES, _MOST_RATIO = 1 << 28, 1000
"""A chunk may become so large, or so many times its size in the file: more is a trap for the reader's memory."""
_PIECE = 1 << 20
_TABLES = "messages", "topics", "message_definitions"
"""What is read of a database."""
_IS_MESSAGE = int(Opcode.MESSAGE)  # comparing with the enum costs as much as the rest of the loop


class Storage(Protocol):
    """One file."""

    is_whole: bool
    """False when the file has no index, as after a crash."""

    def topics(self) -> list[BagTopic]:
        """What it holds, with counts where it has an index."""

    def span(self) -> tuple[int, int] | None:
        """Log times of the first and the last message; None when there is none."""

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
        """Raw messages with ``start <= log_time < end``, by log time; None means all topics."""

    def close(self) -> None:
        """May be called twice."""


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    try:
        yield
    except (RosidlError, GeneratorExit):
        raise
    except MemoryError:
        raise BagError(f"{path}: damaged: a length in it is larger than memory") from None
    except Exception as error:  # compression libraries, struct, sqlite: whatever wrong bytes lead to
        raise BagError(f"{path}: damaged: {type(error).__name__}: {str(error)[:200]}") from None


class McapFile:
    """An MCAP file; without an index, as after a crash, it is read from the beginning to where it ends."""

    def __init__(self, path: Path, validate_crcs: bool) -> None:
        self._path = path
        self._validate_crcs = validate_crcs
        self._stream = path.open("rb")
        try:
            with _told(path):
                self._size = path.stat().st_size
                if not MCAP0_MAGIC.startswith(self._stream.read(len(MCAP0_MAGIC))):  # shorter: nothing was written yet
                    raise BagError(f"{path}: damaged: it does not begin as MCAP files do")
                self._summary = self._checked_summary()
        except BaseException:
            self._stream.close()
            raise
        self.is_whole = self._summary is not None and bool(self._summary.channels or not self._summary.chunk_indexes)

    def _checked_summary(self) -> Summary | None:
        """The index; None when there is none, or a wrong one: the package does not look at its checksum, nor whether
        it names a chunk many times, whose messages would all be kept until they are due.
        """
        try:
            self._stream.seek(-_FOOTER.size, SEEK_END)
            _, _, start, _, expected, _ = _FOOTER.unpack(self._stream.read())
            if not start or (expected and expected != self._checksum(start, self._size - _FOOTER_CRC)):
                return None
            self._stream.seek(0)
            found = SeekingReader(self._stream, record_size_limit=self._size).get_summary()
            chunks = found.chunk_indexes if found else []
            return found if len({one.chunk_start_offset for one in chunks}) == len(chunks) else None
        except Exception:
            return None

    def _checksum(self, start: int, end: int) -> int:
        """In pieces, as a file may say that all of it is index."""
        self._stream.seek(start)
        found = 0
        for at in range(start, end, _PIECE):
            found = zlib.crc32(self._stream.read(min(_PIECE, end - at)), found)
        return found

    def topics(self) -> list[BagTopic]:
        with _told(self._path):
            if self._summary is None or not self.is_whole:
                return _joined(self._scanned[0])
            told, counts = self._summary, getattr(self._summary.statistics, "channel_message_counts", None)
            return _joined(
                _topic(channel, told.schemas.get(channel.schema_id), None if counts is None else counts.get(id, 0))
                for id, channel in told.channels.items()
            )

    def span(self) -> tuple[int, int] | None:
        with _told(self._path):
            statistics = None if self._summary is None or not self.is_whole else self._summary.statistics
            if statistics is None:
                return self._scanned[1]
            times = statistics.message_start_time, statistics.message_end_time
            return times if statistics.message_count else None

    @cached_property
    def _scanned(self) -> tuple[list[BagTopic], tuple[int, int] | None]:
        """Topics and span of a file without index, which has to be read for it."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        counted: dict[int, int] = {}
        first, last = _MOST_INT, -1
        for record in self._records():
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                counted[record.channel_id] = counted.get(record.channel_id, 0) + 1
                first, last = min(first, record.log_time), max(last, record.log_time)
        rows = [_topic(one, schemas.get(one.schema_id), counted.get(id, 0)) for id, one in channels.items()]
        return rows, (first, last) if counted else None

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
        with _told(self._path):
            if self.is_whole and self._summary is not None and self._summary.chunk_indexes:
                yield from self._indexed(self._summary, topics, start, end)
            else:
                yield from sorted(self._unindexed(topics, start, end), key=_LOG_TIME)

    def _indexed(self, told: Summary, topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
        """Chunk after chunk; what is later than the beginning of the next one waits for it.

        The package's own reader orders message by message, and its objects cost twice as much as decoding.
        """
        names = {id: one.topic for id, one in told.channels.items() if topics is None or one.topic in topics}
        chunks = sorted(
            (one for one in told.chunk_indexes if one.message_start_time < end and one.message_end_time >= start),
            key=attrgetter("message_start_time"),
        )
        if topics is not None:
            chunks = [
                one for one in chunks if not one.message_index_offsets or names.keys() & one.message_index_offsets
            ]
        waiting: list[Raw] = []
        for number, chunk in enumerate(chunks):
            found = self._chunk(chunk.chunk_start_offset, names, told.channels)
            waiting += [one for one in found if start <= one[2] < end]
            waiting.sort(key=_LOG_TIME)
            if number + 1 < len(chunks):
                ready = bisect_left(waiting, chunks[number + 1].message_start_time, key=_LOG_TIME)
                yield from waiting[:ready]
                del waiting[:ready]
        yield from waiting

    def _chunk(self, offset: int, names: Mapping[int, str], known: Container[int]) -> list[Raw]:
        """The messages of the channels in `names`."""
        self._stream.seek(offset + _RECORD.size)
        chunk = Chunk.read(ReadDataStream(self._stream))
        self._require_size(chunk)
        stream, size = get_chunk_data_stream(chunk, validate_crc=self._validate_crcs)
        data = stream.read(size)
        view = memoryview(data)
        found: list[Raw] = []
        at = 0
        while at < size:
            opcode, length = _RECORD.unpack_from(data, at)
            end = at + _RECORD.size + length
            if end > size:
                raise BagError(f"{self._path}: damaged: a record in a chunk is longer than the chunk")
            if opcode == _IS_MESSAGE:
                _, _, channel, _, log_time, publish_time = _MESSAGE.unpack_from(data, at)
                if channel in names:
                    whole = view if length * _LARGE > size else data
                    found.append((names[channel], whole[at + _MESSAGE.size : end], log_time, publish_time))
                elif channel not in known:
                    raise BagError(f"{self._path}: damaged: a message of channel {channel}, which there is not")
            at = end
        return found

    def _require_size(self, chunk: Chunk) -> None:
        """Raises `BagError` before a chunk is decompressed that says it becomes too large."""
        size = chunk.uncompressed_size
        if chunk.compression == "zstd":
            size = max(size, frame_content_size(chunk.data))
        if size > max(_MOST_CHUNK_BYTES, _MOST_RATIO * len(chunk.data)):
            raise BagError(
                f"{self._path}: damaged: a chunk of {len(chunk.data)} bytes says it holds {size}; expected at most "
                f"{_MOST_CHUNK_BYTES}, or {_MOST_RATIO} times its size"
            )

    def _unindexed(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
        names: dict[int, str] = {}
        for record in self._records():
            if isinstance(record, Channel):
                names[record.id] = record.topic
            elif isinstance(record, Message) and start <= record.log_time < end:
                topic = names.get(record.channel_id)
                if topic is not None and (topics is None or topic in topics):
                    yield topic, record.data, record.log_time, record.publish_time

    def _records(self) -> Iterator[Any]:
        """Everything up to the end, or to where the file breaks off."""
        if self._size < len(MCAP0_MAGIC):
            return
        self._stream.seek(0)
        crcs = self._validate_crcs
        reader = StreamReader(self._stream, emit_chunks=True, validate_crcs=crcs, record_size_limit=self._size)
        try:
            for record in reader.records:
                if isinstance(record, DataEnd):  # the index follows, which was missing or damaged
                    return
                if isinstance(record, Chunk):
                    self._require_size(record)
                    yield from breakup_chunk(record, validate_crc=crcs)
                else:
                    yield record
        except (EndOfFile, RecordLengthLimitExceeded):  # the limit is the size of the file
            return
        except struct.error:
            if self._stream.tell() < self._size:
                raise  # it does not end within a number

    def close(self) -> None:
        self._stream.close()


def _topic(channel: Channel, schema: Schema | None, count: int | None) -> BagTopic:
    told = channel.metadata
    return BagTopic(
        channel.topic,
        schema.name if schema else "",
        schema.data.decode(errors="replace") if schema else "",
        schema.encoding if schema else "",
        channel.message_encoding,
        told.get("topic_type_hash", ""),
        told.get("offered_qos_profiles", ""),
        count,
    )


def _joined(rows: Any) -> list[BagTopic]:
    """One row for each topic: files may have several channels of one name."""
    found: dict[str, BagTopic] = {}
    for row in rows:
        before = found.get(row.name)
        both = None if before is None or before.count is None or row.count is None else before.count + row.count
        found[row.name] = row if before is None else replace(before, count=both)
    return sorted(found.values(), key=attrgetter("name"))


class SqliteFile:
    """A ``.db3`` file of rosbag2."""

    is_whole = True

    def __init__(self, path: Path) -> None:
        self._path = path
        if not path.is_file():
            raise BagError(f"{path}: there is no such file")
        with _told(path):
            self._base = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
        try:
            with _told(path):
                self._base.execute("pragma trusted_schema=off")
                self._require_tables()
        except BaseException:
            self._base.close()
            raise

    def _require_tables(self) -> None:
        """Raises `BagError` when something is computed, not stored: a few bytes can make rows without end."""
        for name, kind, text in self._base.execute("select lower(name), type, lower(sql) from sqlite_master"):
            if name in _TABLES and (kind != "table" or "virtual" in str(text)):
                raise BagError(f"{self._path}: {name} is no stored table")
        for name in _TABLES:
            if any(row[6] for row in self._base.execute(f"pragma table_xinfo({name})")):
                raise BagError(f"{self._path}: {name} has columns that are not stored")

    def topics(self) -> list[BagTopic]:
        with _told(self._path):
            columns = {row[1] for row in self._base.execute("pragma table_info(topics)")}
            texts = self._definitions()
            counts = dict(self._base.execute("select topic_id, count(*) from messages group by topic_id"))
            optional = [name if name in columns else "''" for name in ("offered_qos_profiles", "type_description_hash")]
            rows = self._base.execute(
                f"select id, name, type, serialization_format, {', '.join(optional)} from topics"
            ).fetchall()
            return _joined(
                BagTopic(name, kind, *texts.get(kind, ("", "")), how, hash_, qos, counts.get(key, 0))
                for key, name, kind, how, qos, hash_ in ((row[0], *map(str, row[1:])) for row in rows)
            )

    def span(self) -> tuple[int, int] | None:
        with _told(self._path):
            first, last = self._base.execute("select min(timestamp), max(timestamp) from messages").fetchone()
            if first is None:
                return None
            if not isinstance(first, int) or not isinstance(last, int):
                raise BagError(f"{self._path}: a message has no time")
            return first, last

    def _definitions(self) -> dict[Any, tuple[str, str]]:
        tables = {row[0] for row in self._base.execute("select name from sqlite_master")}
        if "message_definitions" not in tables:
            return {}
        rows = self._base.execute("select topic_type, encoded_message_definition, encoding from message_definitions")
        return {name: (str(text), str(how)) for name, text, how in rows}

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
        with _told(self._path):
            names = {key: str(name) for key, name in self._base.execute("select id, name from topics")}
            wanted = [key for key, name in names.items() if topics is None or name in topics]
            marks = ",".join("?" * len(wanted))
            rows = self._base.execute(
                f"select topic_id, timestamp, data from messages where topic_id in ({marks}) and timestamp >= ? "
                "and timestamp < ? order by timestamp, id",
                [*wanted, min(start, _MOST_INT), min(end, _MOST_INT)],
            )
            for key, stamp, data in rows:
                if not isinstance(data, bytes) or not isinstance(stamp, int):
                    raise BagError(f"{self._path}: a message on {names[key]} is no bytes with a time")
                yield names[key], data, stamp, stamp

    def close(self) -> None:
        self._base.close()


def merged(files: list[Storage], topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
    """The messages of several files by log time."""
    if len(files) == 1:
        return files[0].messages(topics, start, end)
    return heapq.merge(*(one.messages(topics, start, end) for one in files), key=_LOG_TIME)
