"""The index of an MCAP file: what the file contains, and where.

An index is used if its checksum is right and it knows all chunks, channels and schemas that it refers to. Writers may
omit any of these, and killed recorders omit all; then `walk` makes one.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from io import SEEK_END
from struct import Struct
from typing import IO, TYPE_CHECKING, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Schema
from mcap.writer import MCAP0_MAGIC

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.remote import BagUnreachableError
from rosidl_py_gen.bags.storage.mcap_chunks import RECORD

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from mcap.summary import Summary

_FOOTER = Struct("<BQQQI8s")
"""The end of a file: kind, length, where the index begins, a part of it, checksum of the index and of what is left of
the checksum here, and the magic bytes.
"""
_FOOTER_CRC = 12
"""Where the checksum is, from the end."""
_PIECE = 1 << 20


class MessageSegment(NamedTuple):
    """A stretch of a file whose messages are read together: a chunk, or messages that are in none.

    Attributes:
        offset: where its first record begins; for a chunk, the body of its record.
        end: where it ends.
        first, last: log times.
        channels: those it has messages of; None when that is not known.
    """

    offset: int
    end: int
    is_chunk: bool
    first: int
    last: int
    channels: Collection[int] | None = None


@dataclass(slots=True)
class Index:
    """Contents of a file.

    Attributes:
        counts: messages by channel; None when the file does not tell.
        span: log times of the first and the last message, None when there is none.
        gaps: stretches that the index says nothing about; messages may be there, too.
        unread_bytes: at the end of the file, of a record that was not finished.
    """

    parts: list[MessageSegment] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    counts: dict[int, int] | None = field(default_factory=dict)
    time_range: tuple[int, int] | None = None
    unindexed_ranges: list[tuple[int, int]] = field(default_factory=list)
    truncated_bytes: int = 0

    def add_record(self, opcode: int, body: bytes | bytearray) -> None:
        """Add what a record states of a schema or channel."""
        self.take_all([(opcode, body)])

    def take_all(self, records: Iterable[tuple[int, bytes | bytearray]]) -> None:
        """Add what several records state of schemas and channels, or nothing of it if it contradicts what is known."""
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        for opcode, body in records:
            stream = ReadDataStream(_stream(body))
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                _require_same(schemas.setdefault(schema.id, self.schemas.get(schema.id, schema)), schema)
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                _require_same(channels.setdefault(channel.id, self.channels.get(channel.id, channel)), channel)
        self.schemas.update(schemas)
        self.channels.update(channels)

    def count(self, messages: Mapping[int, int]) -> None:
        """Add numbers of messages by channel."""
        if self.counts is not None:
            for channel, count in messages.items():
                self.counts[channel] = self.counts.get(channel, 0) + count


def _require_same(before: Schema | Channel, now: Schema | Channel) -> None:
    """Raises `BagError`: what was written with the other one would be read wrong."""
    if before != now:
        kind = type(now).__name__.lower()
        raise BagError(f"damaged: {kind} {now.id} is told twice, and not the same")


def _stream(body: bytes | bytearray) -> IO[bytes]:
    from io import BytesIO

    return BytesIO(body)


# ------------------------------------------------------------------------------------------------------- the file's own


def read_index(stream: IO[bytes], size: int) -> Index | None:
    """The file's index; None when there is none, or it is wrong or says too little."""
    try:
        stream.seek(-_FOOTER.size, SEEK_END)
        _, _, start, _, expected, _ = _FOOTER.unpack(stream.read())
        if not start or (expected and expected != checksum(stream, start, size - _FOOTER_CRC)):
            return None
        stream.seek(0)
        found = SeekingReader(stream, record_size_limit=size).get_summary()
        return None if found is None or not _is_complete(found) else _index_of(found, start)
    except BagUnreachableError:
        raise
    except Exception:  # whatever wrong bytes lead to: the file is walked through then
        return None


def checksum(stream: IO[bytes], start: int, end: int) -> int:
    """In pieces, as a file may say that all of it is index."""
    stream.seek(start)
    found = 0
    for at in range(start, end, _PIECE):
        found = zlib.crc32(stream.read(min(_PIECE, end - at)), found)
    return found


def _is_complete(told: Summary) -> bool:
    """Whether it knows every chunk once, and every channel and schema; the package looks at none of this."""
    statistics, chunks, channels = told.statistics, told.chunk_indexes, told.channels
    if len({one.chunk_start_offset for one in chunks}) != len(chunks):
        return False
    if statistics is None:
        if not channels or not all(one.message_index_offsets for one in chunks):
            return False
    elif statistics.chunk_count != len(chunks) or statistics.channel_count > len(channels):
        return False
    if any(one.schema_id and one.schema_id not in told.schemas for one in channels.values()):
        return False
    return all(one.message_index_offsets.keys() <= channels.keys() for one in chunks)


def _index_of(told: Summary, summary_start: int) -> Index:
    chunks = sorted(told.chunk_indexes, key=lambda one: one.chunk_start_offset)
    gaps, at = [], len(MCAP0_MAGIC)
    for one in chunks:
        gaps.append((at, one.chunk_start_offset))
        at = one.chunk_start_offset + one.chunk_length + one.message_index_length
    gaps.append((at, summary_start))
    parts = [
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
    statistics = told.statistics
    if statistics is not None:
        counts = {number: statistics.channel_message_counts.get(number, 0) for number in told.channels}
        span = (statistics.message_start_time, statistics.message_end_time) if statistics.message_count else None
        return Index(parts, dict(told.channels), dict(told.schemas), counts, span, gaps)
    span = (min(one.first for one in parts), max(one.last for one in parts)) if parts else None
    return Index(parts, dict(told.channels), dict(told.schemas), None, span, gaps)
