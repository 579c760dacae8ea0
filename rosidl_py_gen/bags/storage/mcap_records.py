"""Records of an MCAP file: chunks with the messages in them, header, attachments and metadata records.

Chunks are decompressed within bounds. The stated size of a chunk must be the size that its compression states, and at
most the limit of the reader. A large chunk is decompressed in blocks of whole records, about a megabyte each, or one
record that is larger.

Records that are not messages are copied byte by byte, piece by piece, so that an attachment may be larger than memory.
Before that they are checked: a record with a wrong checksum, or with lengths that contradict each other, is damaged.
"""

from __future__ import annotations

import contextlib
import struct
import threading
import zlib
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mcap.opcode import Opcode

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.storage.zstd import ZstdDecompressor, frame_content_size
from rosidl_py_gen.bags.storage.zstd import compress as zstd_compress
from rosidl_py_gen.base.extras import Extra

if TYPE_CHECKING:
    from collections.abc import Container, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from rosidl_py_gen.bags.storage.storage_api import BagChannel, RawTuple

    Array = NDArray[Any]

RECORD = struct.Struct("<BQ")
"""Struct layout of the start of every MCAP record: opcode and length."""
_HEAD = struct.Struct("<QQQII")
"""Struct layout of the start of an MCAP chunk: first and last log time, size, checksum, length of the compression's
name."""
BLOCK_BYTES = 1 << 20
MAX_WHOLE_CHUNK_BYTES = 1 << 23
"""Maximum size of a chunk that is decompressed at once, which is faster than in blocks."""
MAX_WINDOW = 1 << 27
"""Maximum zstd window in bytes that is accepted, as by the command ``zstd`` without ``--long``."""
Read = Callable[[int, int], bytes]
MESSAGE = struct.Struct("<BQHIQQ")
"""Struct layout of an MCAP message record before its data: opcode, length, channel, sequence, log time, publish time.
"""
MIN_MESSAGE_BYTES = MESSAGE.size - RECORD.size
IN_CHUNKS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
"""Opcodes of the records that MCAP allows in chunks. A record with another opcode in a chunk counts as unknown."""
IS_MESSAGE = int(Opcode.MESSAGE)  # comparing with the enum costs as much as the rest of the loop
_HEADS = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("number", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_MIN_EQUAL_RUN = 4
"""Number of consecutive messages of equal length after which the parser expects more of this length."""
_LARGE = 8
"""Divisor for large messages: the data of a message larger than the chunk's size divided by it share the chunk's
memory, and are not copied."""
_MAX_FRAME_HEAD = 18
"""Maximum size of the header of a zstd frame."""
_MAX_COMPRESSION_NAME = 4
COMPRESSIONS = "", "lz4", "zstd"
_HOLE = bytes(512)
"""Run of zeros as long as a disk sector, which shows that a block was never written: compressed data have no such run.
"""
_MAX_LZ4 = 255
"""Maximum factor by which LZ4 can compress data; a chunk cannot validly state a larger size."""


def compress(compression: str, data: bytes | bytearray) -> bytes | bytearray:
    """Return the records of a chunk compressed with ``zstd`` or ``lz4``; unchanged if `compression` is empty."""
    if compression == "zstd":
        return zstd_compress(data)
    if compression == "lz4":
        compressed: bytes = _lz4_frames().compress(data)
        return compressed
    return data


def _lz4_frames() -> Any:
    """Import and return the module of LZ4.

    Raises `ExtraMissingError` if the module is missing, as on Python versions without a wheel of it.
    """
    try:
        import lz4.frame  # type: ignore[import-untyped]
    except ImportError as missing:
        raise Extra.missing_error(missing) or missing from None
    return lz4.frame


class TooLargeError(BagError):
    """Error of an MCAP chunk that is larger than the reader's limit; the chunk may be intact."""


class Tally:
    """Counter of MCAP records of unknown kinds, shared by the blocks of a chunk that is read in several blocks."""

    __slots__ = ("count",)

    def __init__(self) -> None:
        self.count = 0


class ChunkHeader(NamedTuple):
    """Header of an MCAP chunk, whose stored records extend from offset `at` to offset `end` of the file.

    Attributes:
        size: decompressed size of the records.
    """

    at: int
    end: int
    compression: str
    size: int
    crc: int


class Zstd(threading.local):
    """Zstd decompressor with an object for each thread, because threads that share one object would mix up
    their data.
    """

    def __init__(self) -> None:
        self.own = ZstdDecompressor()


class ChunkDecompressor:
    """Decompressor and parser for the chunks of a file. Methods raise `BagError`, and exceptions of the libraries.

    Args:
        read: returns bytes of the file, by offset and size; fewer at the end of the file.
        max_bytes: maximum size of a decompressed chunk.
        validate_crcs: compare checksums.
    """

    def __init__(self, path: Path, read: Read, max_bytes: int, validate_crcs: bool) -> None:
        self.path, self.where = path, str(path)
        self.read = read
        self._max_bytes = max_bytes
        self.validate_crcs = validate_crcs
        self._zstd = Zstd()

    def header(self, body: int, end: int) -> ChunkHeader:
        """Return the header of a chunk whose record body extends from offset `body` to `end`; raises `BagError`."""
        _, _, size, crc, name = _HEAD.unpack(self.read(body, _HEAD.size))
        at = body + _HEAD.size + name
        (length,) = struct.unpack("<Q", self.read(at, 8))
        if at + 8 + length != end:
            raise BagError(f"{self.where}: damaged: expected {length} bytes of records, found {end - at - 8}")
        return ChunkHeader(at + 8, end, self.read(body + _HEAD.size, name).decode(), size, crc)

    def decompress(self, head: ChunkHeader) -> bytes:
        """Return the decompressed records of a chunk; raises `BagError` for a wrong checksum or size."""
        data = self._decompressed(head, self.read(head.at, head.end - head.at))
        if self.validate_crcs and head.crc and zlib.crc32(data) != head.crc:
            raise BagError(f"{self.where}: damaged: the checksum of a chunk of {len(data)} bytes is wrong")
        return data

    def is_large(self, head: ChunkHeader) -> bool:
        """Return True if a chunk should be read in blocks: it is large, and no message at its start takes half of it.

        Raises `BagError` if the chunk's header is inconsistent, or the chunk is larger than the limit.
        """
        if head.compression:
            start = self.read(head.at, _MAX_FRAME_HEAD)
            self._require_size(head.size, head.end - head.at, head.compression, start)
        if head.size <= MAX_WHOLE_CHUNK_BYTES:
            return False
        data, at = self._block_reader(head)(BLOCK_BYTES), 0
        while at + RECORD.size <= len(data):
            opcode, length = RECORD.unpack_from(data, at)
            if opcode == Opcode.MESSAGE and 2 * length >= head.size:
                return False
            at += RECORD.size + length
        return True

    def blocks(self, head: ChunkHeader, validate_crcs: bool) -> Iterator[tuple[bytes | bytearray, int]]:
        """Yield the decompressed records of a chunk in blocks, each with the size of the whole records in the block.

        Raises `BagError` for damage; a wrong checksum is found only at the end.
        """
        unpack = self._block_reader(head)
        left, crc, need = head.size, 0, 0
        data: bytes | bytearray = b""
        while left or data:
            piece = unpack(min(left, BLOCK_BYTES))
            if not piece:
                raise BagError(f"{self.where}: damaged: a chunk ends within a record")
            left -= len(piece)
            crc = zlib.crc32(piece, crc)
            data += piece  # in place while it is a bytearray
            need -= len(piece)
            if need > 0:
                continue
            at, need = _end_of_whole_records(data)
            if need > left:
                raise BagError(f"{self.where}: damaged: a record in a chunk is longer than the chunk")
            if at:
                yield data, at
            data = data[at:] if need <= BLOCK_BYTES else bytearray(data[at:])
        if unpack(1):
            raise BagError(f"{self.where}: damaged: a chunk has more than the {head.size} bytes that it states")
        if validate_crcs and head.crc and crc != head.crc:
            raise BagError(f"{self.where}: damaged: the checksum of a chunk is wrong")

    def unfinished(self, body: int, end: int) -> tuple[bytes, int]:
        """Return the whole records of a chunk in which the file breaks off at `end`, and the number of bytes that are
        missing.

        The checksum of such a chunk cannot be verified. Returns b"" if the data have zeros in place of blocks that were
        never written.
        """
        _, _, size, crc, name = _HEAD.unpack(self.read(body, _HEAD.size))
        at = body + _HEAD.size + name + 8
        stored = end - at
        if name > _MAX_COMPRESSION_NAME or stored <= 0 or size > self._max_bytes:
            return b"", 0
        head = ChunkHeader(at, end, self.read(body + _HEAD.size, name).decode(), size, crc)
        if head.compression and _has_hole(self.read, at, end):
            return b"", 0
        unpack, data = self._block_reader(head), bytearray()
        with contextlib.suppress(Exception):  # decompression libraries raise various ones where the data end
            while len(data) < size and (piece := unpack(min(BLOCK_BYTES, size - len(data)))):
                data += piece
        whole, _ = _end_of_whole_records(data)
        return bytes(data[:whole]), size - whole

    def _block_reader(self, head: ChunkHeader) -> Callable[[int], bytes]:
        """Return a function that returns at most `n` decompressed bytes of a chunk at each call, and b"" at the end."""
        source = _Stored(self.read, head)
        if not head.compression:
            return source.read
        if head.compression == "zstd":
            zstd = ZstdDecompressor(max_window_size=MAX_WINDOW)
            reader = zstd.stream_reader(source, read_size=BLOCK_BYTES, read_across_frames=True)  # type: ignore[arg-type]
            return reader.read
        if head.compression == "lz4":
            return _Lz4(source).read
        raise self._unknown_compression(head)

    def _unknown_compression(self, head: ChunkHeader) -> BagError:
        return BagError(f'{self.where}: a chunk is compressed with "{head.compression[:50]}"; expected zstd or lz4')

    def _decompressed(self, head: ChunkHeader, stored: bytes) -> bytes:
        if not head.compression:
            return stored
        size, compressed_size = head.size, len(stored)
        if head.compression == "zstd":
            self._require_size(size, compressed_size, "zstd", stored[:_MAX_FRAME_HEAD])
            return self._zstd.own.decompress(stored, max_output_size=size)
        if head.compression == "lz4":
            self._require_size(size, compressed_size, "lz4")
            # One byte more than the limit, as 0 would mean no limit.
            data: bytes = _lz4_frames().LZ4FrameDecompressor().decompress(stored, max_length=size + 1)
            if len(data) != size:
                length = f"{len(data)}" if len(data) < size else "more"
                raise BagError(f"{self.where}: damaged: a chunk states {size} bytes, but decompresses to {length}")
            return data
        raise self._unknown_compression(head)

    def _require_size(self, size: int, stored_size: int, compression: str, start: bytes = b"") -> None:
        if compression == "lz4" and size > _MAX_LZ4 * stored_size:
            raise BagError(f"{self.where}: damaged: a chunk of {stored_size} bytes states {size} bytes")
        if compression == "zstd" and (stated := frame_content_size(start)) not in (-1, size):
            raise BagError(
                f"{self.where}: damaged: a chunk states {size} bytes, but its compressed data states {stated}"
            )
        if size > self._max_bytes:
            raise TooLargeError(
                f"{self.where}: a chunk of {stored_size} bytes states {size} bytes; expected at most "
                f"{self._max_bytes}, unless max_decompressed_bytes is more"
            )

    def messages(
        self,
        data: bytes | bytearray,
        requested: Mapping[int, BagChannel],
        known: Container[int],
        size: int = -1,
        unknown: Tally | None = None,
    ) -> list[RawTuple]:
        """Return the messages of the requested channels in a chunk's records.

        Args:
            data: decompressed records.
            requested: the channels by id.
            known: ids of all channels.
            size: size of the whole records in `data`; -1 for all data.
            unknown: counts records of unknown kinds.
        """
        view = memoryview(data)
        size, messages, at = (len(data) if size < 0 else size), [], 0
        while at < size:
            opcode, length = RECORD.unpack_from(data, at)
            end = at + RECORD.size + length
            if end > size:
                raise BagError(f"{self.where}: damaged: a record in a chunk is longer than the chunk")
            if opcode == IS_MESSAGE:
                if length < MIN_MESSAGE_BYTES:
                    raise BagError(f"{self.where}: damaged: a message of {length} bytes, shorter than its times")
                _, _, channel, sequence, log_time, publish_time = MESSAGE.unpack_from(data, at)
                if channel in requested:
                    whole: Any = view if length * _LARGE > size else data
                    messages.append(
                        (requested[channel], whole[at + MESSAGE.size : end], log_time, publish_time, sequence)
                    )
                elif channel not in known:
                    raise BagError(
                        f"{self.where}: damaged: a message refers to channel {channel}, which is not defined"
                    )
            elif unknown is not None and opcode not in IN_CHUNKS:
                unknown.count += 1
            at = end
        return messages

    def message_headers(
        self, data: bytes | bytearray, known: Container[int], size: int = -1
    ) -> tuple[Array, NDArray[np.int64]]:
        """Return the headers of all messages in a chunk's records as a structured array, and the offsets of
        their data.
        """
        size = len(data) if size < 0 else size
        at = self._message_offsets(data, size)
        every: Array = np.ndarray((max(0, size - MESSAGE.size + 1),), f"V{MESSAGE.size}", data, 0, (1,))
        heads = every[at].view(_HEADS)
        for channel in np.unique(heads["channel"]).tolist():
            if channel not in known:
                raise BagError(f"{self.where}: damaged: a message refers to channel {channel}, which is not defined")
        return heads, at + MESSAGE.size

    def _message_offsets(self, data: bytes | bytearray, size: int) -> NDArray[np.int64]:
        """Return the offsets of the message records in a chunk's records.

        When several consecutive messages have the same length, numpy compares the headers at that distance in the rest
        of the data at once. The run ends at the first header that differs. After a wrong guess, more equal messages are
        required before the next attempt.
        """
        runs: list[NDArray[np.int64]] = []
        single: list[int] = []
        octets: Array = np.ndarray(size, np.uint8, data)
        at, previous_length, equal_count, required_count = 0, -1, 0, _MIN_EQUAL_RUN
        while at < size:
            opcode, length = RECORD.unpack_from(data, at)
            step = RECORD.size + length
            if at + step > size:
                raise BagError(f"{self.where}: damaged: a record in a chunk is longer than the chunk")
            if opcode == IS_MESSAGE:
                if length < MIN_MESSAGE_BYTES:
                    raise BagError(f"{self.where}: damaged: a message of {length} bytes, shorter than its times")
                equal_count = equal_count + 1 if length == previous_length else 0
                previous_length = length
                if equal_count == required_count:
                    rows = np.ndarray((size - at) // step * step, np.uint8, octets, at).reshape(-1, step)
                    wrong = np.flatnonzero((rows[:, : RECORD.size] != rows[0, : RECORD.size]).any(axis=1))
                    count = int(wrong[0]) if len(wrong) else len(rows)
                    runs += [np.array(single, np.int64), at + step * np.arange(count)]
                    single = []
                    at += count * step
                    equal_count, required_count = (
                        0,
                        (required_count if count > 4 * _MIN_EQUAL_RUN else 2 * required_count),
                    )
                    continue
                single.append(at)
            at += step
        return np.concatenate([*runs, np.array(single, np.int64)])


def _end_of_whole_records(data: bytes | bytearray) -> tuple[int, int]:
    """Return the offset after the last complete record in the data, and the number of bytes that the next
    record lacks.
    """
    at, size = 0, len(data)
    while at + RECORD.size <= size:
        end: int = at + RECORD.size + RECORD.unpack_from(data, at)[1]
        if end > size:
            return at, end - size
        at = end
    return at, RECORD.size - (size - at) if at < size else 0


def _has_hole(read: Read, at: int, end: int) -> bool:
    """Return True if a range of a file has a sector of zeros, or ends with zeros, as after a power cut."""
    for start in range(at, end, BLOCK_BYTES):
        if _HOLE in read(start, min(BLOCK_BYTES + len(_HOLE), end - start)):
            return True
    return not any(read(max(at, end - 8), min(8, end - at)))


class _Stored:
    def __init__(self, read: Read, head: ChunkHeader) -> None:
        self._read, self._at, self._end = read, head.at, head.end

    def read(self, size: int = -1, /) -> bytes:
        left = self._end - self._at
        data = self._read(self._at, left if size < 0 else min(size, left))
        self._at += len(data)
        return data


class _Lz4:
    def __init__(self, source: _Stored) -> None:
        self._source = source
        self._frame: Any = _lz4_frames().LZ4FrameDecompressor()

    def read(self, size: int) -> bytes:
        data = b""
        while size and not data and not self._frame.eof:
            more = self._source.read(BLOCK_BYTES) if self._frame.needs_input else b""
            if self._frame.needs_input and not more:
                break
            data = self._frame.decompress(more, max_length=size)
        return data


# -------------------------------------------------------------------------------------------- records outside of chunks


_LENGTH = struct.Struct("<I")
_TIMES = struct.Struct("<QQ")
_SIZE = struct.Struct("<Q")
_MAX_NAME_BYTES = 1 << 20
"""Maximum bytes of a name in a record: the index of a copied file has all names in memory."""
_MAX_CHECKED_BYTES = 1 << 24
"""Maximum size of a metadata record in which each text is checked; a larger record is checked only as a whole."""
_MAX_VALUES_BYTES = 1 << 20
"""Maximum size of a rosbag2 metadata record whose values are read: 1000 topics take less than half of it."""


@dataclass(slots=True)
class OtherRecords:
    """Offsets and counts of the records of a file that are neither messages, schemas nor channels.

    Attributes:
        header: offset of the header; None if there is none.
        attachments, metadata: offsets of these records. They are arrays, as a file may consist of small ones.
        unknown: number of application-specific records outside of chunks.
        unknown_in_chunks: number of application-specific records in each chunk, by the chunk's offset.
    """

    header: int | None = None
    attachments: array[int] = field(default_factory=lambda: array("Q"))
    metadata: array[int] = field(default_factory=lambda: array("Q"))
    unknown: int = 0
    unknown_in_chunks: dict[int, int] = field(default_factory=dict)

    def add(self, opcode: int, at: int) -> None:
        """Register a record outside of chunks, at the offset `at`."""
        if opcode == Opcode.ATTACHMENT:
            self.attachments.append(at)
        elif opcode == Opcode.METADATA:
            self.metadata.append(at)
        elif opcode == Opcode.HEADER and self.header is None:
            self.header = at
        elif opcode > max(Opcode):
            self.unknown += 1


class AttachmentHead(NamedTuple):
    """Description of an MCAP attachment; `size` is the number of bytes of its data."""

    name: str
    media_type: str
    log_time: int
    create_time: int
    size: int


class StoredAttachment(NamedTuple):
    """Attachment of an MCAP file; `pieces` yields the bytes of its complete record."""

    head: AttachmentHead
    pieces: Callable[[], Iterator[bytes]]


class StoredMetadata(NamedTuple):
    """Metadata record of an MCAP file; `pieces` yields the bytes of its complete record, `values` returns its contents.

    `values` raises `BagError` for a record of more than a megabyte.
    """

    name: str
    pieces: Callable[[], Iterator[bytes]]
    values: Callable[[], dict[str, str]]


class _Fields:
    """Reader that returns the fields of an MCAP record, one after the other, up to the end of the record."""

    def __init__(self, read: Read, at: int) -> None:
        head = read(at, RECORD.size)
        if len(head) < RECORD.size:
            raise BagError("a record breaks off")
        self.at = at + RECORD.size
        self.end = self.at + RECORD.unpack(head)[1]
        self._read = read

    def _take(self, size: int) -> bytes:
        if size > self.end - self.at or len(data := self._read(self.at, size)) < size:
            raise BagError("a length in it exceeds it")
        self.at += size
        return data

    def unpack(self, layout: struct.Struct) -> tuple[int, ...]:
        return layout.unpack(self._take(layout.size))

    def text(self) -> str:
        (length,) = self.unpack(_LENGTH)
        if length > _MAX_NAME_BYTES:
            raise BagError(f"a name of {length} bytes; expected at most {_MAX_NAME_BYTES}")
        try:
            return self._take(length).decode()
        except UnicodeDecodeError:
            raise BagError("a text that is not UTF-8") from None

    def skip(self, size: int) -> None:
        if size > self.end - self.at:
            raise BagError("a length in it exceeds it")
        self.at += size

    def pairs(self) -> Iterator[tuple[str, str]]:
        """Yield the keys and values of a map field of an MCAP record; the whole map is read into memory."""
        (length,) = self.unpack(_LENGTH)
        data, at = self._take(length), 0
        while at < length:
            texts = []
            for _ in range(2):
                if at + _LENGTH.size > length:
                    raise BagError("a length in it exceeds it")
                (size,) = _LENGTH.unpack_from(data, at)
                at += _LENGTH.size
                if size > length - at:
                    raise BagError("a length in it exceeds it")
                try:
                    texts.append(data[at : at + size].decode())
                except UnicodeDecodeError:
                    raise BagError("a text that is not UTF-8") from None
                at += size
            yield texts[0], texts[1]


def read_profile(read: Read, at: int) -> str:
    """Return the profile in the MCAP header record at an offset; "" if the record is damaged."""
    try:
        return _Fields(read, at).text()
    except BagError:
        return ""


def read_attachment(read: Read, at: int, validate_crcs: bool) -> StoredAttachment:
    """Return the attachment whose record starts at an offset; raises `BagError` if the record is damaged."""
    fields = _Fields(read, at)
    body = fields.at
    log_time, create_time = fields.unpack(_TIMES)
    name, media_type = fields.text(), fields.text()
    (size,) = fields.unpack(_SIZE)
    fields.skip(size)
    data_end = fields.at
    (expected,) = fields.unpack(_LENGTH)
    if validate_crcs and expected:
        crc = 0
        for piece in _pieces(read, body, data_end):
            crc = zlib.crc32(piece, crc)
        if crc != expected:
            raise BagError(f"the checksum of the attachment {name!r} is wrong")
    head = AttachmentHead(name, media_type, log_time, create_time, size)
    return StoredAttachment(head, lambda: _pieces(read, at, fields.end))


def read_metadata(read: Read, at: int) -> StoredMetadata:
    """Return the metadata record that starts at an offset; raises `BagError` if the record is damaged."""
    fields = _Fields(read, at)
    name, size = fields.text(), fields.end - fields.at
    start = fields.at
    if size <= _MAX_CHECKED_BYTES:
        for _ in fields.pairs():
            pass
    else:
        fields.skip(*fields.unpack(_LENGTH))

    def values() -> dict[str, str]:
        if size > _MAX_VALUES_BYTES:
            raise BagError(f"a metadata record of {size} bytes; expected at most {_MAX_VALUES_BYTES}")
        fields.at = start
        return dict(fields.pairs())

    return StoredMetadata(name, lambda: _pieces(read, at, fields.end), values)


def _pieces(read: Read, at: int, end: int) -> Iterator[bytes]:
    while at < end:
        piece = read(at, min(BLOCK_BYTES, end - at))
        if not piece:
            raise BagError("a record breaks off")
        at += len(piece)
        yield piece
