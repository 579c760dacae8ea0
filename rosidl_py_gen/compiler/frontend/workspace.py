"""Colcon workspace around a script or folder: all packages in it that have a package.xml.

The search reads only names of folders and package.xml files.
"""

from __future__ import annotations

import os
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from rosidl_py_gen.base.scanned_paths import note
from rosidl_py_gen.compiler.frontend.package_files import BUILD_TREE_MARKERS, IGNORE_MARKS
from rosidl_py_gen.compiler.frontend.search_path import package_name
from rosidl_py_gen.errors import display_path

MANIFEST = "package.xml"
MAX_ENTRIES = 50_000
"""Maximum number of directory entries that the search for a workspace's packages reads, which takes half a second.
colcon has no limit, but a home folder or ``/`` may be searched. The search is breadth first."""


@dataclass(frozen=True)
class Workspace:
    """Folder with packages, as colcon searches it.

    Attributes:
        folder: the folder ``src``, or the parent of a package that is not below ``src``.
        depth: maximum depth of packages below `folder`; None for any depth, as colcon searches.
        own: folder of a package that is preferred to other packages of its name.
        holds_others: `folder` probably contains much besides packages.
    """

    folder: Path
    depth: int | None = None
    own: Path | None = None
    holds_others: bool = False

    @cached_property
    def packages(self) -> dict[str, Path]:
        """Folders of the workspace's packages by name; of two packages with one name, the less deep one."""
        found: dict[str, Path] = {}
        for name, folder in self.all_packages:
            found.setdefault(name, folder)
        return found

    @property
    def all_packages(self) -> list[tuple[str, Path]]:
        """Names and folders of all packages in the workspace; several packages may have one name."""
        return self._found[0]

    @property
    def limit_text(self) -> str:
        """Message about a search of the workspace that stopped at `MAX_ENTRIES`; "" if the search was complete."""
        if self._found[1]:
            return ""
        text = f"{display_path(self.folder)}: searched for packages only in the first {MAX_ENTRIES} files and folders"
        return f"{text}; pass a smaller folder with --path, or put COLCON_IGNORE into folders without packages"

    @cached_property
    def _found(self) -> tuple[list[tuple[str, Path]], bool]:
        """Names and folders of the packages in the workspace, and True if the search read all folders."""
        found = [] if self.own is None else [(package_name(self.own / MANIFEST, self.own), self.own)]
        visited: set[str] = set()
        waiting = deque([(self.folder, 0)])
        left = MAX_ENTRIES
        while waiting:
            folder, depth = waiting.popleft()
            real = os.path.realpath(folder)  # links may form loops
            if real in visited:
                continue
            visited.add(real)
            entries = _entries(folder)
            names = {entry.name for entry in entries}
            left -= len(entries)
            if left < 0:
                return found, False
            is_copy = depth > 0 and not names.isdisjoint(BUILD_TREE_MARKERS)
            if is_copy or not names.isdisjoint(IGNORE_MARKS):
                continue
            if MANIFEST in names:
                found.append((package_name(folder / MANIFEST, folder), folder))
            elif self.depth is None or depth < self.depth:
                for entry in entries:
                    if entry.name.startswith("."):
                        continue
                    if _is_folder(entry):
                        waiting.append((folder / entry.name, depth + 1))
                    elif entry.is_symlink():
                        note(entry.path)
        return found, True

    @property
    def roots(self) -> list[Path]:
        """Folders that contain all packages: the workspace folder, or each package if the folder contains much else."""
        return [*self.packages.values()] if self.holds_others or self.depth is not None else [self.folder]


def package_around(place: Path) -> Path | None:
    """Return the folder of the package that contains a file or folder: the nearest folder with a package.xml.

    Returns None without such a folder.
    """
    above = [place, *place.parents] if place.is_dir() else [*place.parents]
    return next((folder for folder in above if os.path.isfile(folder / MANIFEST)), None)


def workspace_around(place: Path) -> Workspace | None:
    """Return the workspace that contains a file or a folder; None for a script outside of packages.

    The workspace is the folder ``src`` that contains the package, else the package and its siblings. For a folder
    outside of packages, the workspace is its subfolder ``src``, else the folder itself.
    """
    package = package_around(place)
    if package is not None:
        source = next((folder for folder in package.parents if folder.name == "src"), None)
        return Workspace(package.parent, 1, package) if source is None else Workspace(source)
    if not place.is_dir():
        return None
    source = place if place.name == "src" else place / "src"
    return Workspace(source) if source.is_dir() else Workspace(place, holds_others=True)


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    """Return the entries of a folder, sorted by name; [] for an unreadable folder, which is skipped."""
    note(folder)
    with suppress(OSError), os.scandir(folder) as entries:
        return sorted(entries, key=lambda entry: entry.name)
    return []


def _is_folder(entry: os.DirEntry[str]) -> bool:
    with suppress(OSError):  # a link to itself
        return entry.is_dir()
    return False
