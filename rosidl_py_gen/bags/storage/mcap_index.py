"""Index of an MCAP file, with offsets of its contents, and search for the ROS distribution of its recorder.

An index is used if its checksum is right and if it contains all chunks, channels and schemas that it refers to. Writers
may omit any of these, and killed recorders omit all; then the module `walk` creates an index.

rosbag2 writes the distribution into metadata records. Humble writes a record ``ROS_DISTRO`` at the start of the file.
Later distributions write the contents of ``metadata.yaml``, which has ``ros_distro``, at its end
(docs/internals/protocol.md 1.9).
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from io import SEEK_END, BytesIO
from struct import Struct
from typing import IO, TYPE_CHECKING, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.metadata import recorder_data
from rosidl_py_gen.bags.remote import BagUnreachableError
from rosidl_py_gen.bags.storage.mcap_chunks import RECORD
from rosidl_py_gen.bags.storage.mcap_extras import OtherRecords

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from mcap.summary import Summary

    from rosidl_py_gen.bags.storage.mcap_chunks import Read

_FOOTER = Struct("<BQQQI8s")
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
