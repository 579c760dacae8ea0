"""Chunks of MCAP: unpacked within bounds, and cut into their records.

Decides how much a chunk may become: what it says of itself, which has to be what its compression says, and at most what
the reader allows. A large one is unpacked in pieces: whole records, about a megabyte of them, or one that is larger.
"""

from __future__ import annotations

import struct
import threading
import zlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
from mcap.opcode import Opcode
from zstandard import ZstdDecompressor, frame_content_size

from rosidl_py_gen.bags.common import BagError

if TYPE_CHECKING:
    from collections.abc import Container, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from rosidl_py_gen.bags.storage.storage_api import BagChannel, Raw

    Array = NDArray[Any]

RECORD = struct.Struct("<BQ")
"""Kind and length of a record of MCAP."""
_HEAD = struct.Struct("<QQQII")
"""What a chunk begins with: log times, size, checksum, and the length of its compression's name."""
_MAX_NAME = 100
BLOCK_BYTES = 1 << 20
MAX_WHOLE_CHUNK_BYTES = 1 << 23
"""Chunks up to this size are unpacked at once, which is quicker."""
MAX_WINDOW = 1 << 27
"""What zstd may look back: as `zstd` itself has it without ``--long``."""
Read = Callable[[int, int], bytes]
"""Bytes of the file, from where and how many; less at its end."""
MESSAGE = struct.Struct("<BQHIQQ")
"""The same of a message, then channel, sequence, log time and publish time; the rest of the record is its data."""
MIN_MESSAGE_BYTES = MESSAGE.size - RECORD.size
IS_MESSAGE = int(Opcode.MESSAGE)  # comparing with the enum costs as much as the rest of the loop
_HEADS = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("number", "<u4"), ("log", "<u8"), ("publish", "<u8")]
)
_MIN_EQUAL_RUN = 4
"""After so many messages of equal length, more are expected."""
_LARGE = 8
"""A message is large when its chunk has at most so many times its size."""
_MAX_FRAME_HEAD = 18
"""Bytes of the head of a frame of zstd."""
_MAX_LZ4 = 255
"""LZ4 makes at most so many bytes of one."""


class TooLargeError(BagError):
    """A chunk becomes larger than the user allows, which says nothing of damage."""


class ChunkHeader(NamedTuple):
    """What a chunk says of itself; its records are stored from `at` to `end` of the file."""

    at: int
    end: int
    compression: str
    size: int
    crc: int
    where: str


class Zstd(threading.local):
    """A decompressor for each thread: one that several use at once mixes up what they unpack."""

    def __init__(self) -> None:
        self.own = ZstdDecompressor()


