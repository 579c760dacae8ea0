"""Type descriptions kept on disk, by their RIHS01 hash, so that nobody has to be asked twice.

Decides the folder, and that a file appears whole or not at all. What is read may have been changed by anybody: who
reads it has to look at its hash again. A folder that cannot be used is no error; then nothing is kept.
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
"""Environment variable that names another folder; ``off`` keeps nothing."""
MAX_FILES = 2000
MAX_BYTES = 1 << 20
"""Of one description with its sources; those of the largest actions have some 50 KB."""
_SUFFIX = ".cdr"


def cache_home() -> Path | None:
    """The folder of all that is kept; None when nothing is to be kept."""
    chosen = os.environ.get(VARIABLE, "")
    if chosen:
        return None if chosen == "off" else Path(chosen)
    try:
        return _platform_folder() / "rosidl-py-gen"
    except RuntimeError:  # there is no home
        return None


def cache_folder() -> Path | None:
    """Where the descriptions are: the folder that was chosen, else one in ours; None when none are to be kept."""
    home = cache_home()
    return home if home is None or os.environ.get(VARIABLE) else home / "types"


def _platform_folder() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    told = os.environ.get("XDG_CACHE_HOME", "")
    return Path(told) if os.path.isabs(told) else Path.home() / ".cache"


def load_description(type_hash: str) -> bytes | None:
    """What was kept for a hash; None when there is nothing that can be read."""
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
    """Hash and data of everything that is kept and has these bytes in it, the newest first."""
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
    """Keep an encoded description; the oldest go when there are too many."""
    folder = cache_folder()
    if folder is None or len(data) > MAX_BYTES:
        return
    import tempfile  # takes longer to import than most of a node

    with suppress(OSError, ValueError):
        folder.mkdir(parents=True, exist_ok=True)
        evict_oldest(folder, _SUFFIX, MAX_FILES)
        handle, name = tempfile.mkstemp(dir=folder, prefix="new-")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            os.replace(name, folder / f"{type_hash}{_SUFFIX}")
        except BaseException:
            os.unlink(name)
            raise


def evict_oldest(folder: Path, suffix: str, most: int) -> None:
    """Remove the oldest files of a kind, so that one more is not too many."""
    with os.scandir(folder) as entries:
        aged = sorted((entry.stat().st_mtime_ns, entry.path) for entry in entries if entry.name.endswith(suffix))
    for _, path in aged[: max(0, len(aged) - most + 1)]:
        os.unlink(path)
