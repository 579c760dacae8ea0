"""Locks that processes of this machine share, so that test runs side by side keep out of each other's way."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

if sys.platform != "win32":
    import fcntl

_FOLDER = Path(tempfile.gettempdir())  # tests may select another


def lock(name: str, *, wait: bool) -> int | None:
    """Return a descriptor that holds the lock until it is closed or this process ends.

    Returns:
        None when it cannot be had, because another process has it (unless `wait`) or its file is another user's. On
        Windows everybody has it.
    """
    try:
        descriptor = os.open(_path(name), os.O_CREAT | os.O_RDWR)
    except PermissionError:
        return None
    if sys.platform != "win32":
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return None
    return descriptor


def holds(descriptor: int, name: str) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(_path(name)))
    except OSError:
        return False


def _path(name: str) -> Path:
    return _FOLDER / f"rosidl-py-gen-tests-{name}.lock"
