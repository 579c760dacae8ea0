"""Folder of all caches, and files in it that are written completely or not at all."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path

VARIABLE = "ROSIDL_PY_GEN_CACHE"
"""Environment variable with another folder; ``off`` disables all caches."""


def cache_home() -> Path | None:
    """Return the folder of all caches; None if caches are disabled."""
    chosen = os.environ.get(VARIABLE, "")
    if chosen:
        return None if chosen == "off" else Path(chosen)
    try:
        return _platform_folder() / "rosidl-py-gen"
    except RuntimeError:  # there is no home directory
        return None


def _platform_folder() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    cache = os.environ.get("XDG_CACHE_HOME", "")
    return Path(cache) if os.path.isabs(cache) else Path.home() / ".cache"


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
