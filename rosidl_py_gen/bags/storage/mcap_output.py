"""Writer of the records of one MCAP file, with an index and statistics.

Messages are collected in chunks. Attachments and metadata records are written between chunks. The index is collected in
serialized form, so it takes no more memory than its size in the file.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from typing import IO, TYPE_CHECKING

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.storage.mcap_records import MESSAGE, MIN_MESSAGE_BYTES, RECORD, compress

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rosidl_py_gen.bags.storage.mcap_records import AttachmentHead

_MAX_IDS = (1 << 16) - 1
"""Maximum number of schemas, and of channels, in an MCAP file: ids have 16 bits, and 0 means no schema."""
_TWO_IDS = struct.Struct("<HH")
_INDEX_ENTRY = struct.Struct("<HQ")
_CHUNK = struct.Struct("<QQQI")
_CHUNK_INDEX = struct.Struct("<QQQQ")
_ATTACHMENT_INDEX = struct.Struct("<QQQQQ")
_STATISTICS = struct.Struct("<QHIIIIQQ")
_SUMMARY_OFFSET = struct.Struct("<BQQ")
_FOOTER = struct.Struct("<BQQQ")
_OPCODE = int(Opcode.MESSAGE)


class McapOutput:
    """Writer of the records of an MCAP file to `stream`, which the caller opens and closes.

    Args:
        profile: requirements that the file meets, ``ros2`` for bags of ROS 2.
        library: name and version of the writing program.
        compression: compression of chunks: ``zstd``, ``lz4`` or empty.
        chunk_bytes: size of the records after which a chunk is written.
    """

    def __init__(self, stream: IO[bytes], profile: str, library: str, compression: str, chunk_bytes: int) -> None:
        self._stream, self._compression, self._chunk_bytes = stream, compression, chunk_bytes
        self._schemas: list[bytes] = []
        self._channels: list[bytes] = []
        self._counts: dict[int, int] = {}
        self._span: tuple[int, int] | None = None
        self._chunk_count = self._attachment_count = self._metadata_count = 0
        self._index = {
            opcode: bytearray() for opcode in (Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX)
        }
        self._start_chunk()
        stream.write(MCAP0_MAGIC)
        stream.write(_record(Opcode.HEADER, _text(profile), _text(library)))

    def _start_chunk(self) -> None:
        self._chunk = bytearray()
        self._first, self._last = (1 << 64) - 1, -1
        self._offsets: dict[int, array[int]] = {}  # channel -> log time and offset of each message

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema and return its id; raises `BagError` if there are too many."""
        number = _next_id(self._schemas, "schemas")
        self._add_definition(
            self._schemas, _record(Opcode.SCHEMA, struct.pack("<H", number), _text(name), _text(encoding), _bytes(data))
        )
        return number

    def add_channel(self, schema: int, topic: str, message_encoding: str, metadata: Mapping[str, str]) -> int:
        """Add a channel and return its id; raise `BagError` if there are too many. `schema` is an id, or 0 for none."""
        number = _next_id(self._channels, "channels")
        ids = _TWO_IDS.pack(number, schema)
        self._add_definition(
            self._channels,
            _record(Opcode.CHANNEL, ids, _text(topic), _text(message_encoding), _bytes(_map(metadata))),
        )
        self._counts[number] = 0
        return number

    def _add_definition(self, known: list[bytes], record: bytes) -> None:
        known.append(record)
        self._chunk += record

    def add_message(
        self, channel: int, sequence: int, log_time: int, publish_time: int, data: bytes, is_compressed: bool = True
    ) -> None:
        """Add a message to the current chunk; the chunk is written to the file when it has reached its size.

        If this message completes the chunk, `is_compressed=False` stores the chunk without compression.
        """
        chunk = self._chunk
        at = len(chunk)
        chunk += MESSAGE.pack(_OPCODE, MIN_MESSAGE_BYTES + len(data), channel, sequence, log_time, publish_time)
        chunk += data
        try:
            offsets = self._offsets[channel]
        except KeyError:
            offsets = self._offsets[channel] = array("Q")
        offsets.append(log_time)
        offsets.append(at)
        if log_time < self._first:
            self._first = log_time
        if log_time > self._last:
            self._last = log_time
        if len(chunk) > self._chunk_bytes:
            self._end_chunk(self._compression if is_compressed else "")

    def end_chunk(self) -> None:
        """Write the current chunk to the file if it has messages."""
        if self._offsets:
            self._end_chunk(self._compression)

    def _end_chunk(self, compression: str) -> None:
        data, offsets, first, last = self._chunk, self._offsets, self._first, self._last
        self._start_chunk()
        size, crc = len(data), zlib.crc32(data)
        stored = compress(compression, data)
        del data
        start, name = self._stream.tell(), _text(compression)
        head = _CHUNK.pack(first, last, size, crc) + name + struct.pack("<Q", len(stored))
        self._stream.write(RECORD.pack(Opcode.CHUNK, len(head) + len(stored)) + head)
        self._stream.write(stored)
        length = RECORD.size + len(head) + len(stored)
        places, indexes = bytearray(), bytearray()
        for channel, entries in offsets.items():
            count = len(entries) // 2
            self._counts[channel] += count
            places += _INDEX_ENTRY.pack(channel, start + length + len(indexes))
            indexes += _record(
                Opcode.MESSAGE_INDEX, struct.pack("<H", channel), _bytes(struct.pack(f"<{2 * count}Q", *entries))
            )
        self._stream.write(indexes)
        self._chunk_count += 1
        before = self._span or (first, last)
        self._span = min(before[0], first), max(before[1], last)
        self._index[Opcode.CHUNK_INDEX] += _record(
            Opcode.CHUNK_INDEX,
            _CHUNK_INDEX.pack(first, last, start, length),
            _bytes(bytes(places)),
            struct.pack("<Q", len(indexes)),
            name,
            struct.pack("<QQ", len(stored), size),
        )

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record to the file, and add it to the index."""
        self.copy_metadata(name, [_record(Opcode.METADATA, _text(name), _bytes(_map(values)))])

    def copy_metadata(self, name: str, record: Iterable[bytes]) -> None:
        """Write a complete metadata record of another file, given in pieces, and add it to the index."""
        start, length = self._copy(record)
        self._metadata_count += 1
        self._index[Opcode.METADATA_INDEX] += _record(
            Opcode.METADATA_INDEX, struct.pack("<QQ", start, length), _text(name)
        )

    def copy_attachment(self, head: AttachmentHead, record: Iterable[bytes]) -> None:
        """Write a complete attachment record of another file, given in pieces, and add it to the index."""
        start, length = self._copy(record)
        self._attachment_count += 1
        times_and_size = _ATTACHMENT_INDEX.pack(start, length, head.log_time, head.create_time, head.size)
        self._index[Opcode.ATTACHMENT_INDEX] += _record(
            Opcode.ATTACHMENT_INDEX, times_and_size, _text(head.name), _text(head.media_type)
        )

    def _copy(self, record: Iterable[bytes]) -> tuple[int, int]:
        self.end_chunk()
        start = self._stream.tell()
        for piece in record:
            self._stream.write(piece)
        return start, self._stream.tell() - start

    def flush(self) -> None:
        """Write the current chunk, and pass all written bytes to the operating system."""
        self.end_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write the remaining records, the index and the statistics, which complete the file."""
        self.end_chunk()
        self._stream.write(self._chunk)  # definitions that no message uses
        self._stream.write(_record(Opcode.DATA_END, bytes(4)))
        start = self._stream.tell()
        summary, offsets = bytearray(), bytearray()
        groups: dict[Opcode, bytes | bytearray] = {
            Opcode.SCHEMA: b"".join(self._schemas),
            Opcode.CHANNEL: b"".join(self._channels),
            Opcode.STATISTICS: self._statistics(),
            **self._index,
        }
        for opcode, records in groups.items():
            if records:
                place = _SUMMARY_OFFSET.pack(opcode, start + len(summary), len(records))
                offsets += _record(Opcode.SUMMARY_OFFSET, place)
                summary += records
        offset_start = start + len(summary)
        summary += offsets
        footer = _FOOTER.pack(Opcode.FOOTER, 20, start, offset_start)
        self._stream.write(summary)
        self._stream.write(footer + struct.pack("<I", zlib.crc32(footer, zlib.crc32(summary))) + MCAP0_MAGIC)

    def _statistics(self) -> bytes:
        first, last = self._span or (0, 0)
        counts = {channel: count for channel, count in self._counts.items() if count}
        numbers = _STATISTICS.pack(
            sum(counts.values()),
            len(self._schemas),
            len(self._channels),
            self._attachment_count,
            self._metadata_count,
            self._chunk_count,
            first,
            last,
        )
        return _record(Opcode.STATISTICS, numbers, _bytes(b"".join(_INDEX_ENTRY.pack(*one) for one in counts.items())))


def _next_id(known: list[bytes], what: str) -> int:
    if len(known) >= _MAX_IDS:
        raise BagError(f"{what}: an MCAP file can have at most {_MAX_IDS}; select topics, or split the bag")
    return len(known) + 1


def _record(opcode: Opcode, *fields: bytes) -> bytes:
    body = b"".join(fields)
    return RECORD.pack(opcode, len(body)) + body


def _bytes(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def _text(text: str) -> bytes:
    return _bytes(text.encode())


def _map(values: Mapping[str, str]) -> bytes:
    return b"".join(_text(key) + _text(value) for key, value in values.items())
