"""Bags that have a URL, as ``s3://bucket/drive.mcap``: universal_pathlib shows them as paths, fsspec reads them.

Decides how much is read at once: what is asked for and a little behind it, so that the records of a file that follow
each other take few requests, and of what a reader leaves out little is read. What cannot be read by ranges, databases
and files that are compressed as a whole, is copied into a temporary folder first.
"""

from __future__ import annotations

import os
import re
import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.resources import missing_extra_message
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Iterator

_READ_AHEAD_BYTES = 1 << 20
"""Bytes that are read more than asked for."""


class BagUnreachableError(BagError):
    """The place where a bag is did not answer, which says nothing of its bytes."""


_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+(::[A-Za-z][A-Za-z0-9+.-]+)*://")
_WRAPPING = {"zip", "tar", "libarchive", "simplecache", "filecache", "blockcache", "cached", "reference", "dir", "dask"}
"""Protocols of fsspec that are about the URL after a ``::``."""


def is_url(place: str) -> bool:
    """Whether a place is one for fsspec."""
    return _URL.match(place) is not None


def has_colons_in_names(url: str) -> bool:
    """Return True if ``::`` is a part of names in a URL: fsspec would take it for a chain of URLs."""
    first, separator, rest = url.partition("::")
    protocol, is_one, _ = first.partition("://")
    return bool(separator and is_one) and "://" not in rest and protocol not in _WRAPPING


def bag_path(path: str | os.PathLike[str]) -> Path:
    """The path of a bag: of this machine, or what looks like it.

    Raises:
        BagError: nobody knows such URLs. ExtraMissingError: there is no universal_pathlib.
    """
    if isinstance(path, os.PathLike) or not is_url(path):
        return Path(path)
    if path.startswith("file://") and has_colons_in_names(path):  # which universal_pathlib cannot take
        return Path(path.removeprefix("file://"))
    try:
        from upath import UPath
    except ModuleNotFoundError as missing:
        raise missing_extra_message(missing) or missing from None
    try:
        # Of a URL with such a name, universal_pathlib would show what is before it; joined, it is read or refused.
        root = path[: path.rfind("/", 0, path.index("::"))] if has_colons_in_names(path) else path
        found = UPath(root)
        _ = found.fs
        found = found.joinpath(path[len(root) + 1 :]) if root != path else found
    except (ImportError, ValueError) as error:  # no package for this protocol, no such protocol
        raise BagError(f"{path}: {error}") from None
    return cast("Path", found)


@contextmanager
def unreachable_as_error(place: object) -> Iterator[None]:
    """Turn what file systems raise, each package its own, into `BagUnreachableError`; those of files are left alone."""
    try:
        yield
    except (RosidlError, OSError, MemoryError):
        raise
    except Exception as error:
        raise BagUnreachableError(f"{place}: {type(error).__name__}: {str(error)[:300]}") from None


def opened(path: Path) -> IO[bytes]:
    """A file to read from, here and there."""
    return path.open("rb") if isinstance(path, Path) else cast("IO[bytes]", _RangeFile(path))


class _RangeFile:
    """A file that is read by ranges."""

    def __init__(self, path: Any) -> None:
        self._path = path
        with unreachable_as_error(path):
            self._stream = path.open("rb", block_size=_READ_AHEAD_BYTES, cache_type="readahead")

    def read(self, size: int = -1) -> bytes:
        """As of a file. Raises `BagUnreachableError`."""
        try:
            return bytes(self._stream.read(size))
        except MemoryError:
            raise
        except Exception as error:
            raise BagUnreachableError(f"{self._path}: {type(error).__name__}: {str(error)[:300]}") from None

    def seek(self, at: int, whence: int = 0) -> int:
        """As of a file."""
        return int(self._stream.seek(at, whence))

    def tell(self) -> int:
        """As of a file."""
        return int(self._stream.tell())

    def close(self) -> None:
        """As of a file."""
        self._stream.close()


def local_copy(path: Path, folder: Path) -> Path:
    """The same file in a folder of this machine, with what SQLite keeps beside it; a local one is left where it is.

    Raises:
        BagError: it does not fit there. OSError: it cannot be read.
    """
    if isinstance(path, Path):
        return path
    with unreachable_as_error(path):
        size, room = path.stat().st_size, shutil.disk_usage(folder).free // 2
        if size > room:
            raise BagError(f"{path}: it has {size} bytes, more than {room}, half of what is free in {folder}")
        for end in ("", "-wal", "-journal"):
            beside = path.with_name(path.name + end)
            if not end or beside.exists():
                beside.fs.get_file(beside.path, str(folder / beside.name))
    return folder / path.name
