"""Which files a bag has, and rosbag2's own compression of them: of whole files, or of each message; zstd.

Decides where a compressed file is unpacked: into a temporary folder, piece by piece, never more than fits there.
"""

from __future__ import annotations

import shutil
import struct
from contextlib import closing
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from zstandard import ZstdDecompressor, ZstdError, frame_content_size

from rosidl_py_gen.bags.common import BagError, BagTopic
from rosidl_py_gen.bags.metadata import FILE, read_metadata
from rosidl_py_gen.bags.remote import local_copy
from rosidl_py_gen.bags.storage.mcap_chunks import MAX_WINDOW, Zstd
from rosidl_py_gen.bags.storage.mcap_file import McapFile
from rosidl_py_gen.bags.storage.sqlite_file import SqliteFile
from rosidl_py_gen.bags.storage.storage_api import MAX_TIME, library_errors_as_bag_error

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from contextlib import ExitStack

    from rosidl_py_gen.bags.storage.storage_api import MessageBlock, Raw, Storage

SUFFIX = ".zstd"
_SUFFIXES = ".mcap", ".db3"
_MAGIC = b"\x28\xb5\x2f\xfd"
"""Begins what zstd made. Messages of CDR begin with a zero."""
_PAGES = struct.Struct(">16x H 10x I")
"""Size and number of the pages of a database, in its head."""
_PIECE = 1 << 20
_MAX_RATIO = 1000
_MAX_HEAD = 18
"""Bytes of the head of a frame, which says how large it becomes."""


def files_of(path: Path) -> tuple[list[Path], bool, dict[tuple[str, str], str]]:
    """The files of a bag, whether their messages may be compressed one by one, and known hashes by topic and type.

    Raises:
        BagError: a folder without any, or of an unknown compression.
    """
    if not path.is_dir():
        return [path], True, {}
    if not (path / FILE).exists():  # the recorder was killed
        return bag_files(path), True, {}
    told = read_metadata(path)
    mode = told.compression_mode if told.compression else "none"
    if mode not in ("none", "file", "message") or told.compression not in ("", "zstd"):
        raise BagError(f"{path}: {told.compression} of rosbag2's {mode} mode is not known; expected zstd")
    return (
        [_found(path, name) for name in told.files],
        mode == "message",
        {(topic.name, topic.type_name): topic.type_hash for topic in told.topics if topic.type_hash},
    )


def bag_files(folder: Path) -> list[Path]:
    """The bag files in a folder by name, compressed or not; raises `BagError` when there are none."""
    found = _bag_files(folder)
    if not found:
        raise BagError(f"{folder}: a folder with neither {FILE} nor bag files")
    return found


def compression_of(file: Path) -> str | None:
    """The mode of rosbag2's compression of a file, ``file`` or ``message``.

    Empty without compression; None where no message tells.
    """
    if file.suffix == SUFFIX:
        return "file"
    storage: Storage = SqliteFile(file) if file.suffix == ".db3" else McapFile(file, False)
    try:
        first = next(storage.messages(None, 0, MAX_TIME), None)
    finally:
        storage.close()
    if first is None:
        return None
    return "message" if bytes(first[1][:4]) == _MAGIC else ""


def _found(folder: Path, name: str) -> Path:
    """Return the file or its compressed form: some recorders name one and leave the other, a killed one leaves both."""
    if (named := folder / name).suffix == SUFFIX and named.is_file():
        return named  # the recorder ended, so it is complete; rosbag2 leaves what it decompresses next to it
    plain = folder / name.removesuffix(SUFFIX)
    found = [one for one in (plain, plain.with_name(plain.name + SUFFIX)) if one.is_file()]
    if not found:
        others = [file.name for file in _bag_files(folder)]
        advice = f"; there is {', '.join(others[:3])}, which can be read by its own name" if others else ""
        raise BagError(f"{folder / FILE} names {name}, which is not there{advice}")
    return _complete(found)


def _bag_files(folder: Path) -> list[Path]:
    pairs: dict[str, list[Path]] = {}
    for file in sorted(folder.iterdir()):
        plain = file.name.removesuffix(SUFFIX)
        if Path(plain).suffix in _SUFFIXES and not plain.startswith("."):
            pairs.setdefault(plain, []).append(file)
    return [_complete(pair) for pair in pairs.values()]


def _complete(pair: list[Path]) -> Path:
    """Return the complete file of a plain file and its compressed form; a recorder that compresses one leaves both.

    The plain file is complete then, unless the machine lost power before it was on the disk.
    """
    return pair[0] if len(pair) == 1 or _is_whole(pair[0]) or not _is_complete(pair[1]) else pair[1]


def _is_whole(path: Path) -> bool:
    """Return True if an MCAP file has its index, or a database all of its pages."""
    try:
        if path.suffix == ".mcap":
            with closing(McapFile(path, False)) as file:
                return file.is_whole
        with path.open("rb") as stream:
            page, count = _PAGES.unpack(stream.read(_PAGES.size))
        return bool(path.stat().st_size == count * (page if page > 1 else 1 << 16))
    except (BagError, OSError, struct.error):
        return False


