"""Chunks of MCAP: unpacked within bounds, and cut into their records.

Decides how much a chunk may become: what it says of itself, which has to be what its compression says, and at most what
the reader allows.
"""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING, Any

import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk
from zstandard import ZstdDecompressor, frame_content_size

from rosidl_py_gen.mcap.common import BagError

if TYPE_CHECKING:
    from collections.abc import Container, Mapping
    from pathlib import Path

    from rosidl_py_gen.mcap.storage import Channel, Raw

RECORD = struct.Struct("<BQ")
"""Kind and length of a record of MCAP."""
MESSAGE = struct.Struct("<BQHIQQ")
"""The same of a message, then channel, sequence, log time and publish time; the rest of the record is its data."""
IS_MESSAGE = int(Opcode.MESSAGE)  # comparing with the enum costs as much as the rest of the loop
_LARGE = 8
"""A message is large when its chunk has at most so many times its size."""
_MOST_LZ4 = 255
"""LZ4 makes at most so many bytes of one."""


class Unpacker:
    """Unpacks the chunks of one file.

    Args:
        max_bytes: the most that a compressed chunk may become.
        validate_crcs: compare checksums.
    """

    def __init__(self, path: Path, max_bytes: int, validate_crcs: bool) -> None:
        self._path = path
        self._max_bytes = max_bytes
        self.validate_crcs = validate_crcs
        self._zstd = ZstdDecompressor()

    def unpacked(self, record: bytes) -> bytes:
        """The records in a chunk, given as the body of its own record. Raises `BagError`, and what libraries raise."""
        chunk = Chunk.read(ReadDataStream(_Bytes(record)))  # type: ignore[arg-type]
        data = self._decompressed(chunk)
        if self.validate_crcs and chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise BagError(f"{self._path}: damaged: the checksum of a chunk is not that of its {len(data)} bytes")
        return data

    def _decompressed(self, chunk: Chunk) -> bytes:
        if not chunk.compression:
            return chunk.data
        size, packed = chunk.uncompressed_size, len(chunk.data)
        if chunk.compression == "zstd":
            said = frame_content_size(chunk.data)
            self._require_size(max(said, size), packed)
            if said not in (-1, size):
                raise BagError(f"{self._path}: damaged: a chunk says it holds {size} bytes, and its compression {said}")
            return self._zstd.decompress(chunk.data, max_output_size=size)
        if chunk.compression == "lz4":
            self._require_size(size, packed)
            if size > _MOST_LZ4 * packed:
                raise BagError(f"{self._path}: damaged: a chunk of {packed} bytes says it holds {size}")
            # One byte more than there may be: zero would mean no limit.
            data: bytes = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
            if len(data) != size:
                raise BagError(f"{self._path}: damaged: a chunk says it holds {size} bytes, and has others")
            return data
        raise BagError(f'{self._path}: a chunk is compressed with "{chunk.compression[:50]}"; zstd and lz4 are read')

    def _require_size(self, size: int, packed: int) -> None:
        """Raises `BagError` before a chunk is unpacked that says it becomes too large."""
        if size > self._max_bytes:
            raise BagError(
                f"{self._path}: a chunk of {packed} bytes says it holds {size}; expected at most {self._max_bytes}, "
                "unless max_unpacked_bytes is more"
            )

    def messages(self, data: bytes, wanted: Mapping[int, Channel], known: Container[int]) -> list[Raw]:
        """The messages among records that belong to the channels in `wanted`; `known` are all channels."""
        view = memoryview(data)
        size, found, at = len(data), [], 0
        while at < size:
            opcode, length = RECORD.unpack_from(data, at)
            end = at + RECORD.size + length
            if end > size:
                raise BagError(f"{self._path}: damaged: a record in a chunk is longer than the chunk")
            if opcode == IS_MESSAGE:
                _, _, channel, _, log_time, publish_time = MESSAGE.unpack_from(data, at)
                if channel in wanted:
                    whole = view if length * _LARGE > size else data
                    found.append((wanted[channel], whole[at + MESSAGE.size : end], log_time, publish_time))
                elif channel not in known:
                    raise BagError(f"{self._path}: damaged: a message of channel {channel}, which there is not")
            at = end
        return found


class _Bytes:
    """What `ReadDataStream` reads, without the copy that BytesIO makes of a view."""

    __slots__ = ("_at", "_data")

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def read(self, length: int) -> Any:
        """As a stream."""
        self._at += length
        return self._data[self._at - length : self._at]
