"""Disk cache of type descriptions by RIHS01 hash.

Files may have been modified, so a reader must check the hash. Without a usable folder, nothing is cached.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from rosidl_py_gen.type_loading.cache_files import VARIABLE, cache_home, store_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

MAX_FILES = 2000
MAX_BYTES = 1 << 20
"""Maximum size of a description with its sources; those of the largest actions have 50 kB."""
_SUFFIX = ".cdr"


def cache_folder() -> Path | None:
    """Return the folder of the descriptions; None if caches are disabled."""
    home = cache_home()
    return home if home is None or os.environ.get(VARIABLE) else home / "types"


def load_description(type_hash: str) -> bytes | None:
    """Return the cached description of a hash; None if there is none."""
    folder = cache_folder()
    if folder is None:
        return None
    try:
        with (folder / f"{type_hash}{_SUFFIX}").open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError):
        return None
    return data if len(data) <= MAX_BYTES else None


def cached_descriptions(containing: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield hash and data of the cached descriptions that contain some bytes, newest first."""
    folder = cache_folder()
    if folder is None:
        return
    try:
        with os.scandir(folder) as entries:
            aged = [(entry.stat().st_mtime_ns, entry.name) for entry in entries if entry.name.endswith(_SUFFIX)]
    except (OSError, ValueError):
        return
    for _, name in sorted(aged, reverse=True):
        type_hash = name.removesuffix(_SUFFIX)
        data = load_description(type_hash)
        if data is not None and containing in data:
            yield type_hash, data


def store_description(type_hash: str, data: bytes) -> None:
    """Store an encoded description, and remove the oldest descriptions if there are too many."""
    folder = cache_folder()
    if folder is not None and len(data) <= MAX_BYTES:
        store_file(folder / f"{type_hash}{_SUFFIX}", data, max_files=MAX_FILES)
