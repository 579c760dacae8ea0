"""Opening of the files of a bag: finds the files, decompresses them, and selects the reader for each.

rosbag2 compresses whole files or single messages, with zstd. A compressed file is decompressed into a temporary folder,
block by block, and takes at most half of the free space there.
"""

from __future__ import annotations

import shutil
import struct
from contextlib import closing
from functools import partial
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, TYPE_CHECKING, Any, cast

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.metadata import FILE, read_metadata
from rosidl_py_gen.bags.remote import BagLocation, local_copy
from rosidl_py_gen.bags.storage.mcap_file import McapFile
from rosidl_py_gen.bags.storage.mcap_records import MAX_WINDOW, Zstd
from rosidl_py_gen.bags.storage.sqlite_file import SqliteFile
from rosidl_py_gen.bags.storage.storage_api import MAX_TIME, ReadingProgress, library_errors_as_bag_error
from rosidl_py_gen.bags.storage.zstd import ZstdDecompressor, ZstdError, frame_content_size

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator
    from contextlib import ExitStack

    from rosidl_py_gen.bags.common import DamagedPart
    from rosidl_py_gen.bags.metadata import BagMetadata
    from rosidl_py_gen.bags.storage.storage_api import MessageBlock, RawTuple, Storage

SUFFIX = ".zstd"
_SUFFIXES = ".mcap", ".db3"
_MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of zstd data, by which a compressed message is recognized: an uncompressed CDR message begins with a
zero."""
_PAGES = struct.Struct(">16x H 10x I")
"""Struct layout of the page size and the number of pages in the header of a SQLite database."""
_MAX_RATIO = 1000
_MAX_HEAD = 18
"""Maximum bytes of the header of a zstd frame, which states the decompressed size."""
_PIECE_BYTES = 1 << 20
"""Maximum size of decompressed data that is read at a time; zstandard allocates as much for the smallest data."""


def open_files(
    path: Path,
    resources: ExitStack,
    validate_crcs: bool,
    max_bytes: int,
    on_skipped: Callable[[DamagedPart], None] | None = None,
    progress: ReadingProgress | None = None,
) -> tuple[list[Path], list[Storage], BagMetadata | None]:
    """Open the files of a bag; leaving the exit stack `resources` closes them.

    Args:
        validate_crcs: compare checksums of MCAP chunks.
        max_bytes: maximum size of a decompressed chunk or message.
        on_skipped: called with each damaged part that is skipped; None raises `BagError` for damage.

    Returns:
        Paths of the files, their readers, and the contents of ``metadata.yaml``; None without such a file.

    Raises:
        BagError: the bag is damaged beyond reading, or of an unknown kind.
        OSError: a file cannot be opened.
    """
    storages: list[Storage] = []
    progress = progress or ReadingProgress()
    with BagLocation(path).unreachable_as_error():
        files, may_compress_messages, metadata = _files_of(path)
        progress.total += sum(file.stat().st_size for file in files if file.suffix == SUFFIX and file.exists())
        for file in files:
            plain = _decompressed(file, resources, max_bytes, progress)
            is_mcap = plain.suffix == ".mcap"
            storage: Storage = (
                McapFile(plain, validate_crcs, max_bytes, on_skipped, progress) if is_mcap else SqliteFile(plain)
            )
            resources.callback(storage.close)
            if may_compress_messages:
                storage = cast("Storage", _CompressedMessages(storage, file, max_bytes))
            storages.append(storage)
    return files, storages, metadata


def _files_of(path: Path) -> tuple[list[Path], bool, BagMetadata | None]:
    """Return the paths of a bag's files, True if rosbag2 may have compressed single messages, and ``metadata.yaml`` or
    None.
    """
    if not path.is_dir():
        return [path], True, None
    if not (path / FILE).exists():  # the recorder was killed
        return bag_files(path), True, None
    metadata = read_metadata(path)
    mode = metadata.compression_mode if metadata.compression else "none"
    if mode not in ("none", "file", "message") or metadata.compression not in ("", "zstd"):
        raise BagError(f"{path}: {metadata.compression} in rosbag2's {mode} mode is unknown; expected zstd")
    return [_find_file(path, name) for name in metadata.files], mode == "message", metadata


def bag_files(folder: Path) -> list[Path]:
    """Return the bag files in a folder in name order, compressed or not; raises `BagError` if there are none."""
    files = _bag_files(folder)
    if not files:
        raise BagError(f"{folder}: folder contains neither {FILE} nor bag files")
    return files


def compression_of(file: Path) -> str | None:
    """Return rosbag2's compression mode of a bag file: ``file``, ``message``, or "" without compression.

    Returns None if the file has no intact message that shows the mode.
    """
    if file.suffix == SUFFIX:
        return "file"
    is_database = file.suffix == ".db3"
    with closing(SqliteFile(file) if is_database else McapFile(file, True, on_skipped=lambda _: None)) as storage:
        for _, data, _, _, _ in storage.messages(None, 0, MAX_TIME):
            return "message" if bytes(data[:4]) == _MAGIC else ""
    return None


def _find_file(folder: Path, name: str) -> Path:
    """Return the file that ``metadata.yaml`` names, or its compressed or plain form, whichever is complete.

    Some recorders name one form and leave the other; a killed recorder leaves both.
    """
    if (named := folder / name).suffix == SUFFIX and named.is_file():
        return named  # complete, as the recorder ended; rosbag2 leaves decompressed files next to it
    plain = folder / name.removesuffix(SUFFIX)
    existing = [one for one in (plain, plain.with_name(plain.name + SUFFIX)) if one.is_file()]
    if not existing:
        others = [file.name for file in _bag_files(folder)]
        advice = f"; {', '.join(others[:3])} exists and can be read by its own name" if others else ""
        raise BagError(f"{folder / FILE} refers to {name}, which does not exist{advice}")
    return _pick_complete(existing)


def _bag_files(folder: Path) -> list[Path]:
    pairs: dict[str, list[Path]] = {}
    for file in sorted(folder.iterdir()):
        plain = file.name.removesuffix(SUFFIX)
        if Path(plain).suffix in _SUFFIXES and not plain.startswith("."):
            pairs.setdefault(plain, []).append(file)
    return [_pick_complete(pair) for pair in pairs.values()]


def _pick_complete(pair: list[Path]) -> Path:
    """Return the complete file of a plain bag file and its compressed form; a killed recorder leaves both."""
    return pair[0] if len(pair) == 1 or _is_plain_complete(pair[0]) or not _is_decompressible(pair[1]) else pair[1]


def _is_plain_complete(path: Path) -> bool:
    """Return True if an uncompressed bag file is complete: an MCAP file with its index, a database with all pages."""
    try:
        if path.suffix == ".mcap":
            with closing(McapFile(path, False)) as file:
                return file.is_whole
        with path.open("rb") as stream:
            page, count = _PAGES.unpack(stream.read(_PAGES.size))
        return bool(path.stat().st_size == count * (page if page > 1 else 1 << 16))
    except (BagError, OSError, struct.error):
        return False


def _decompressed_pieces(stream: IO[bytes]) -> tuple[int, Iterator[bytes]]:
    """Return the decompressed size that a zstd file states, -1 if it states none, and an iterator over the decompressed
    content.

    Raises exceptions of the zstd library for damaged data.
    """
    stated_size = frame_content_size(stream.read(_MAX_HEAD))
    stream.seek(0)
    reader = ZstdDecompressor(max_window_size=MAX_WINDOW).stream_reader(stream, read_across_frames=True)
    return stated_size, _pieces(reader)


def _pieces(reader: Any) -> Iterator[bytes]:
    return iter(partial(reader.read, _PIECE_BYTES), b"")


def _is_decompressible(path: Path) -> bool:
    """Return True if a zstd file can be decompressed to its end."""
    try:
        with path.open("rb") as stream:
            stated_size, pieces = _decompressed_pieces(stream)
            size = sum(map(len, pieces))
    except (ZstdError, OSError, MemoryError):
        return False
    return size > 0 and size >= stated_size


def _decompressed(path: Path, resources: ExitStack, max_bytes: int, progress: ReadingProgress) -> Path:
    if path.suffix == SUFFIX or (path.suffix == ".db3" and not isinstance(path, Path)):
        folder = Path(resources.enter_context(TemporaryDirectory(prefix="rosidl-py-gen-bag-")))
        path = local_copy(path, folder)
        path = _decompress_file(path, folder, max_bytes, progress) if path.suffix == SUFFIX else path
    if path.suffix not in _SUFFIXES:
        raise BagError(f"{path}: {'expected .mcap, .db3 or a folder' if path.exists() else 'file does not exist'}")
    return path


def _decompress_file(path: Path, folder: Path, max_bytes: int, progress: ReadingProgress) -> Path:
    """Decompress a zstd file into `folder`, and return the path of the new file.

    Raises:
        BagError: the content is larger than `max_bytes` and than 1000 times the file, larger than half of the free
            space, or damaged.
    """
    target = folder / path.name.removesuffix(SUFFIX)
    room = shutil.disk_usage(folder).free // 2
    max_size = max(max_bytes, _MAX_RATIO * path.stat().st_size)
    with path.open("rb") as compressed, target.open("wb") as output, library_errors_as_bag_error(path):
        written = 0
        stated_size, pieces = _decompressed_pieces(compressed)
        _require_size(path, stated_size, max_size)
        for piece in pieces:
            written += len(piece)
            if written > room:
                raise BagError(f"{path}: decompresses to more than {room} bytes, half of the free space in {folder}")
            _require_size(path, written, max_size)
            output.write(piece)
            progress.show(compressed.tell())
        progress.end_file(path.stat().st_size)
        if written < stated_size:
            raise BagError(f"{path}: damaged: decompresses to {written} bytes, and states {stated_size}")
    return target


def _require_size(path: Path, size: int, max_size: int) -> None:
    if size > max_size:
        raise BagError(
            f"{path}: decompresses to {size} bytes; expected at most {max_size}, unless max_decompressed_bytes is more"
        )


class _CompressedMessages:
    """Storage reader for files whose messages rosbag2 compressed one by one: decompresses each message that another
    reader returns.
    """

    def __init__(self, storage: Storage, path: Path, max_bytes: int) -> None:
        self._storage = storage
        self._path = path
        self._max_bytes = max_bytes
        self._zstd = Zstd()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._storage, name)

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[RawTuple]:
        messages = self._storage.messages(topics, start, end)
        first = next(messages, None)
        if first is None or bytes(first[1][:4]) != _MAGIC:  # all messages are compressed, or none
            return messages if first is None else chain([first], messages)
        return (
            (channel, self._decompress_message(bytes(data), channel.topic, log_time), log_time, publish_time, sequence)
            for channel, data, log_time, publish_time, sequence in chain([first], messages)
        )

    def stored_messages(self) -> Iterator[RawTuple]:
        return self._storage.messages(None, 0, MAX_TIME + 1)

    def _decompress_message(self, data: bytes, topic: str, log_time: int) -> bytes:
        if not data.startswith(_MAGIC):
            return data
        place = f"{self._path}: {topic} at {log_time} ns"
        try:
            size = frame_content_size(data)
            if size > self._max_bytes:
                raise BagError(
                    f"{place}: {len(data)} bytes state {size} bytes; expected at most {self._max_bytes}, unless "
                    "max_decompressed_bytes is more"
                )
            if size >= 0:
                return self._zstd.own.decompress(data)
            output = bytearray()
            for piece in _pieces(self._zstd.own.stream_reader(data)):
                output += piece
                if len(output) > self._max_bytes:
                    break
        except (ZstdError, MemoryError) as error:
            raise BagError(f"{place}: damaged: {error}") from None
        if len(output) > self._max_bytes:
            raise BagError(
                f"{place}: decompresses to more than {self._max_bytes} bytes, which is max_decompressed_bytes"
            )
        return bytes(output)

    def blocks(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[MessageBlock] | None:
        blocks = self._storage.blocks(topics, start, end)
        for first in blocks or ():
            begin = int(first.begin[0])
            is_packed = bytes(first.data[begin : begin + len(_MAGIC)]) == _MAGIC
            return None if is_packed else chain(iter([first]), blocks or ())
        return blocks