class ChunkDecompressor:
    """Unpacks the chunks of one file.

    Args:
        max_bytes: the most that a compressed chunk may become.
        validate_crcs: compare checksums.
    """

    def __init__(self, path: Path, max_bytes: int, validate_crcs: bool) -> None:
        self.path = path
        self.where = str(path)
        """The file, for errors."""
        self._max_bytes = max_bytes
        self.validate_crcs = validate_crcs
        self._zstd = Zstd()

    def decompress(self, read: Read, head: ChunkHeader) -> bytes:
        """Return the records in a chunk. Raises `BagError`, and what libraries raise."""
        data = self._decompressed(head, read(head.at, head.end - head.at))
        if self.validate_crcs and head.crc and zlib.crc32(data) != head.crc:
            raise BagError(f"{self.where}: damaged: the checksum of a chunk is not that of its {len(data)} bytes")
        return data

    def require_size(self, read: Read, head: ChunkHeader) -> None:
        """Raise `BagError` before a chunk is read that is damaged, or becomes too large."""
        if head.compression:
            self._require_size(head.size, head.end - head.at, head.compression, read(head.at, _MAX_FRAME_HEAD))

    def _decompressed(self, head: ChunkHeader, stored: bytes) -> bytes:
        if not head.compression:
            return stored
        size, compressed_size = head.size, len(stored)
        if head.compression == "zstd":
            self._require_size(size, compressed_size, "zstd", stored[:_MAX_FRAME_HEAD])
            return self._zstd.own.decompress(stored, max_output_size=size)
        if head.compression == "lz4":
            self._require_size(size, compressed_size, "lz4")
            # One byte more than there may be: zero would mean no limit.
            data: bytes = lz4.frame.LZ4FrameDecompressor().decompress(stored, max_length=size + 1)
            if len(data) != size:
                raise BagError(f"{self.where}: damaged: a chunk says it holds {size} bytes, and has others")
            return data
        raise BagError(f'{self.where}: a chunk is compressed with "{head.compression[:50]}"; zstd and lz4 are read')

    def _require_size(self, size: int, packed: int, compression: str, start: bytes = b"") -> None:
        """Raise `BagError` before a chunk is decompressed whose sizes disagree, or that becomes too large."""
        if compression == "lz4" and size > _MAX_LZ4 * packed:
            raise BagError(f"{self.where}: damaged: a chunk of {packed} bytes says it holds {size}")
        if compression == "zstd" and (said := frame_content_size(start)) not in (-1, size):
            raise BagError(f"{self.where}: damaged: a chunk says it holds {size} bytes, and its compression {said}")
        if size > self._max_bytes:
            raise TooLargeError(
                f"{self.where}: a chunk of {packed} bytes says it holds {size}; expected at most {self._max_bytes}, "
                "unless max_decompressed_bytes is more"
            )

    def messages(
        self, data: bytes | bytearray, wanted: Mapping[int, BagChannel], known: Container[int], size: int = -1
    ) -> list[Raw]:
        """The messages among records that belong to the channels in `wanted`; `known` are all channels.

        Args:
            size: of the records, when they are not all of `data`.
        """
        view = memoryview(data)
        size, found, at = (len(data) if size < 0 else size), [], 0
        while at < size:
            opcode, length = RECORD.unpack_from(data, at)
            end = at + RECORD.size + length
            if end > size:
                raise BagError(f"{self.where}: damaged: a record in a chunk is longer than the chunk")
            if opcode == IS_MESSAGE:
                if length < MIN_MESSAGE_BYTES:
                    raise BagError(f"{self.where}: damaged: a message of {length} bytes, shorter than its times")
                _, _, channel, _, log_time, publish_time = MESSAGE.unpack_from(data, at)
                if channel in wanted:
                    whole: Any = view if length * _LARGE > size else data
                    found.append((wanted[channel], whole[at + MESSAGE.size : end], log_time, publish_time))
                elif channel not in known:
                    raise BagError(f"{self.where}: damaged: a message of channel {channel}, which there is not")
            at = end
        return found

    def message_headers(
        self, data: bytes | bytearray, known: Container[int], size: int = -1
    ) -> tuple[Array, NDArray[np.int64]]:
        """What `messages` reads before the data of each message, all at once, as an array, and where the data are.

        Raises:
            BagError: as `messages`.
        """
        size = len(data) if size < 0 else size
        at = self._message_offsets(data, size)
        every: Array = np.ndarray((max(0, size - MESSAGE.size + 1),), f"V{MESSAGE.size}", data, 0, (1,))
        heads = every[at].view(_HEADS)
        for channel in np.unique(heads["channel"]).tolist():
            if channel not in known:
                raise BagError(f"{self.where}: damaged: a message of channel {channel}, which there is not")
        return heads, at + MESSAGE.size

    def _message_offsets(self, data: bytes | bytearray, size: int) -> NDArray[np.int64]:
        """Where messages begin. Many that are equally long are found at once: guessed, and then looked at."""
        found: list[NDArray[np.int64]] = []
        single: list[int] = []
        octets: Array = np.ndarray(size, np.uint8, data)
        at, before, alike, enough = 0, -1, 0, _MIN_EQUAL_RUN
        while at < size:
            opcode, length = RECORD.unpack_from(data, at)
            step = RECORD.size + length
            if at + step > size:
                raise BagError(f"{self.where}: damaged: a record in a chunk is longer than the chunk")
            if opcode == IS_MESSAGE:
                if length < MIN_MESSAGE_BYTES:
                    raise BagError(f"{self.where}: damaged: a message of {length} bytes, shorter than its times")
                alike = alike + 1 if length == before else 0
                before = length
                if alike == enough:
                    rows = np.ndarray((size - at) // step * step, np.uint8, octets, at).reshape(-1, step)
                    wrong = np.flatnonzero((rows[:, : RECORD.size] != rows[0, : RECORD.size]).any(axis=1))
                    count = int(wrong[0]) if len(wrong) else len(rows)
                    found += [np.array(single, np.int64), at + step * np.arange(count)]
                    single = []
                    at += count * step
                    alike, enough = 0, (enough if count > 4 * _MIN_EQUAL_RUN else 2 * enough)
                    continue
                single.append(at)
            at += step
        return np.concatenate([*found, np.array(single, np.int64)])


# ----------------------------------------------------------------------------------------------------------- in pieces


def read_chunk_header(read: Read, body: int, end: int, where: str) -> ChunkHeader:
    """The head of the chunk whose record has its body there; raises `BagError`, and what libraries raise."""
    _, _, size, crc, name = _HEAD.unpack(read(body, _HEAD.size))
    if name > _MAX_NAME:
        raise BagError(f"{where}: damaged: the compression of a chunk has a name of {name} bytes")
    at = body + _HEAD.size + name
    (length,) = struct.unpack("<Q", read(at, 8))
    if at + 8 + length != end:
        raise BagError(f"{where}: damaged: a chunk says it has {length} bytes of records, and has {end - at - 8}")
    return ChunkHeader(at + 8, end, read(body + _HEAD.size, name).decode(), size, crc, where)


def iter_chunk_blocks(read: Read, head: ChunkHeader, validate_crcs: bool) -> Iterator[tuple[bytes | bytearray, int]]:
    """The records of a chunk in pieces, each with how many of its bytes are whole records.

    Raises:
        BagError: damaged; a wrong checksum is known at the end. And what libraries raise.
    """
    unpack = _unpacking(_Stored(read, head), head)
    left, crc, need = head.size, 0, 0
    data: bytes | bytearray = b""
    while left or data:
        piece = unpack(min(left, BLOCK_BYTES))
        if not piece:
            raise BagError(f"{head.where}: damaged: a chunk ends within a record")
        left -= len(piece)
        crc = zlib.crc32(piece, crc)
        data += piece  # in place, while one that is larger than a piece comes
        need -= len(piece)
        if need > 0:
            continue
        at, need = _whole(data)
        if need > left:
            raise BagError(f"{head.where}: damaged: a record in a chunk is longer than the chunk")
        if at:
            yield data, at
        data = data[at:] if need <= BLOCK_BYTES else bytearray(data[at:])
    if unpack(1):
        raise BagError(f"{head.where}: damaged: a chunk becomes more than the {head.size} bytes it says")
    if validate_crcs and head.crc and crc != head.crc:
        raise BagError(f"{head.where}: damaged: the checksum of a chunk is another")


def is_large(read: Read, head: ChunkHeader) -> bool:
    """Whether to unpack a chunk in pieces: not when one of its first messages is half of it."""
    if head.size <= MAX_WHOLE_CHUNK_BYTES:
        return False
    data, at = _unpacking(_Stored(read, head), head)(BLOCK_BYTES), 0
    while at + RECORD.size <= len(data):
        opcode, length = RECORD.unpack_from(data, at)
        if opcode == Opcode.MESSAGE and 2 * length >= head.size:
            return False
        at += RECORD.size + length
    return True


def _whole(data: bytes | bytearray) -> tuple[int, int]:
    """Where the last whole record ends, and how much is missing to the next."""
    at, size = 0, len(data)
    while at + RECORD.size <= size:
        end: int = at + RECORD.size + RECORD.unpack_from(data, at)[1]
        if end > size:
            return at, end - size
        at = end
    return at, RECORD.size - (size - at) if at < size else 0


class _Stored:
    """The records as they are stored, as a stream."""

    def __init__(self, read: Read, head: ChunkHeader) -> None:
        self._read, self._at, self._end = read, head.at, head.end

    def read(self, size: int = -1, /) -> bytes:
        """At most `size` bytes."""
        left = self._end - self._at
        found = self._read(self._at, left if size < 0 else min(size, left))
        self._at += len(found)
        return found


def _unpacking(source: _Stored, head: ChunkHeader) -> Callable[[int], bytes]:
    """What reads at most so many unpacked bytes, and none at the end."""
    if not head.compression:
        return source.read
    if head.compression == "zstd":
        zstd = ZstdDecompressor(max_window_size=MAX_WINDOW)
        return zstd.stream_reader(source, read_size=BLOCK_BYTES, read_across_frames=True).read  # type: ignore[arg-type]
    if head.compression == "lz4":
        return _Lz4(source).read
    raise BagError(f'{head.where}: a chunk is compressed with "{head.compression}"; zstd and lz4 are read')


class _Lz4:
    def __init__(self, source: _Stored) -> None:
        self._source = source
        self._frame: Any = lz4.frame.LZ4FrameDecompressor()

    def read(self, size: int) -> bytes:
        """Some of at most `size` bytes."""
        found = b""
        while size and not found and not self._frame.eof:
            more = self._source.read(BLOCK_BYTES) if self._frame.needs_input else b""
            if self._frame.needs_input and not more:
                break
            found = self._frame.decompress(more, max_length=size)
        return found
