"""Where files are written: local folders, and with fsspec whatever has a URL, such as ``s3://`` and ``memory://``.

Decides that nobody finds half a file: a local one gets its name when it is whole; a remote one that was not finished is
removed.
"""

from __future__ import annotations

import os
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.base.resources import extra_missing

if TYPE_CHECKING:
    from collections.abc import Iterator

_PARTIAL = ".partial"


def _fsspec() -> Any:
    try:
        import fsspec  # type: ignore[import-untyped]
    except ModuleNotFoundError as missing:
        raise extra_missing(missing) or missing from None
    return fsspec


def joined(place: str, *parts: str) -> str:
    """A place below another."""
    return "/".join((place.rstrip("/") or "/", *parts)) if "://" in place else os.path.join(place, *parts)


@contextmanager
def written(place: str, overwrite: bool) -> Iterator[Any]:
    """A binary file to write to; its folders are made.

    Raises:
        BagError: there is a file already, or no such file system. OSError: it cannot be written.
    """
    if "://" not in place:
        with _local(place, overwrite) as stream:
            yield stream
        return
    try:
        system, path = _fsspec().core.url_to_fs(place)
        if not overwrite and system.exists(path):
            raise BagError(f"{place} exists already")
        system.makedirs(path.rpartition("/")[0], exist_ok=True)
        stream = system.open(path, "wb")
    except (ImportError, ValueError) as error:  # no package for this protocol, no such protocol
        if isinstance(error, BagError):
            raise
        raise BagError(f"{place}: {error}") from None
    try:
        with stream:
            yield stream
    except BaseException:
        with suppress(Exception):  # what went wrong first is what counts
            system.rm(path)
        raise


@contextmanager
def _local(place: str, overwrite: bool) -> Iterator[Any]:
    if not overwrite and os.path.exists(place):
        raise BagError(f"{place} exists already")
    os.makedirs(os.path.dirname(place) or ".", exist_ok=True)
    partial = place + _PARTIAL
    try:
        with open(partial, "wb") as stream:
            yield stream
        os.replace(partial, place)
    except BaseException:
        with suppress(OSError):
            os.remove(partial)
        raise
