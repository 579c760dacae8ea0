"""Index of an MCAP file, with offsets of its contents: read from the file, or made by a walk through all records.

The index of the file is used if its checksum is right and if it contains all chunks, channels and schemas that it
refers to. Writers may omit any of these, and killed recorders omit all; then `Walk` creates an index.

rosbag2 writes the ROS distribution of the recorder into metadata records. Humble writes a record ``ROS_DISTRO`` at the
start of the file. Later distributions write the contents of ``metadata.yaml``, which has ``ros_distro``, at its end
(docs/internals/protocol.md 1.9).

During a walk, one chunk is in memory at a time. The walk ends where the file breaks off: within a record, with zeros,
or with a chunk whose end is zeros, as after a power cut. Any other damage raises an error. A reader that skips damaged
parts reports the damage with its topics and times instead.

After damage, only chunks are searched for intact data, because chunks have checksums. A candidate must be consistent:
the lengths of its record and of its content agree. A message may contain a whole MCAP file with chunks. Such a chunk is
not a candidate; it is recognized because its records lead to the end of the contained file.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from io import SEEK_END, BytesIO
from typing import IO, TYPE_CHECKING, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.metadata import recorder_data
from rosidl_py_gen.bags.remote import BagUnreachableError
from rosidl_py_gen.bags.storage.mcap_records import (
    IS_MESSAGE,
    MESSAGE,
    RECORD,
    ChunkDecompressor,
    OtherRecords,
    TooLargeError,
)
from rosidl_py_gen.bags.storage.storage_api import MAX_TIME, library_errors_as_bag_error

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from mcap.summary import Summary
    from typing_extensions import Self

    from rosidl_py_gen.bags.storage.mcap_records import Read

_FOOTER = struct.Struct("<BQQQI8s")
"""Struct layout of the end of an MCAP file: opcode, length, start of the summary, start of the summary's offsets,
checksum of the summary, magic bytes."""
_FOOTER_CRC = 12
"""Number of bytes from the summary's checksum to the end of an MCAP file."""
_BLOCK_BYTES = 1 << 20
_METADATA_NAME = "rosbag2"
_MAX_METADATA_RECORDS = 16
"""Maximum number of records at the start of a file, and of indexed metadata records, in which the distribution is
searched."""
_MAX_METADATA_BYTES = 1 << 20
"""Maximum size of a metadata record in which the distribution is searched: 1000 topics take less than half of it."""


class MessageSegment(NamedTuple):
    """Segment of a file whose messages are read together: a chunk, or messages outside of chunks.

    Attributes:
        offset: start of its first record; for a chunk, of the body of the chunk's record.
        end: end of the segment.
        first, last: log times of the first and the last message.
        channels: ids of the channels of its messages; None if not known.
        is_finished: False for a chunk within which the file breaks off.
    """

    offset: int
    end: int
    is_chunk: bool
    first: int
    last: int
    channels: Collection[int] | None = None
    is_finished: bool = True


@dataclass(slots=True)
class Index:
    """Contents of an MCAP file and their offsets.

    Attributes:
        counts: number of messages by channel id; None if not known.
        time_range: log times of the first and the last message; None if there is none.
        unindexed_ranges: ranges that the index does not describe; they may contain messages.
        truncated_bytes: size of an unfinished record at the end of the file.
        other: records that are neither messages, schemas nor channels.
    """

    segments: list[MessageSegment] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    counts: dict[int, int] | None = field(default_factory=dict)
    time_range: tuple[int, int] | None = None
    unindexed_ranges: list[tuple[int, int]] = field(default_factory=list)
    truncated_bytes: int = 0
    other: OtherRecords = field(default_factory=OtherRecords)

    def add_records(self, records: Iterable[tuple[int, bytes | bytearray]]) -> None:
        """Add schema and channel records to the index.

        If a record contradicts a known record, no record is added, and `BagError` is raised.
        """
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        for opcode, body in records:
            stream = ReadDataStream(BytesIO(body))
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                _require_same(schemas.setdefault(schema.id, self.schemas.get(schema.id, schema)), schema)
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                _require_same(channels.setdefault(channel.id, self.channels.get(channel.id, channel)), channel)
        self.schemas.update(schemas)
        self.channels.update(channels)

    def count(self, messages: Mapping[int, int]) -> None:
        """Add message counts, given by channel id, to the counts in the index."""
        if self.counts is not None:
            for channel, count in messages.items():
                self.counts[channel] = self.counts.get(channel, 0) + count


