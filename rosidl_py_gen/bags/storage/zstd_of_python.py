"""Subset of the package zstandard that bags need, made from `compression.zstd` of Python 3.14 and newer."""

from __future__ import annotations

import os
from io import BytesIO
from typing import IO, TYPE_CHECKING, Any, Protocol

from compression import zstd  # type: ignore[import-not-found,unused-ignore]

if TYPE_CHECKING:
    from collections.abc import Mapping

ZstdError = zstd.ZstdError
_LEVEL: Any = zstd.CompressionParameter.compression_level
_WORKERS: Any = zstd.CompressionParameter.nb_workers
_WINDOW_LOG: Any = zstd.DecompressionParameter.window_log_max
_MAX_HEAD = 18
"""Maximum size of the header of a zstd frame, which states the decompressed size."""
_DEFAULT_WINDOW_LOG = 27


class _Source(Protocol):
    def read(self, size: int, /) -> bytes: ...


def frame_content_size(data: bytes) -> int:
    """Return the decompressed size that the header of a zstd frame states; -1 if it states none."""
    size = zstd.get_frame_info(data).decompressed_size
    return -1 if size is None else int(size)


def compress(data: bytes | bytearray) -> bytes:
    """Return the data compressed as one zstd frame."""
    return bytes(zstd.compress(data))


class ZstdCompressor:
    """Zstd compressor for messages and files.

    Args:
        threads: 0 uses the calling thread, -1 one for each processor.
    """

    def __init__(self, level: int, threads: int = 0) -> None:
        most = _WORKERS.bounds()[1]  # 0 if the library has no threads
        self._options: Mapping[Any, int] = {
            _LEVEL: level,
            _WORKERS: min(most, (os.cpu_count() or 1) if threads < 0 else threads),
        }

    def compress(self, data: bytes) -> bytes:
        """Return the data compressed as one zstd frame."""
        return bytes(zstd.compress(data, options=self._options))

    def copy_stream(self, source: IO[bytes], target: IO[bytes], size: int, read_size: int) -> None:
        """Compress `size` bytes of a source stream into a target stream as one zstd frame."""
        library = zstd.ZstdCompressor(options=self._options)
        library.set_pledged_input_size(size)
        while piece := source.read(read_size):
            target.write(library.compress(piece))
        target.write(library.flush())


class ZstdDecompressor:
    """Zstd decompressor that several threads may use at the same time: it uses a separate object for each frame."""

    def __init__(self, max_window_size: int = 1 << _DEFAULT_WINDOW_LOG) -> None:
        self._window_log = max_window_size.bit_length() - 1

    def decompress(self, data: bytes, max_output_size: int = 0) -> bytes:
        """Return the decompressed data of the first zstd frame.

        `max_output_size` is the limit for a frame that does not state its size. Raises `ZstdError` if the frame is
        longer.
        """
        size = frame_content_size(data[:_MAX_HEAD])
        window_log = self._window_log
        if size < 0:
            size = max_output_size
        else:  # the window is at most as large as the stated size
            window_log = min(max(window_log, size.bit_length()), _WINDOW_LOG.bounds()[1])
        frame = zstd.ZstdDecompressor(options={_WINDOW_LOG: window_log})
        output = frame.decompress(data, max_length=size + 1)
        if not frame.eof or len(output) > size:
            raise ZstdError(f"the frame does not end after {size} bytes")
        return bytes(output)

    def stream_reader(
        self, source: _Source | bytes, read_size: int = 1 << 17, read_across_frames: bool = False
    ) -> _StreamReader:
        """Return a reader of the decompressed data of a stream or of bytes."""
        source = BytesIO(source) if isinstance(source, bytes) else source
        return _StreamReader(source, read_size, read_across_frames, self._window_log)


class _StreamReader:
    """Readable stream of the decompressed data of one zstd frame, or of all frames; the data may end within a frame."""

    def __init__(self, source: _Source, read_size: int, all_frames: bool, window_log: int) -> None:
        self._source, self._read_size, self._all_frames = source, read_size, all_frames
        self._options = {_WINDOW_LOG: window_log}
        self._frame: Any = zstd.ZstdDecompressor(options=self._options)

    def read(self, size: int) -> bytes:
        """Return `size` decompressed bytes; at the end of the data, fewer bytes."""
        pieces, left = [], size
        while left > 0:
            more = b""
            if self._frame.eof:
                more = (self._frame.unused_data or self._source.read(self._read_size)) if self._all_frames else b""
                if not more:
                    break
                self._frame = zstd.ZstdDecompressor(options=self._options)
            elif self._frame.needs_input and not (more := self._source.read(self._read_size)):
                break
            pieces.append(self._frame.decompress(more, max_length=left))
            left -= len(pieces[-1])
        return b"".join(pieces)
