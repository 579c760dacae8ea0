"""`file(GLOB)` and `file(GLOB_RECURSE)` below a package folder.

Only names are read, links do not lead out of the package nor to folders below, and a pattern that could make matching
slow is not tried.
"""

from __future__ import annotations

import fnmatch
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.names import KINDS

if TYPE_CHECKING:
    from rosidl_py_gen.spec.cmake_values import Meter

_MAX_DEPTH = 12
_MAX_STARS = 4


def glob(folder: Path, pattern: str, deep: bool, meter: Meter) -> list[str] | None:
    """Files that match, relative to the folder; None when the pattern is not one to try.

    Args:
        folder: the package folder.
        pattern: relative to it, without ``..``.
        deep: the last part is matched in all folders below, as GLOB_RECURSE does.
        meter: is charged for every name looked at.
    """
    parts = pattern.split("/")
    if len(pattern) > 1000 or any(part.count("*") > _MAX_STARS for part in parts):
        return None
    *holders, last = parts
    folders = [""]
    for holder in holders:
        folders = [f"{start}{name}/" for start in folders for name in _matching(folder, start, holder, meter)]
    if deep:
        folders = [inner for start in folders for inner in _below(folder, start, meter)]
    found = (start + name for start in folders for name in _matching(folder, start, last, meter))
    return [path for path in found if os.path.isfile(folder / path)]


def _matching(folder: Path, start: str, pattern: str, meter: Meter) -> list[str]:
    """Names in a folder that match one part of a pattern."""
    if not any(char in pattern for char in "*?["):
        return [pattern] if os.path.lexists(folder / start / pattern) else []
    matches = re.compile(fnmatch.translate(pattern)).match
    return [name for name, _ in _names(folder, start, meter) if matches(name) and not name.startswith(".")]


def _below(folder: Path, start: str, meter: Meter) -> list[str]:
    """A folder and all below it."""
    found, waiting = [], [(start, 0)]
    while waiting:
        here, depth = waiting.pop()
        found.append(here)
        if depth < _MAX_DEPTH:
            waiting += [(f"{here}{name}/", depth + 1) for name, is_folder in _names(folder, here, meter) if is_folder]
    return found


def _names(folder: Path, start: str, meter: Meter) -> list[tuple[str, bool]]:
    """The names in a folder, and which are folders; none when it cannot be read or lies elsewhere."""
    try:
        real = os.path.realpath(folder / start)
        if start.rstrip("/") not in KINDS and not Path(real).is_relative_to(os.path.realpath(folder)):
            return []
        with os.scandir(real) as entries:
            found = sorted((entry.name, entry.is_dir(follow_symlinks=False)) for entry in entries)
    except OSError:
        return []
    meter.spend(500 + 50 * len(found))
    return found
