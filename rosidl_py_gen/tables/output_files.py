"""Output of datasets to local folders and, by fsspec, to URLs such as ``s3://`` and ``memory://``.

No reader sees a partial file: all files of one `Output` are renamed when they are complete, and none after a failure. A
process that was killed leaves local files with the suffix ``.partial``.
"""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.remote import has_colons_in_names, is_url, unreachable_as_error
from rosidl_py_gen.base.resources import missing_extra_message

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PARTIAL = ".partial"
_COLONS = "\ue000\ue001"
"""Text that replaces ``::`` in a path while fsspec parses the URL, because fsspec would split the URL there."""
_BLOCK_BYTES = 1 << 23
"""Number of bytes that are sent at once to a remote file."""


def file_system(place: str, *, fresh: bool = False) -> tuple[Any, str]:
    """Return the fsspec file system of a local path or URL, and the path in it.

    `fresh` makes a file system object that is not shared. Raises `BagError` if the URL is not supported, or the place
    does not respond.
    """
    try:
        import fsspec  # type: ignore[import-untyped]
    except ModuleNotFoundError as missing:
        raise missing_extra_message(missing) or missing from None
    if not is_url(place):  # fsspec would parse "::" as a chain of URLs, and other characters as well
        return fsspec.filesystem("file", skip_instance_cache=fresh), os.path.abspath(place)
    url = place.replace("::", _COLONS) if has_colons_in_names(place) else place
    try:
        with unreachable_as_error(place):
            system, path = fsspec.core.url_to_fs(url, skip_instance_cache=fresh)
    except ImportError as error:  # no package for this protocol
        raise BagError(f"{place}: {error}") from None
    return system, path.replace(_COLONS, "::")


def joined(place: str, *parts: str) -> str:
    """Return the local path or URL of the file or folder `parts` below the folder or URL `place`."""
    return "/".join((place.rstrip("/") or "/", *parts)) if is_url(place) else os.path.join(place, *parts)


def url_of(place: str, path: str) -> str:
    """Return the URL of a path that fsspec has found at `place`; the path itself if `place` is a local path."""
    if not is_url(place) or is_url(path):
        return path
    protocol = place.partition("://")[0]
    return f"{protocol}://{path if protocol == 'file' else path.lstrip('/')}"


class Output:
    """Output files that become visible together by `commit`; leaving the context without `commit` discards them."""

    def __init__(self, out: str) -> None:
        self._system: Any = file_system(out, fresh=True)[0] if is_url(out) else None
        self._transaction: Any = None
        self._partial: dict[str, str] = {}
        self._token = uuid4().hex[:12]

    @contextmanager
    def written(self, place: str, may_replace: Callable[[str], bool]) -> Iterator[Any]:
        """Open a binary output file that stays invisible until `commit`, and create its folders.

        Raises:
            BagError: the file exists, and `may_replace` returns False for its place.
            OSError: the file cannot be written.
        """
        if self._system is None:
            if os.path.exists(place) and not may_replace(place):
                raise BagError(f"{place} exists already")
            os.makedirs(os.path.dirname(place) or ".", exist_ok=True)
            self._partial[place] = f"{place}.{self._token}{PARTIAL}"
            with open(self._partial[place], "xb") as stream:
                yield stream
            return
        with unreachable_as_error(place):
            path = file_system(place)[1]
            if self._system.exists(path) and not may_replace(place):
                raise BagError(f"{place} exists already")
            self._system.makedirs(path.rpartition("/")[0], exist_ok=True)
            with self._system.open(path, "wb", block_size=_BLOCK_BYTES) as stream:
                yield stream

    def commit(self) -> None:
        """Rename all output files to their final names."""
        for place, partial in list(self._partial.items()):
            os.replace(partial, place)
            del self._partial[place]
        if self._transaction is not None:
            with unreachable_as_error("the file system"):
                transaction, self._transaction = self._transaction, None
                transaction.complete()

    def __enter__(self) -> Output:
        if self._system is not None:
            self._transaction = self._system.transaction
            self._transaction.start()
        return self

    def __exit__(self, *_: object) -> None:
        for partial in self._partial.values():
            with suppress(OSError):
                os.remove(partial)
        if self._transaction is not None:
            with suppress(Exception):  # the first error is raised
                self._transaction.complete(commit=False)
