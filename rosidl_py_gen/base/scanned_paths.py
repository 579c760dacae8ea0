"""Files and folders that a search has read, so that its result can be cached until one of them changes."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

Stamp = tuple[int, ...] | None
"""Times of change in ns, inode, and size of a file or folder; None if it does not exist."""


class _Recording(threading.local):
    stamps: dict[str, Stamp] | None = None


_recording = _Recording()


def stamp(path: str) -> Stamp:
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_ctime_ns, found.st_ino, found.st_size


def note(path: str | os.PathLike[str]) -> None:
    """Record a file or folder, which may be missing, before it is read."""
    stamps = _recording.stamps
    if stamps is not None and (text := os.path.abspath(path)) not in stamps:
        stamps[text] = stamp(text)


@contextmanager
def recorded() -> Iterator[dict[str, Stamp]]:
    """Return the stamps of all paths that this thread notes in the block; blocks must not be nested."""
    stamps: dict[str, Stamp] = {}
    _recording.stamps = stamps
    try:
        yield stamps
    finally:
        _recording.stamps = None
