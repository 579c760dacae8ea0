"""The files that a bag is written into, one after the other, and what its folder says of them.

Decides when a file is full, and what rosbag2 calls compression: zstd of whole files, or of each message; chunks inside
MCAP files are compressed by themselves (`writer.py`).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from zstandard import ZstdCompressor

from rosidl_py_gen.bags.common import BagError, replace_durably
from rosidl_py_gen.bags.metadata import FileStatistics, metadata_text, write_metadata
from rosidl_py_gen.bags.storage.file_compression import SUFFIX
from rosidl_py_gen.base.stamps import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rosidl_py_gen.bags.common import BagTopic

CompressionMode = Literal["none", "file", "message"]
_PACKINGS = "none", "file", "message"
_LEVEL = 1
"""Of zstd, as rosbag2 has it."""
_PIECE = 1 << 20


def compress_file(source: Path, zstd: ZstdCompressor | None = None) -> Path:
    """Replace a file by its compressed form, as rosbag2 does in mode ``file``; returns the new path.

    At any moment one of both files is complete, also after a power cut: readers take that one.

    Raises:
        OSError: the disk is full; the file stays as it was.
    """
    target = source.with_name(source.name + SUFFIX)
    partial = target.with_name(f".{target.name}")
    try:
        with source.open("rb") as plain, partial.open("wb") as compressed:
            size = source.stat().st_size
            (zstd or ZstdCompressor(_LEVEL)).copy_stream(plain, compressed, size=size, read_size=_PIECE)
        replace_durably(partial, target)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    source.unlink()
    return target


class FileSplitter:
    """Numbers the files of a folder and counts what is in them; or knows the only file of a bag that has no folder.

    Raises:
        BagError: one file shall be split or packed, a limit is no number above 0, or a text of `custom_data` is none.
    """

    def __init__(
        self,
        path: Path,
        storage: str,
        suffix: str,
        *,
        is_folder: bool = True,
        split_bytes: int | None = None,
        split_s: float | None = None,
        packing: CompressionMode = "none",
        threads: int = 0,
        custom_data: Mapping[str, str] | None = None,
    ) -> None:
        if packing not in _PACKINGS:
            raise BagError(f'packing "{packing}" is not known; there are {", ".join(_PACKINGS)}')
        self._path, self._is_folder = path, is_folder
        if split_bytes or split_s:
            self.require_folder()
        if not is_folder and (packing != "none" or custom_data):
            raise BagError(f"{path} is one file; packing and custom data are told in the metadata of a folder")
        for key, value in (custom_data or {}).items():
            if not (isinstance(key, str) and isinstance(value, str)):
                raise BagError(f"custom data are texts, found {key!r:.80}: {value!r:.80}")
        self._storage, self._suffix = storage, suffix
        self._split_bytes = split_bytes
        self._split_ns = None if split_s is None else round(split_s * NS_PER_S)
        self._packing: CompressionMode = packing
        self._custom_data = dict(custom_data or {})
        self._zstd = None if packing == "none" else ZstdCompressor(_LEVEL, threads=threads)
        self._files: list[FileStatistics] = []
        self._bytes = 0

    def begin(self) -> Path:
        """The next file, which is the current one from now on."""
        name = f"{self._path.name}_{len(self._files)}{self._suffix}" if self._is_folder else self._path.name
        self._files.append(FileStatistics(name))
        self._bytes = 0
        return self._path / name if self._is_folder else self._path

    def needs_new_file(self, log_time_ns: int) -> bool:
        """Whether a message of that time belongs into another file."""
        first = self._files[-1].first
        is_long = self._split_ns is not None and first is not None and log_time_ns - first >= self._split_ns
        return is_long or (self._split_bytes is not None and self._bytes >= self._split_bytes)

    def add(self, topic: str, log_time_ns: int, size: int) -> None:
        """Count a message of the current file."""
        self._files[-1].add(topic, log_time_ns)
        self._bytes += size

    def require_folder(self) -> None:
        """Raises `BagError` for a bag of one file."""
        if not self._is_folder:
            raise BagError(f"{self._path} is one file; a folder can be split")

    @property
    def is_empty(self) -> bool:
        """Whether nothing is in the current file."""
        return self._files[-1].first is None

    def compress_message(self, data: bytes) -> bytes:
        """The message as it is kept."""
        return self._zstd.compress(data) if self._zstd is not None and self._packing == "message" else data

    def file_metadata(self, topics: Iterable[BagTopic]) -> str:
        """What a file says of itself."""
        return self._text(self._files[-1:], topics)

    def end(self) -> None:
        """The current file is closed: pack it.

        Raises:
            OSError: the disk is full; the file stays as it was.
        """
        if self._zstd is None or self._packing != "file":
            return
        current = self._files[-1]
        current.path = compress_file(self._path / current.path, self._zstd).name

    def write_metadata(self, topics: Iterable[BagTopic]) -> None:
        """Write ``metadata.yaml`` of a folder; nothing for a bag of one file.

        Raises:
            OSError: the disk is full.
        """
        if self._is_folder:
            write_metadata(self._path, self._text(self._files, topics))

    def _text(self, files: Iterable[FileStatistics], topics: Iterable[BagTopic]) -> str:
        mode = "" if self._packing == "none" else self._packing
        return metadata_text(self._storage, files, topics, compression_mode=mode, custom_data=self._custom_data)
