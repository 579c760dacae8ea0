"""Access to bags at a URL such as ``s3://bucket/drive.mcap``: universal_pathlib wraps URLs as paths, fsspec reads them.

MCAP files are read by ranges with a read-ahead: consecutive records take few requests, and skipped records are mostly
not read. Databases and compressed files are copied into a temporary folder first.
"""

from __future__ import annotations

import os
import re
import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Iterator

_READ_AHEAD_BYTES = 1 << 20
"""Number of bytes that a range request reads after the requested bytes."""


class BagUnreachableError(BagError):
    """Error of a bag whose location does not respond; the bag itself may be intact."""


_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+(::[A-Za-z][A-Za-z0-9+.-]+)*://")
_WRAPPING = {"zip", "tar", "libarchive", "simplecache", "filecache", "blockcache", "cached", "reference", "dir", "dask"}
"""Protocols of fsspec that wrap another URL, which follows after ``::``."""


class BagLocation:
    """Location of a bag or of tables: a local path, a URL, which fsspec opens, or another text for errors."""

    def __init__(self, location: object) -> None:
        self._text = str(location)

    @property
    def is_url(self) -> bool:
        """True if the location is a URL, not a local path."""
        return _URL.match(self._text) is not None

    @property
    def has_colons_in_names(self) -> bool:
        """True if ``::`` in the URL belongs to a file name.

        The package fsspec would take the colons as a separator between two URLs.
        """
        first, separator, rest = self._text.partition("::")
        protocol, is_one, _ = first.partition("://")
        return bool(separator and is_one) and "://" not in rest and protocol not in _WRAPPING

    @contextmanager
    def unreachable_as_error(self) -> Iterator[None]:
        """Raise exceptions of remote file systems as `BagUnreachableError`; `OSError` and `RosidlError` pass."""
        try:
            yield
        except (RosidlError, OSError, MemoryError):
            raise
        except Exception as error:
            text = f"{self._text}: {type(error).__name__}: {str(error)[:300]}"
            raise BagUnreachableError(text) from None


def bag_path(path: str | os.PathLike[str]) -> Path:
    """Return the path object for a bag's local path or URL; raises `BagError` if no package supports the protocol."""
    if isinstance(path, os.PathLike) or not (location := BagLocation(path)).is_url:
        return Path(path)
    if path.startswith("file://") and location.has_colons_in_names:  # which universal_pathlib cannot take
        return Path(path.removeprefix("file://"))
    try:
        from upath import UPath
    except ModuleNotFoundError as missing:
        raise Extra.missing_error(missing) or missing from None
    try:
        # Of a URL with such a name, universal_pathlib would show what is before it; joined, it is read or refused.
        root = path[: path.rfind("/", 0, path.index("::"))] if location.has_colons_in_names else path
        url_path = UPath(root)
        _ = url_path.fs
        url_path = url_path.joinpath(path[len(root) + 1 :]) if root != path else url_path
    except (ImportError, ValueError) as error:  # no package for this protocol, no such protocol
        raise BagError(f"{path}: {error}") from None
    return cast("Path", url_path)


def opened(path: Path) -> IO[bytes]:
    """Open the local or remote file of a bag for reading at any offset."""
    return path.open("rb") if isinstance(path, Path) else cast("IO[bytes]", _RangeFile(path))


class _RangeFile:
    """File at a URL that is read by ranges; methods raise `BagUnreachableError` if the location does not respond."""

    def __init__(self, path: Any) -> None:
        self._path = path
        with BagLocation(path).unreachable_as_error():
            self._stream = path.open("rb", block_size=_READ_AHEAD_BYTES, cache_type="readahead")

    def read(self, size: int = -1) -> bytes:
        try:
            return bytes(self._stream.read(size))
        except MemoryError:
            raise
        except Exception as error:
            raise BagUnreachableError(f"{self._path}: {type(error).__name__}: {str(error)[:300]}") from None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def local_copy(path: Path, folder: Path) -> Path:
    """Return a copy of a remote bag file, with its SQLite journals, in a local folder; return a local file unchanged.

    Raises:
        BagError: the file needs more than half of the free space.
    """
    if isinstance(path, Path):
        return path
    with BagLocation(path).unreachable_as_error():
        size, room = path.stat().st_size, shutil.disk_usage(folder).free // 2
        if size > room:
            raise BagError(f"{path}: has {size} bytes; expected at most {room}, half of the free space in {folder}")
        for end in ("", "-wal", "-journal"):
            beside = path.with_name(path.name + end)
            if not end or beside.exists():
                beside.fs.get_file(beside.path, str(folder / beside.name))
    return folder / path.name
