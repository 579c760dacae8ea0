"""Disk cache of type descriptions by RIHS01 hash.

Files are written completely or not at all. They may have been modified, so a reader must check the hash. Without a
usable folder, nothing is cached.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

VARIABLE = "ROSIDL_PY_GEN_CACHE"
"""Environment variable with another folder; ``off`` disables all caches."""
MAX_FILES = 2000
MAX_BYTES = 1 << 20
"""Maximum size of a description with its sources; those of the largest actions have 50 kB."""
_SUFFIX = ".cdr"


def cache_home() -> Path | None:
    """Return the folder of all caches; None if caches are disabled."""
    chosen = os.environ.get(VARIABLE, "")
    if chosen:
        return None if chosen == "off" else Path(chosen)
    try:
        return _platform_folder() / "rosidl-py-gen"
    except RuntimeError:  # there is no home directory
        return None


def cache_folder() -> Path | None:
    """Return the folder of the descriptions; None if caches are disabled."""
    home = cache_home()
    return home if home is None or os.environ.get(VARIABLE) else home / "types"


def _platform_folder() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    cache = os.environ.get("XDG_CACHE_HOME", "")
    return Path(cache) if os.path.isabs(cache) else Path.home() / ".cache"


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


def store_file(file: Path, data: bytes, *, max_files: int) -> None:
    """Write a file that only the user can read, and remove the oldest files of its suffix; ignores errors."""
    import tempfile  # slow to import

    with suppress(OSError, ValueError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with os.scandir(file.parent) as entries:
            aged = sorted(
                (entry.stat().st_mtime_ns, entry.path) for entry in entries if entry.name.endswith(file.suffix)
            )
        for _, path in aged[: max(0, len(aged) - max_files + 1)]:
            os.unlink(path)
        handle, name = tempfile.mkstemp(dir=file.parent, prefix="new-")
        try:
            with os.fdopen(handle, "wb") as opened:
                opened.write(data)
            os.replace(name, file)
        except BaseException:
            os.unlink(name)
            raise