def _require_same(before: Schema | Channel, now: Schema | Channel) -> None:
    """Raise `BagError` if two schema or channel records with the same id differ, because messages would be decoded
    wrongly.
    """
    if before != now:
        kind = type(now).__name__.lower()
        raise BagError(f"damaged: {kind} {now.id} has two different definitions")


def read_index(stream: IO[bytes], read: Read, size: int) -> Index | None:
    """Return the index that an MCAP file contains; None if it is missing, wrong or incomplete."""
    try:
        stream.seek(-_FOOTER.size, SEEK_END)
        _, _, start, _, expected, _ = _FOOTER.unpack(stream.read())
        if not start or (expected and expected != checksum(read, start, size - _FOOTER_CRC)):
            return None
        stream.seek(0)
        summary = SeekingReader(stream, record_size_limit=size).get_summary()
        return None if summary is None or not _is_complete(summary) else _index_of(summary, start)
    except BagUnreachableError:
        raise
    except Exception:  # arbitrary exceptions for damaged data; fall back to walking the file
        return None


def checksum(read: Read, start: int, end: int) -> int:
    """Return the CRC-32 of a range of a file, read in blocks, as the range may be the whole file."""
    crc = 0
    for at in range(start, end, _BLOCK_BYTES):
        crc = zlib.crc32(read(at, min(_BLOCK_BYTES, end - at)), crc)
    return crc


def _is_complete(stated: Summary) -> bool:
    """Return True if the summary of an MCAP file lists every chunk, channel and schema.

    The package `mcap` does not check this.
    """
    statistics, chunks, channels = stated.statistics, stated.chunk_indexes, stated.channels
    if len({one.chunk_start_offset for one in chunks}) != len(chunks):
        return False
    if statistics is None:
        if not channels or not all(one.message_index_offsets for one in chunks):
            return False
    elif statistics.chunk_count != len(chunks) or statistics.channel_count > len(channels):
        return False
    if any(one.schema_id and one.schema_id not in stated.schemas for one in channels.values()):
        return False
    return all(one.message_index_offsets.keys() <= channels.keys() for one in chunks)


def _index_of(stated: Summary, summary_start: int) -> Index:
    chunks = sorted(stated.chunk_indexes, key=lambda one: one.chunk_start_offset)
    gaps, at = [], len(MCAP0_MAGIC)
    for one in chunks:
        gaps.append((at, one.chunk_start_offset))
        at = one.chunk_start_offset + one.chunk_length + one.message_index_length
    gaps.append((at, summary_start))
    segments = [
        MessageSegment(
            one.chunk_start_offset + RECORD.size,
            one.chunk_start_offset + one.chunk_length,
            True,
            one.message_start_time,
            one.message_end_time,
            one.message_index_offsets or None,
        )
        for one in chunks
    ]
    statistics = stated.statistics
    if statistics is not None:
        counts = {number: statistics.channel_message_counts.get(number, 0) for number in stated.channels}
        span = (statistics.message_start_time, statistics.message_end_time) if statistics.message_count else None
        return Index(segments, dict(stated.channels), dict(stated.schemas), counts, span, gaps)
    span = (min(one.first for one in segments), max(one.last for one in segments)) if segments else None
    return Index(segments, dict(stated.channels), dict(stated.schemas), None, span, gaps)


