"""Where datasets are written: local folders, and with fsspec whatever has a URL, such as ``s3://`` and ``memory://``.

Decides that nobody finds half a file: those of one run of `Output` get their names when all are whole, and none does
when something fails. Of a process that was killed, local files with ``.partial`` behind their names are left over.
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
    from collections.abc import Iterator

PARTIAL = ".partial"
_COLONS = "\ue000\ue001"
"""Stands for ``::`` while fsspec reads a URL."""
_BLOCK = 1 << 23
"""Bytes of a remote file that are sent together."""


def file_system(place: str, *, fresh: bool = False) -> tuple[Any, str]:
    """What fsspec has for a place, and its path there.

    Args:
        fresh: one that nobody else has.

    Raises:
        BagError: nobody knows such URLs, or the place did not answer. ExtraMissingError: there is no fsspec.
    """
    try:
        import fsspec  # type: ignore[import-untyped]
    except ModuleNotFoundError as missing:
        raise missing_extra_message(missing) or missing from None
    if not is_url(place):  # fsspec would take "::" for a chain of URLs, and other signs for its own
        return fsspec.filesystem("file", skip_instance_cache=fresh), os.path.abspath(place)
    hidden = place.replace("::", _COLONS) if has_colons_in_names(place) else place
    try:
        with unreachable_as_error(place):
            system, path = fsspec.core.url_to_fs(hidden, skip_instance_cache=fresh)
            path = path.replace(_COLONS, "::")
    except ImportError as error:  # no package for this protocol
        raise BagError(f"{place}: {error}") from None
    return system, path


def joined(place: str, *parts: str) -> str:
    """A place below another."""
    return "/".join((place.rstrip("/") or "/", *parts)) if is_url(place) else os.path.join(place, *parts)


def url_of(place: str, path: str) -> str:
    """What fsspec calls a path, where it has found it at a place, as it is called everywhere."""
    if not is_url(place) or is_url(path):
        return path
    protocol = place.partition("://")[0]
    return f"{protocol}://{path if protocol == 'file' else path.lstrip('/')}"


class Output:
    """Files that appear together, when this ends without an error. Use it with ``with``."""

    def __init__(self, out: str) -> None:
        self._system: Any = file_system(out, fresh=True)[0] if is_url(out) else None
        self._transaction: Any = None
        self._partial: dict[str, str] = {}
        self._token = uuid4().hex[:12]

    @contextmanager
    def written(self, place: str, overwrite: bool) -> Iterator[Any]:
        """A binary file to write to; its folders are made.

        Raises:
            BagError: there is a file already. OSError: it cannot be written.
        """
        if self._system is None:
            if not overwrite and os.path.exists(place):
                raise BagError(f"{place} exists already")
            os.makedirs(os.path.dirname(place) or ".", exist_ok=True)
            self._partial[place] = f"{place}.{self._token}{PARTIAL}"
            with open(self._partial[place], "xb") as stream:
                yield stream
            return
        with unreachable_as_error(place):
            path = file_system(place)[1]
            if not overwrite and self._system.exists(path):
                raise BagError(f"{place} exists already")
            self._system.makedirs(path.rpartition("/")[0], exist_ok=True)
            with self._system.open(path, "wb", block_size=_BLOCK) as stream:
                yield stream

    def publish(self) -> None:
        """Give the files their names."""
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
            with suppress(Exception):  # what went wrong first is what counts
                self._transaction.complete(commit=False)
