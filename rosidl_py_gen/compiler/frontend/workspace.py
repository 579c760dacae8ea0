"""The workspace a script is in, and the packages in it: all that have a package.xml, with interfaces or without.

Nothing is built and nothing is run: names of folders and package.xml files are read, no more.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from rosidl_py_gen.compiler.frontend.files import BUILD_TREE_MARKERS, IGNORE_MARKS
from rosidl_py_gen.compiler.frontend.search_path import MAX_DEPTH, package_name

MANIFEST = "package.xml"
_DEPTH_OF_FOLDERS = 3
"""How far down packages are looked for in a folder that nothing says is a workspace."""


@dataclass(frozen=True)
class Workspace:
    """A folder with packages.

    Attributes:
        folder: the folder ``src``, or the one around a package that is in no ``src``.
        depth: how far down packages are looked for.
        own: a package that counts before others of its name.
    """

    folder: Path
    depth: int = MAX_DEPTH
    own: Path | None = None

    @cached_property
    def packages(self) -> dict[str, Path]:
        """The folder of each package by its name; of two with one name the first on the way down."""
        found = {} if self.own is None else {package_name(self.own / MANIFEST, self.own): self.own}
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
                found.setdefault(package_name(folder / MANIFEST, folder), folder)
            elif depth < self.depth:
                inside = (folder / name for name in sorted(names) if not name.startswith("."))
                waiting += [(path, depth + 1) for path in inside if os.path.isdir(path)]
        return found

    @property
    def roots(self) -> list[Path]:
        """Folders that hold all packages: `folder`, unless that has much besides them."""
        return [self.folder] if self.depth == MAX_DEPTH else [*self.packages.values()]


def package_around(place: Path) -> Path | None:
    """The package that a file or folder belongs to: the first folder from there upwards with a package.xml."""
    above = [place, *place.parents] if place.is_dir() else [*place.parents]
    return next((folder for folder in above if os.path.isfile(folder / MANIFEST)), None)


def workspace_around(place: Path) -> Workspace | None:
    """The workspace of a file or a folder.

    Args:
        place: a script or a folder in a package; or a folder around packages, such as ``src`` or the one above that.

    Returns:
        The folder ``src`` above the package, or else the package and those beside it; for a folder that is in no
        package its ``src``, or else the folder itself. None for a script that is in no package.
    """
    package = package_around(place)
    if package is not None:
        source = next((folder for folder in package.parents if folder.name == "src"), None)
        return Workspace(package.parent, 1, package) if source is None else Workspace(source)
    if not place.is_dir():
        return None
    if place.name == "src":
        return Workspace(place)
    source = place / "src"
    return Workspace(source) if source.is_dir() else Workspace(place, _DEPTH_OF_FOLDERS)


def _names(folder: Path) -> set[str]:
    try:
        return set(os.listdir(folder))
    except OSError:  # a folder of somebody else is no part of the workspace
        return set()