def recorded_distro(stream: IO[bytes], size: int) -> str:
    """Return the distribution of the recorder in the metadata records of an MCAP file; "" if missing or damaged."""
    try:
        for body in _metadata_records(stream, size):
            record = Metadata.read(ReadDataStream(BytesIO(body)))
            if record.name != _METADATA_NAME:
                continue
            distro = (
                record.metadata.get("ROS_DISTRO")
                or recorder_data(record.metadata.get("serialized_metadata", "")).ros_distro
            )
            if distro:
                return distro
    except BagUnreachableError:
        raise
    except Exception:  # arbitrary exceptions for damaged data; the distribution name is optional
        return ""
    return ""


def _metadata_records(stream: IO[bytes], size: int) -> Iterator[bytes]:
    """Yield the contents of the metadata records at the start of an MCAP file, then of the indexed records
    of rosbag2.
    """
    at = len(MCAP0_MAGIC)
    for _ in range(_MAX_METADATA_RECORDS):
        opcode, length = _head(stream, at)
        if opcode not in (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
            break
        if opcode == Opcode.METADATA and length <= _MAX_METADATA_BYTES:
            yield stream.read(length)
        at += RECORD.size + length
    stream.seek(0)
    summary = SeekingReader(stream, record_size_limit=size).get_summary()
    indexes = [one for one in summary.metadata_indexes if one.name == _METADATA_NAME] if summary else []
    for one in indexes[:_MAX_METADATA_RECORDS]:
        opcode, length = _head(stream, one.offset)
        if opcode == Opcode.METADATA and length <= _MAX_METADATA_BYTES:
            yield stream.read(length)


def _head(stream: IO[bytes], at: int) -> tuple[int, int]:
    stream.seek(at)
    head = stream.read(RECORD.size)
    return RECORD.unpack(head) if len(head) == RECORD.size else (0, 0)


# ----------------------------------------------------------------------------------------------------------------- walk


_PROGRESS_BYTES = 1 << 20
_MAX_SEGMENT_BYTES = 1 << 20
"""Maximum size in bytes of a segment, which is a group of consecutive messages outside of chunks."""
_CRC = struct.Struct("<I")
_ROSBAG2_NAME = b"\x07\0\0\0rosbag2"
_SUMMARY = "SCHEMA CHANNEL CHUNK_INDEX ATTACHMENT_INDEX STATISTICS METADATA_INDEX SUMMARY_OFFSET FOOTER"
_DATA = (
    *(Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK),
    *(Opcode.ATTACHMENT, Opcode.METADATA),
)
"""Opcodes of MCAP records that contain data. If the file ends within such a record, its bytes count as lost; an
unfinished index record does not count."""
_AFTER_DATA = [b"", *(bytes([Opcode[name]]) for name in _SUMMARY.split())]
"""Possible bytes after the data section of an MCAP file: opcodes of summary and footer records, or b"" if the file ends
there."""
_HEAD = struct.Struct("<BQQQQII")
"""Struct layout of the start of a chunk record: opcode, length, first and last log time, size, checksum, length of the
name of the compression."""
_COMPRESSIONS = (b"", b"lz4", b"zstd")
_MAX_HEAD = _HEAD.size + 4 + 8
_CANDIDATE = re.compile(rb"\x06(?=.{5}\0\0\0)", re.DOTALL)
"""Regular expression for the opcode and length of a chunk record that is shorter than 2**40 bytes."""
_WINDOW = 1 << 20
_FIRST_PRIVATE = 0x80
_INDEX = struct.Struct("<BQH")
"""Struct layout of the start of a message index record: opcode, length, channel."""


class DamagedRange(NamedTuple):
    """Damaged range of an MCAP file.

    Attributes:
        first, last: log times of its messages; None if not known.
        channels: ids of the channels of its messages; None if not known.
    """

    offset: int
    end: int
    error: BagError
    first: int | None = None
    last: int | None = None
    channels: Collection[int] | None = None


OnDamage = Callable[[DamagedRange], None]
"""Callback for a damaged range of an MCAP file; it records the range, or raises `BagError`."""


class Walk:
    """Walk through the records of an MCAP file of `size` bytes, which adds the file's contents to `index`.

    Args:
        on_damage: called with each damaged range; if it returns, the walk continues after the range.
        skips: damaged parts are skipped, so intact chunks are searched after them.
        on_progress: called after each megabyte with the number of bytes since the start.
    """

    def __init__(
        self,
        size: int,
        chunks: ChunkDecompressor,
        index: Index,
        on_damage: OnDamage,
        skips: bool,
        on_progress: Callable[[int], object],
    ) -> None:
        self._read, self._size, self._chunks, self._index = chunks.read, size, chunks, index
        self._on_damage, self._skips, self._on_progress = on_damage, skips, on_progress
        self._unchunked = _UnchunkedMessages(index)
        self._end = 0
        self._is_doubtful = False  # since the last damage, until a chunk is right: a chunk may have lost its head
        self._doubtful_from: int | None = None

    def run(self, start: int, end: int) -> None:
        """Add the records from offset `start` to offset `end`, or to the place where the file breaks off,
        to the index.
        """
        at, self._end = start, end
        reported = start
        while at < end:
            if at - reported >= _PROGRESS_BYTES:
                reported = at
                self._on_progress(at - start)
            head = self._read(at, MESSAGE.size)
            if len(head) < RECORD.size:
                self._index.truncated_bytes = self._truncated_size(at)
                break
            opcode, length = RECORD.unpack_from(head)
            after = at + RECORD.size + length
            if after > self._size or not is_known(opcode):
                if self._breaks_off(opcode, at):
                    if opcode == Opcode.CHUNK:
                        self._add_unfinished_chunk(at)
                    break
                at = self._skip(at, self._next_chunk(at), BagError(f"no valid record at byte {at}"))
                continue
            if opcode == Opcode.DATA_END:
                at = self._check_data_end(at, length, after)
                continue
            if opcode == IS_MESSAGE:
                if len(head) < MESSAGE.size or length < MESSAGE.size - RECORD.size:
                    at = self._skip(at, after, BagError(f"a message of {length} bytes at offset {at}"))
                    continue
                if not self._is_doubtful:
                    self._unchunked.add(at, after, *MESSAGE.unpack(head)[2:5:2])
                elif self._doubtful_from is None:
                    self._doubtful_from = at
                at = after
                continue
            self._report_doubtful(at)
            self._unchunked.end()
            at = self._add_other_record(opcode, at, after)
            if at < 0:
                return
        self._report_doubtful(at)
        self._unchunked.end()
        if at > max(start, end):
            self._skip(end, at, BagError(f"a record exceeds byte {end}, where the next one begins"))

    def _next_chunk(self, at: int) -> int:
        return next_chunk(self._read, at + 1, self._end, self._size) if self._skips else self._end

    def _skip(self, at: int, after: int, error: BagError, head: ChunkHead | None = None) -> int:
        if head is None:
            self._on_damage(DamagedRange(at, after, error))
        else:
            channels = indexed_channels(self._read, after, self._size)
            self._on_damage(DamagedRange(at, after, error, head.first, head.last, channels))
        self._is_doubtful = True
        return after

    def _report_doubtful(self, at: int) -> None:
        """Report messages outside of chunks that follow a damaged part and end before offset `at` as damaged, because
        they have no checksum.
        """
        if self._doubtful_from is not None:
            self._skip(self._doubtful_from, at, BagError("messages after a damaged part, which have no checksum"))
            self._doubtful_from = None

    def _breaks_off(self, opcode: int, at: int) -> bool:
        """Return True if the file ends within the record at offset `at`, or has only zeros from there on, as after a
        power cut.
        """
        if self._is_closed():
            return False
        if not opcode:
            if not are_zeros(self._read, at, self._size):
                return False
            self._unchunked.drop_unfinished(self._read(at - 1, 1))
        elif not is_known(opcode) or self._continues(at):
            return False
        self._index.truncated_bytes = self._truncated_size(at) if opcode else self._size - at
        return True

    def _truncated_size(self, at: int) -> int:
        """Return the number of lost bytes if the file ends within the record at `at`.

        Returns 0 for records of the index or of rosbag2's metadata.
        """
        start = self._read(at, RECORD.size + len(_ROSBAG2_NAME))
        if start[:1] == bytes([Opcode.METADATA]) and start[RECORD.size :] == _ROSBAG2_NAME:
            return 0
        return self._size - at if start and (start[0] in _DATA or start[0] >= _FIRST_PRIVATE) else 0

    def _is_closed(self) -> bool:
        return self._read(self._size - len(MCAP0_MAGIC), len(MCAP0_MAGIC)) == MCAP0_MAGIC

    def _continues(self, at: int) -> bool:
        """Return True if intact chunks follow a record that reaches beyond the end of the file.

        Its length must be damaged then.
        """
        if ChunkHead.at(self._read, at) is not None:
            return False
        return next_chunk(self._read, at + 1, self._size, self._size) < self._size

    def _check_data_end(self, at: int, length: int, after: int) -> int:
        """Check the record at `at` that ends the data section, and return the offset where the walk continues."""
        is_all = self._end == self._size or not self._index.segments  # else only ranges between chunks were read
        follows = after == self._end if self._end < self._size else self._read(after, 1) in _AFTER_DATA
        if not follows:
            text = f"the data ends at byte {after}, where neither the summary nor the footer begins"
            return self._skip(at, after, BagError(text))
        if self._unchunked.count or (is_all and not self._skips):  # chunks have checksums, and some may be skipped
            self._check_crc(at, length)
        return self._end

    def _check_crc(self, at: int, length: int) -> None:
        """Raise `BagError` if the checksum of the data section is wrong.

        Records outside of chunks have no checksum of their own.
        """
        if not self._chunks.validate_crcs or length != _CRC.size:
            return
        (expected,) = _CRC.unpack(self._read(at + RECORD.size, _CRC.size))
        if expected and expected != checksum(self._read, 0, at):
            raise BagError("damaged: the checksum of its messages is wrong")

    def _add_other_record(self, opcode: int, at: int, after: int) -> int:
        """Add a record that is not a message to the index.

        Returns the offset after the record, or -1 if the file ends within the record.
        """
        head = ChunkHead.at(self._read, at)
        body = at + RECORD.size
        try:
            with library_errors_as_bag_error(self._chunks.path):
                if opcode == Opcode.CHUNK:
                    segment = MessageSegment(body, after, True, 0, 0)
                    _add_chunk(self._chunk_blocks(body, after), segment, self._index)
                    self._is_doubtful = False
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._index.add_records([(opcode, self._read(body, after - body))])
                elif head is not None:
                    raise BagError(f"a chunk at byte {at} with the opcode {opcode}")
                else:
                    self._index.other.add(opcode, at)
        except (BagUnreachableError, TooLargeError):
            raise
        except BagError as error:
            if opcode == Opcode.CHUNK and not self._is_closed() and are_zeros(self._read, after, self._size):
                self._index.truncated_bytes = self._size - at  # the blocks of the disk were not all written
                return -1
            if opcode == Opcode.CHUNK and head is None:
                after = self._next_chunk(at)
            return self._skip(at, after, error, head)
        return after

    def _add_unfinished_chunk(self, at: int) -> None:
        """Add the whole records of a chunk to the index, if the file ends within the chunk at `at`.

        If a record is damaged, no record is added.
        """
        body = at + RECORD.size
        segment = MessageSegment(body, self._size, True, 0, 0, is_finished=False)
        try:
            with library_errors_as_bag_error(self._chunks.path):
                data, missing = self._chunks.unfinished(body, self._size)
                if data:
                    _add_chunk(iter([data]), segment, self._index)
                    self._index.truncated_bytes = missing
        except BagUnreachableError:
            raise
        except BagError:  # its beginning is missing, too
            return

    def _chunk_blocks(self, body: int, end: int) -> Iterator[bytes | bytearray]:
        head = self._chunks.header(body, end)
        if not self._chunks.is_large(head):
            yield self._chunks.decompress(head)
            return
        for data, whole in self._chunks.blocks(head, self._chunks.validate_crcs):
            yield data if whole == len(data) else data[:whole]


def _records(data: bytes | bytearray) -> Iterator[tuple[int, int, int]]:
    at, size = 0, len(data)
    while at < size:
        opcode, length = RECORD.unpack_from(data, at)
        end = at + RECORD.size + length
        if end > size:
            raise BagError("damaged: a record in a chunk is longer than the chunk")
        yield opcode, at, end
        at = end


def _add_chunk(some: Iterator[bytes | bytearray], segment: MessageSegment, index: Index) -> None:
    """Add the contents of a chunk, which are given in blocks, to the index.

    If the chunk is damaged, nothing is added, and `BagError` is raised.
    `segment` has the offset of the chunk; this function sets its times and channels.
    """
    first, last, counts, unknown = MAX_TIME, -1, dict[int, int](), 0
    definitions: list[tuple[int, bytes | bytearray]] = []
    for data in some:
        for opcode, at, after in _records(data):
            if opcode == IS_MESSAGE:
                if after - at < MESSAGE.size:
                    raise BagError(f"a message of {after - at} bytes, shorter than its times")
                _, _, channel, _, log_time, _ = MESSAGE.unpack_from(data, at)
                counts[channel] = counts.get(channel, 0) + 1
                first, last = min(first, log_time), max(last, log_time)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                definitions.append((opcode, data[at + RECORD.size : after]))
            else:
                unknown += 1
    index.add_records(definitions)
    if unknown:
        index.other.unknown_in_chunks[segment.offset] = unknown
    if counts:
        index.count(counts)
        _add_segment(index, segment._replace(first=first, last=last, channels=counts.keys()))


def _add_segment(index: Index, segment: MessageSegment) -> None:
    index.segments.append(segment)
    first, last = index.time_range or (segment.first, segment.last)
    index.time_range = min(first, segment.first), max(last, segment.last)


class _UnchunkedMessages:
    """Collector of messages outside of chunks, which are combined into segments of about a megabyte."""

    def __init__(self, index: Index) -> None:
        self._index = index
        self._segment: MessageSegment | None = None
        self._channels: set[int] = set()
        self._last: tuple[int, int, int, int] | None = None
        self.count = 0

    def add(self, at: int, after: int, channel: int, log_time: int) -> None:
        self._flush()
        self._last = at, after, channel, log_time

    def drop_unfinished(self, last_byte: bytes) -> None:
        """Drop the last message if it ends with zeros that may come from a power cut, because more zeros follow until
        the end of the file.
        """
        if last_byte == b"\0":
            self._last = None

    def _flush(self) -> None:
        if self._last is None:
            return
        at, after, channel, log_time = self._last
        self._last = None
        if self._segment is not None and after - self._segment.offset > _MAX_SEGMENT_BYTES:
            self._end_segment()
        segment = self._segment or MessageSegment(at, after, False, log_time, log_time)
        self._channels.add(channel)
        self._segment = segment._replace(
            end=after, first=min(segment.first, log_time), last=max(segment.last, log_time)
        )
        self.count += 1
        self._index.count({channel: 1})

    def _end_segment(self) -> None:
        if self._segment is not None:
            _add_segment(self._index, self._segment._replace(channels=self._channels))
        self._segment, self._channels = None, set()

    def end(self) -> None:
        self._flush()
        self._end_segment()


# ------------------------------------------------------------------------------------------------------ intact chunks


class ChunkHead(NamedTuple):
    """Start of a chunk record whose lengths agree with each other.

    Attributes:
        end: end of the record, which may be after the end of the file.
        first, last: log times of the first and the last message.
    """

    end: int
    first: int
    last: int

    @classmethod
    def at(cls, read: Read, at: int) -> Self | None:
        """Return the start of the chunk record at an offset of the file; its opcode is not checked.

        Returns None if its lengths do not agree.
        """
        return cls.within(read(at, _MAX_HEAD), 0, at)

    @classmethod
    def within(cls, data: bytes, start: int, at: int) -> Self | None:
        """Return the start of the chunk record at index `start` of `data`, which is at offset `at` of the file.

        Returns None if the lengths in the record do not agree.
        """
        if len(data) < start + _HEAD.size + 8:
            return None
        _, length, first, last, _, _, name = _HEAD.unpack_from(data, start)
        after = start + _HEAD.size + name
        if name > 4 or len(data) < after + 8 or data[start + _HEAD.size : after] not in _COMPRESSIONS:
            return None
        (stored,) = struct.unpack_from("<Q", data, after)
        if first > last or after + 8 + stored != start + RECORD.size + length:
            return None
        return cls(at + RECORD.size + length, first, last)


def next_chunk(read: Read, at: int, end: int, size: int) -> int:
    """Return the offset of the next chunk at or after `at` that looks intact.

    Returns `end` if no such chunk starts before `end`. `size` is the size of the file. If a message contains an MCAP
    file, the chunks of the contained file are skipped.
    """
    while at < end:
        window = read(at, min(_WINDOW, end - at) + _MAX_HEAD)
        for match in _CANDIDATE.finditer(window, 0, min(_WINDOW, end - at) + RECORD.size):
            head = ChunkHead.within(window, match.start(), at + match.start())
            if head is None or head.end > size:
                continue
            embedded = _embedding_end(read, head.end, size)
            if not embedded:
                return min(at + match.start(), end)
            at = embedded
            break
        else:
            at += _WINDOW
    return end


def _embedding_end(read: Read, at: int, size: int) -> int:
    """Return the end of an MCAP file contained in a message, if the records from offset `at` on belong to
    it; else 0.
    """
    while at + RECORD.size <= size:
        head = read(at, _MAX_HEAD)
        if head.startswith(MCAP0_MAGIC):
            return at + len(MCAP0_MAGIC) if at + len(MCAP0_MAGIC) < size else 0
        opcode, length = RECORD.unpack_from(head)
        if not is_known(opcode) or (opcode == Opcode.CHUNK and ChunkHead.within(head, 0, at) is None):
            return 0  # here the walk searches again, so both take linear time
        at += RECORD.size + length
    return 0


def is_known(opcode: int) -> bool:
    """Return True for the record opcodes of MCAP, and for opcodes that MCAP reserves for applications."""
    return 0 < opcode <= max(Opcode) or opcode >= _FIRST_PRIVATE


def indexed_channels(read: Read, at: int, size: int) -> set[int] | None:
    """Return the channel ids in the message indexes of a chunk, which begin at `at`; None if there are none."""
    channels = set()
    while at + _INDEX.size <= size:
        opcode, length, channel = _INDEX.unpack(read(at, _INDEX.size))
        if opcode != Opcode.MESSAGE_INDEX or length < 2:
            break
        channels.add(channel)
        at += RECORD.size + length
    return channels or None


def are_zeros(read: Read, at: int, size: int) -> bool:
    """Return True if a file has only zero bytes from `at` to its end, as after a power cut, or ends at `at`."""
    return not any(read(start, _WINDOW).strip(b"\0") for start in range(at, size, _WINDOW))