def _is_complete(path: Path) -> bool:
    """Return True if a compressed file can be decompressed to its end."""
    try:
        with path.open("rb") as stream:
            said = frame_content_size(stream.read(_MAX_HEAD))
            stream.seek(0)
            reader = ZstdDecompressor(max_window_size=MAX_WINDOW).stream_reader(stream, read_across_frames=True)
            size = sum(map(len, iter(lambda: reader.read(_PIECE), b"")))
    except (ZstdError, OSError, MemoryError):
        return False
    return size > 0 and size >= said


def unpacked(path: Path, kept: ExitStack, max_bytes: int) -> Path:
    """The file, or what it becomes in a temporary folder that `kept` removes.

    Raises:
        BagError: it is no file of bags; and as `unpack_file`.
    """
    if path.suffix == SUFFIX or (path.suffix == ".db3" and not isinstance(path, Path)):
        folder = Path(kept.enter_context(TemporaryDirectory(prefix="rosidl-py-gen-bag-")))
        path = local_copy(path, folder)
        path = unpack_file(path, folder, max_bytes) if path.suffix == SUFFIX else path
    if path.suffix not in _SUFFIXES:
        raise BagError(f"{path}: {'neither .mcap nor .db3 nor a folder' if path.exists() else 'there is no such file'}")
    return path


def unpack_file(path: Path, folder: Path, max_bytes: int) -> Path:
    """Unpack a file into `folder`, under its name without ``.zstd``.

    Args:
        max_bytes: what it may become, unless that is less than a thousand times its size.

    Raises:
        BagError: it is damaged, or what it becomes is too large or does not fit there. OSError: it cannot be read.
    """
    target = folder / path.name.removesuffix(SUFFIX)
    room = shutil.disk_usage(folder).free // 2
    most = max(max_bytes, _MAX_RATIO * path.stat().st_size)
    with path.open("rb") as packed, target.open("wb") as unpacked, library_errors_as_bag_error(path):
        written = 0
        said = frame_content_size(packed.read(_MAX_HEAD))
        packed.seek(0)
        _require_size(path, said, most)
        with ZstdDecompressor(max_window_size=MAX_WINDOW).stream_reader(packed, read_across_frames=True) as stream:
            while piece := stream.read(_PIECE):
                written += len(piece)
                if written > room:
                    raise BagError(f"{path}: it becomes more than {room} bytes, half of what is free in {folder}")
                _require_size(path, written, most)
                unpacked.write(piece)
        if written < said:
            raise BagError(f"{path}: damaged: it becomes {written} bytes, and says {said}")
    return target


def _require_size(path: Path, size: int, most: int) -> None:
    if size > most:
        raise BagError(
            f"{path}: it becomes {size} bytes; expected at most {most}, unless max_decompressed_bytes is more"
        )


class CompressedMessages:
    """A file whose messages are compressed one by one."""

    def __init__(self, storage: Storage, path: Path, max_bytes: int) -> None:
        self._storage = storage
        self._path = path
        self._max_bytes = max_bytes
        self._zstd = Zstd()
        self.is_whole = storage.is_whole
        self.unread_bytes = storage.unread_bytes

    def channels(self) -> list[BagTopic]:
        return self._storage.channels()

    def span(self) -> tuple[int, int] | None:
        return self._storage.span()

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
        found = self._storage.messages(topics, start, end)
        for first in found:
            rest = chain(iter([first]), found)  # which keeps nothing of it
            return self._all_unpacked(rest) if bytes(first[1][:4]) == _MAGIC else rest  # all are, or none
        return iter(())

    def _all_unpacked(self, found: Iterator[Raw]) -> Iterator[Raw]:
        for channel, data, log_time, publish_time in found:
            yield channel, self._unpacked(bytes(data), channel.topic, log_time), log_time, publish_time

    def _unpacked(self, data: bytes, topic: str, log_time: int) -> bytes:
        if not data.startswith(_MAGIC):
            return data
        place = f"{self._path}: {topic} at {log_time} ns"
        try:
            size = frame_content_size(data)
            if size > self._max_bytes:
                raise BagError(
                    f"{place}: {len(data)} bytes say they become {size}; expected at most {self._max_bytes}, unless "
                    "max_decompressed_bytes is more"
                )
            if size >= 0:
                return self._zstd.own.decompress(data)
            unpacked = self._zstd.own.stream_reader(data).read(self._max_bytes + 1)
        except (ZstdError, MemoryError) as error:
            raise BagError(f"{place}: damaged: {error}") from None
        if len(unpacked) > self._max_bytes:
            raise BagError(f"{place}: it becomes more than {self._max_bytes} bytes, which is max_decompressed_bytes")
        return unpacked

    def blocks(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[MessageBlock] | None:
        found = self._storage.blocks(topics, start, end)
        for first in found or ():
            begin = int(first.begin[0])
            is_packed = bytes(first.data[begin : begin + len(_MAGIC)]) == _MAGIC
            return None if is_packed else chain(iter([first]), found or ())
        return found

    def parts(self) -> list[tuple[int, int]]:
        return self._storage.parts()

    def close(self) -> None:
        self._storage.close()
