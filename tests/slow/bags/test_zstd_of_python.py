"""The zstd module of Python 3.14 and newer behaves as the package zstandard."""

from __future__ import annotations

import io
import random

import pytest

pytest.importorskip("compression.zstd", reason="Python has zstd from 3.14 on")
zstandard = pytest.importorskip("zstandard")

from rosidl_py_gen.bags.storage import zstd_of_python  # noqa: E402

LENGTHS = [0, 1, 100, 70_000, 3_000_000]


def some(size: int) -> bytes:
    """Return data that can be compressed, but not to nothing."""
    return random.Random(size).randbytes(size // 2) + bytes(size - size // 2)


def without_size(data: bytes) -> bytes:
    """Return a frame that does not state its size."""
    return bytes(zstandard.ZstdCompressor(write_content_size=False).compress(data))


@pytest.mark.parametrize("size", LENGTHS)
@pytest.mark.parametrize("threads", [0, 1, -1])
def test_frames_compressed_by_python_are_read_by_zstandard_and_state_their_size(size: int, threads: int) -> None:
    data = some(size)
    compressor = zstd_of_python.ZstdCompressor(1, threads=threads)
    copied = io.BytesIO()
    compressor.copy_stream(io.BytesIO(data), copied, size=size, read_size=1 << 16)
    for frame in (compressor.compress(data), zstd_of_python.compress(data), copied.getvalue()):
        assert zstandard.frame_content_size(frame) == size == zstd_of_python.frame_content_size(frame[:18])
        assert zstandard.decompress(frame) == data


@pytest.mark.parametrize("size", LENGTHS)
def test_frames_compressed_by_zstandard_are_decompressed(size: int) -> None:
    data = some(size)
    for frame in (zstandard.compress(data), without_size(data)):
        assert zstd_of_python.ZstdDecompressor().decompress(frame, max_output_size=size) == data
        assert zstd_of_python.frame_content_size(frame) == zstandard.frame_content_size(frame)


def test_decompressed_output_larger_than_allowed_is_an_error() -> None:
    with pytest.raises(zstd_of_python.ZstdError, match="does not end after 99999 bytes"):
        zstd_of_python.ZstdDecompressor().decompress(without_size(bytes(100_000)), max_output_size=99_999)


def test_several_frames_are_read_as_one_stream_on_request() -> None:
    data = [some(size) for size in LENGTHS]
    frames = b"".join(map(zstandard.compress, data))
    for size in (1000, 1 << 20, 1 << 23):
        reader = zstd_of_python.ZstdDecompressor().stream_reader(
            io.BytesIO(frames), read_size=777, read_across_frames=True
        )
        pieces = list(iter(lambda reader=reader, size=size: reader.read(size), b""))  # type: ignore[misc]
        assert b"".join(pieces) == b"".join(data)
        assert all(len(piece) == size for piece in pieces[:-1])
    assert zstd_of_python.ZstdDecompressor().stream_reader(frames).read(1 << 23) == data[0]


def test_truncated_frames_are_read_as_zstandard_reads_them() -> None:
    frame = zstandard.compress(some(3_000_000))
    for cut in (5, 1000, 1_000_000, len(frame) - 1):
        ours = zstd_of_python.ZstdDecompressor().stream_reader(io.BytesIO(frame[:cut]))
        theirs = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(frame[:cut]))
        assert ours.read(1 << 22) == theirs.read(1 << 22)
        with pytest.raises(zstd_of_python.ZstdError):
            zstd_of_python.ZstdDecompressor().decompress(frame[:cut])


def test_damaged_frames_are_errors_or_equal_data_as_in_zstandard() -> None:
    frame = zstandard.compress(some(10_000))
    rng = random.Random(1)
    for _ in range(2000):
        damaged = bytearray(frame)
        damaged[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
        outputs = []
        for library in (zstandard, zstd_of_python):
            try:
                outputs.append(library.ZstdDecompressor().decompress(bytes(damaged), max_output_size=10_000))
            except library.ZstdError:
                outputs.append(None)
        assert outputs[0] == outputs[1]


def test_frame_with_large_window_and_no_stated_size_is_an_error() -> None:
    wide = zstandard.ZstdCompressionParameters(window_log=29, write_content_size=False)
    stream = zstandard.ZstdCompressor(compression_params=wide).compressobj()
    frame = stream.compress(bytes(1000)) + stream.flush()
    with pytest.raises(zstd_of_python.ZstdError):
        zstd_of_python.ZstdDecompressor().decompress(frame, max_output_size=1000)
