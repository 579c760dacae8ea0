"""The colcon workspace of a script, with all its packages that have a package.xml.

Only names of folders and package.xml files are read.
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from rosidl_py_gen.base.scanned_paths import note
from rosidl_py_gen.compiler.frontend.package_files import BUILD_TREE_MARKERS, IGNORE_MARKS
from rosidl_py_gen.compiler.frontend.search_path import MAX_DEPTH, package_name

MANIFEST = "package.xml"
_MAX_DEPTH_OUTSIDE = 3
"""Maximum depth of packages in a folder that has no ``src``."""


@dataclass(frozen=True)
class Workspace:
    """A folder with packages.

    Attributes:
        folder: the folder ``src``, or the parent of a package that is not below ``src``.
        depth: maximum depth of packages below `folder`.
        own: a package that is preferred to others of its name.
    """

    folder: Path
    depth: int = MAX_DEPTH
    own: Path | None = None

    @cached_property
    def packages(self) -> dict[str, Path]:
        """Folders of the packages by name; of two with one name, the one of least depth."""
        found: dict[str, Path] = {}
        for name, folder in self.all_packages:
            found.setdefault(name, folder)
        return found

    @cached_property
    def all_packages(self) -> list[tuple[str, Path]]:
        """Names and folders of all packages; several may have one name."""
        found = [] if self.own is None else [(package_name(self.own / MANIFEST, self.own), self.own)]
        visited: set[str] = set()
        waiting = [(self.folder, 0)]
        while waiting:
            folder, depth = waiting.pop(0)
            real = os.path.realpath(folder)  # links may form loops
            names = _names(folder)
            is_copy = depth > 0 and not names.isdisjoint(BUILD_TREE_MARKERS)
            if real in visited or is_copy or not names.isdisjoint(IGNORE_MARKS):
                continue
            visited.add(real)
            if MANIFEST in names:
                found.append((package_name(folder / MANIFEST, folder), folder))
            elif depth < self.depth:
                inside = [folder / name for name in sorted(names) if not name.startswith(".")]
                for path in inside:
                    if os.path.isdir(path):
                        waiting.append((path, depth + 1))
                    elif os.path.islink(path):
                        note(path)
        return found

    @property
    def roots(self) -> list[Path]:
        """Folders that contain all packages: `folder`, unless it probably contains much else."""
        return [self.folder] if self.depth == MAX_DEPTH else [*self.packages.values()]


def package_around(place: Path) -> Path | None:
    """Return the package of a file or folder: the first folder upwards with a package.xml; None without one."""
    above = [place, *place.parents] if place.is_dir() else [*place.parents]
    return next((folder for folder in above if os.path.isfile(folder / MANIFEST)), None)


def workspace_around(place: Path) -> Workspace | None:
    """Return the workspace of a file or a folder; None for a script outside of packages.

    It is the folder ``src`` above the package, else the package and its siblings; for a folder outside of packages its
    ``src``, else the folder itself.
    """
    package = package_around(place)
    if package is not None:
        source = next((folder for folder in package.parents if folder.name == "src"), None)
        return Workspace(package.parent, 1, package) if source is None else Workspace(source)
    if not place.is_dir():
        return None
    source = place if place.name == "src" else place / "src"
    return Workspace(source) if source.is_dir() else Workspace(place, _MAX_DEPTH_OUTSIDE)


def _names(folder: Path) -> set[str]:
    note(folder)
    with suppress(OSError):  # an unreadable folder is not part of the workspace
        return set(os.listdir(folder))
    return set()
