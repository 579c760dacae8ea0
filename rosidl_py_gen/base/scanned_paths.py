"""Recorder of the files and folders that a search reads. The search's result can be cached until one of
them changes.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any

Stamp = tuple[int, ...] | None
"""State of a file or folder: times of change in ns, inode, and size; None if it does not exist."""
_stamps = ContextVar[dict[str, Stamp] | None]("stamps", default=None)


def stamp(path: str) -> Stamp:
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_ctime_ns, found.st_ino, found.st_size


def note(path: str | os.PathLike[str]) -> None:
    """Record the state of a file or folder, which may be missing, for a call of `recorded` that is running in this
    thread.

    Must be called before the file or folder is read.
    """
    stamps = _stamps.get()
    if stamps is not None and (text := os.path.abspath(path)) not in stamps:
        stamps[text] = stamp(text)


def recorded(search: Callable[[], Any]) -> tuple[dict[str, Stamp], Any]:
    """Run a search.

    Returns the states of all paths that the search has passed to `note` in this thread, and the search's result.
    """
    stamps: dict[str, Stamp] = {}
    token = _stamps.set(stamps)
    try:
        return stamps, search()
    finally:
        _stamps.reset(token)
