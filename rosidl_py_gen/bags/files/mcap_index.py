"""What an MCAP file holds and where: from its index, or by walking through it when that is missing or says too little.

Decides when an index is believed: its checksum is right, and it knows all chunks, channels and schemas that it speaks
of. MCAP lets writers leave out any of these, and killed recorders leave out all. A walk takes one chunk into memory at
a time, and ends where the file breaks off.
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
from rosidl_py_gen.bags.files.chunks import IS_MESSAGE, MESSAGE, RECORD, Unpacker, head_of, is_large, pieces
from rosidl_py_gen.bags.files.storage import MAX_TIME
from rosidl_py_gen.bags.remote import UnreachableError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from mcap.summary import Summary

_FOOTER = Struct("<BQQQI8s")
"""The end of a file: kind, length, where the index begins, a part of it, checksum of the index and of what is left of
the checksum here, and the magic bytes.
"""
_FOOTER_CRC = 12
"""Where the checksum is, from the end."""
_PIECE = 1 << 20
"""Bytes of messages outside of chunks that are read together."""
_CRC = Struct("<I")
_SUMMARY = "SCHEMA CHANNEL CHUNK_INDEX ATTACHMENT_INDEX STATISTICS METADATA_INDEX SUMMARY_OFFSET FOOTER"
_HOLD_MESSAGES = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK)
_AFTER_DATA = [b"", *(bytes([Opcode[name]]) for name in _SUMMARY.split())]
"""How what follows the data begins: nothing, where the file breaks off just there."""


class Part(NamedTuple):
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

    parts: list[Part] = field(default_factory=list)
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    counts: dict[int, int] | None = field(default_factory=dict)
    span: tuple[int, int] | None = None
    gaps: list[tuple[int, int]] = field(default_factory=list)
    unread_bytes: int = 0

    def take(self, opcode: int, body: bytes | bytearray) -> None:
        """Keep what a record says of schemas and channels."""
        stream = ReadDataStream(_stream(body))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            _require_same(self.schemas.setdefault(schema.id, schema), schema)
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            _require_same(self.channels.setdefault(channel.id, channel), channel)


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
        if not start or (expected and expected != _checksum(stream, start, size - _FOOTER_CRC)):
            return None
        stream.seek(0)
        found = SeekingReader(stream, record_size_limit=size).get_summary()
        return None if found is None or not _is_complete(found) else _index_of(found, start)
    except UnreachableError:
        raise
    except Exception:  # whatever wrong bytes lead to: the file is walked through then
        return None


def _checksum(stream: IO[bytes], start: int, end: int) -> int:
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
        Part(
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


# ------------------------------------------------------------------------------------------------------------- a walk


def walk(stream: IO[bytes], size: int, unpacker: Unpacker, index: Index, start: int, end: int) -> bool:
    """Add what lies between `start` and `end` of a file of `size` bytes to `index`.

    Returns:
        False when the file breaks off there.
    """
    at = start
    loose = _Loose(index)
    while at < end:
        stream.seek(at)
        head = stream.read(MESSAGE.size)
        if len(head) < RECORD.size:
            index.unread_bytes = _unread(head, at, size)
            break
        opcode, length = RECORD.unpack_from(head)
        body, after = at + RECORD.size, at + RECORD.size + length
        if after > size or not opcode:  # zeros are what a crash of the machine leaves
            _require_no_end(stream, at)
            index.unread_bytes = _unread(head, at, size)
            break
        if opcode == IS_MESSAGE:
            if len(head) < MESSAGE.size or length < MESSAGE.size - RECORD.size:
                raise BagError(f"damaged: a message of {length} bytes at offset {at}")
            loose.add(at, after, *MESSAGE.unpack(head)[2:5:2])
        elif opcode == Opcode.DATA_END:
            is_all = end == size or not index.parts  # with an index of chunks, only what is beside them was read
            _require_end(stream, after, end, size)
            _require_checksum(stream, unpacker, at, length, is_all or loose.count > 0)
            at = end
            break
        else:
            loose.end()
            if opcode == Opcode.CHUNK:
                _add_chunk(_pieces(stream, unpacker, body, after), body, after, index)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                stream.seek(body)
                index.take(opcode, stream.read(length))
        at = after
    loose.end()
    if at > max(start, end):
        raise BagError(f"damaged: a record goes beyond byte {end}, where the next one begins")
    return at >= end


def _unread(head: bytes, at: int, size: int) -> int:
    """How much of a file is in a record at its end that was not finished; of records with messages, not of indexes."""
    return size - at if head[:1] and head[0] in _HOLD_MESSAGES else 0


def _require_no_end(stream: IO[bytes], at: int) -> None:
    """Raises `BagError` when a file was ended, so that what follows is damaged, not missing."""
    stream.seek(-len(MCAP0_MAGIC), SEEK_END)
    if stream.read() == MCAP0_MAGIC:
        raise BagError(f"damaged: no record at byte {at}, though the file has an end")


def _require_end(stream: IO[bytes], at: int, end: int, size: int) -> None:
    """Raises `BagError` when what follows the last record of data is neither the summary nor the footer."""
    if end < size:
        is_right = at == end
    else:
        stream.seek(at)
        is_right = stream.read(1) in _AFTER_DATA
    if not is_right:
        raise BagError(f"damaged: the data ends at byte {at}, where neither the summary nor the footer begins")


def _require_checksum(stream: IO[bytes], unpacker: Unpacker, at: int, length: int, is_needed: bool) -> None:
    """Check the sum over all data: records, their kinds and messages outside of chunks have no other."""
    if not (is_needed and unpacker.validate_crcs and length == _CRC.size):
        return
    stream.seek(at + RECORD.size)
    (expected,) = _CRC.unpack(stream.read(_CRC.size))
    if expected and expected != _checksum(stream, 0, at):
        raise BagError("damaged: the checksum of its messages is another")


def _records(data: bytes | bytearray) -> Iterator[tuple[int, int, int]]:
    """Kind, beginning and end of each record."""
    at, size = 0, len(data)
    while at < size:
        opcode, length = RECORD.unpack_from(data, at)
        end = at + RECORD.size + length
        if end > size:
            raise BagError("damaged: a record in a chunk is longer than the chunk")
        yield opcode, at, end
        at = end


def _pieces(stream: IO[bytes], unpacker: Unpacker, body: int, end: int) -> Iterator[bytes | bytearray]:
    """The records of a chunk, at once or a megabyte at a time."""

    def read(at: int, size: int) -> bytes:
        stream.seek(at)
        return stream.read(size)

    head = head_of(read, body, end, unpacker.where)
    unpacker.require_size(head)
    if is_large(read, head):
        for data, whole in pieces(read, head, unpacker.validate_crcs):
            yield data if whole == len(data) else data[:whole]
    else:
        yield unpacker.unpacked(read(body, end - body))


def _add_chunk(some: Iterator[bytes | bytearray], offset: int, end: int, index: Index) -> None:
    first, last, channels = MAX_TIME, -1, set()
    counts = index.counts
    for data in some:
        for opcode, at, after in _records(data):
            if opcode == IS_MESSAGE:
                _, _, channel, _, log_time, _ = MESSAGE.unpack_from(data, at)
                channels.add(channel)
                first, last = min(first, log_time), max(last, log_time)
                if counts is not None:
                    counts[channel] = counts.get(channel, 0) + 1
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                index.take(opcode, data[at + RECORD.size : after])
    if channels:
        _add(index, Part(offset, end, True, first, last, channels))


def _add(index: Index, part: Part) -> None:
    index.parts.append(part)
    first, last = index.span or (part.first, part.last)
    index.span = min(first, part.first), max(last, part.last)


class _Loose:
    """Messages outside of chunks, gathered to parts of a megabyte."""

    def __init__(self, index: Index) -> None:
        self._index = index
        self._part: Part | None = None
        self._channels: set[int] = set()
        self.count = 0

    def add(self, at: int, after: int, channel: int, log_time: int) -> None:
        """One more."""
        part = self._part
        if part is not None and after - part.offset > _PIECE:
            self.end()
            part = None
        if part is None:
            part, self._channels = Part(at, after, False, log_time, log_time), set()
        self._channels.add(channel)
        self._part = part._replace(end=after, first=min(part.first, log_time), last=max(part.last, log_time))
        self.count += 1
        counts = self._index.counts
        if counts is not None:
            counts[channel] = counts.get(channel, 0) + 1

    def end(self) -> None:
        """Another record follows, or none."""
        if self._part is not None:
            _add(self._index, self._part._replace(channels=self._channels))
            self._part = None
