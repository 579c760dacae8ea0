"""Which interface packages there are, and which files belong to them.

Folders called msg, srv or action that hold other files only make no package: those of Python packages, what this tool
generates among them, and of C++ headers. Virtual environments and CMake's build folders are not looked into.

First hit wins: the folders the caller names, then every prefix of AMENT_PREFIX_PATH, then packages that were installed
as wheels of `distribution`, then the bundled interfaces.
Reads directory entries and package.xml names; interface files themselves, and the CMakeLists.txt that says which files
a source package consists of, are opened later, and only when needed.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import KINDS, PACKAGE_RULE, RosName, is_package_name
from rosidl_py_gen.base.resources import ENTRY_POINTS, interfaces_dir
from rosidl_py_gen.compiler.frontend.files import BUILD_TREE_MARKERS, IGNORE_MARKS, mentions_interfaces
from rosidl_py_gen.errors import DefinitionError, Diagnostic

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.compiler.frontend.cmake_interfaces import CMakeInterfaceList

_NAME_TAG = re.compile(r"<name>\s*([^<>]*?)\s*</name>")
_SUFFIXES = (".idl", *(f".{kind}" for kind in KINDS))
INSTALLED = "installed"
"""The origin of packages that were installed by pip."""
MAX_DEPTH = 12
_MAX_XML_BYTES = 1 << 20


@dataclass(frozen=True)
class Package:
    """A folder with interface files.

    Attributes:
        name: the package name.
        folder: holds ``msg``, ``srv``, ``action``.
        origin: the search path entry it was found through, as shown to the user.
        from_source: the folder has a package.xml and may have a CMakeLists.txt that lists the files.
    """

    name: str
    folder: Path
    origin: str
    from_source: bool = False

    @cached_property
    def listing(self) -> CMakeInterfaceList | None:
        """What the package's CMakeLists.txt lists; None for packages that are installed or have no such list."""
        if not self.from_source or not mentions_interfaces(self.folder):
            return None
        from rosidl_py_gen.compiler.frontend.cmake_interfaces import (
            CMakeInterfaceList,  # installed packages need none of CMake
        )

        return CMakeInterfaceList(self.name, self.folder)

    @cached_property
    def files(self) -> dict[RosName, Path]:
        """Every interface file, by name and in name order."""
        listing = self.listing
        if listing is None:
            return self._in_folders()
        return dict(sorted(listing.files.items()))

    def not_in_cmake_note(self, name: RosName) -> str:
        """A note for who misses a name whose file is there, but not listed; empty when that is not so."""
        file = None if name in self.files else self._in_folders().get(name)
        return f"; {name.kind}/{file.name} is there, but CMakeLists.txt does not list it" if file else ""

    def _in_folders(self) -> dict[RosName, Path]:
        """The files in msg, srv and action; a .msg/.srv/.action hides an .idl of the same stem."""
        found: dict[RosName, Path] = {}
        for kind in KINDS:
            for entry in _entries(self.folder / kind):
                stem, suffix = os.path.splitext(entry.name)
                if suffix in (".idl", "." + kind) and os.path.isfile(entry.path):
                    name = RosName(self.name, kind, stem)
                    if suffix != ".idl" or name not in found:
                        found[name] = Path(entry.path)
        return dict(sorted(found.items()))


@dataclass(frozen=True)
class SearchPath:
    """Where interfaces are looked for.

    Attributes:
        packages: by name, in name order; each from the first entry that has it.
        hidden: packages of the same name found later, for `--list`.
        searched: the entries, as shown in errors.
        refused: packages whose name is not legal, by that name; an error only for who asks for them.
    """

    packages: dict[str, Package]
    hidden: list[Package] = field(default_factory=list)
    searched: list[str] = field(default_factory=list)
    refused: dict[str, Diagnostic] = field(default_factory=dict)

    def file(self, name: RosName) -> Path | None:
        package = self.packages.get(name.package)
        return package.files.get(name) if package else None


def scan_search_path(
    folders: Sequence[str | os.PathLike[str]] = (), ament: str | None = None, bundled: bool = True
) -> SearchPath:
    """Look through the given folders, the ament prefixes and the bundled interfaces.

    Args:
        folders: package folders, folders of packages or colcon workspaces' `src`.
        ament: prefixes joined by the path separator; None reads AMENT_PREFIX_PATH.
        bundled: whether the interfaces shipped with this package come last.

    Raises:
        DefinitionError: a folder does not exist, cannot be read, holds no package, or holds two of one name.
    """
    found = SearchPath({})
    for folder in folders:
        _add(found, str(folder), _packages_below(Path(folder), found.refused))
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "") if ament is None else ament
    for prefix in filter(None, prefixes.split(os.pathsep)):
        share = Path(prefix) / "share"
        holders = (Path(entry.path) for entry in _entries(share) if holds_interfaces(Path(entry.path)))
        _add(found, prefix, (Package(path.name, path, prefix) for path in holders if is_package_name(path.name)))
    if bundled:
        if installed := [*_installed()]:
            _add(found, INSTALLED, installed)
        holders = (Path(entry.path) for entry in _entries(interfaces_dir()))
        _add(found, "bundled", (Package(path.name, path, "bundled") for path in holders if holds_interfaces(path)))
    return SearchPath(dict(sorted(found.packages.items())), found.hidden, found.searched, found.refused)


def holds_packages(folder: Path) -> bool:
    """Whether there is a package with interfaces in a folder; errors as of `scan_search_path`."""
    found: list[Package] = []
    refused: dict[str, Diagnostic] = {}
    _descend(folder, str(folder), found, refused, set(), 0)
    return bool(found or refused)


def preload() -> None:
    """Import the module that finds installed packages, to save time in the first search."""
    from importlib import metadata  # noqa: F401


def _installed() -> Iterator[Package]:
    """Packages whose wheels say where they are; nothing of them is imported."""
    from importlib.metadata import entry_points  # takes a while, and is needed where something is not bundled

    for one in sorted({(entry.name, entry.value) for entry in entry_points(group=ENTRY_POINTS)}):
        name, module = one
        try:
            spec = find_spec(module.partition(".")[0])
        except (ImportError, ValueError):
            continue
        if spec is not None and spec.origin and is_package_name(name):
            folder = Path(spec.origin).parent
            if holds_interfaces(folder):
                yield Package(name, folder, INSTALLED)


def _add(found: SearchPath, origin: str, packages: Iterable[Package]) -> None:
    found.searched.append(origin)
    for package in packages:
        first = found.packages.setdefault(package.name, package)
        if first is not package:
            if first.origin == package.origin:
                text = (
                    f'two packages are called "{package.name}": {first.folder} and {package.folder}; give one folder '
                    "as --path, or put an empty file COLCON_IGNORE into the other"
                )
                raise DefinitionError(Diagnostic(origin, 0, 0, text))
            found.hidden.append(package)


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    """Directory entries by name; none when there is no such folder.

    Raises:
        DefinitionError: the folder is there and cannot be read; taking it for empty would lose definitions.
    """
    try:
        with os.scandir(folder) as entries:
            return sorted(entries, key=lambda entry: entry.name)
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        text = f"the folder cannot be read: {error.strerror or error}"
        raise DefinitionError(Diagnostic(str(folder), 0, 0, text)) from error


def holds_interfaces(folder: Path) -> bool:
    """Return True if there is a folder for interfaces: with one in it, or empty, because the last one was removed."""
    return any(_is_for_interfaces(folder / kind) for kind in KINDS)


def _is_for_interfaces(folder: Path) -> bool:
    try:
        with os.scandir(folder) as entries:
            first = next(entries, None)
            return (
                first is None or first.name.endswith(_SUFFIXES) or any(one.name.endswith(_SUFFIXES) for one in entries)
            )
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:  # whoever reads it says why it cannot be read
        return True


def _groups_packages(folder: Path) -> bool:
    """Whether folders called msg, srv or action hold packages instead of interface files."""
    inside = [Path(entry.path) for kind in KINDS for entry in _entries(folder / kind)]
    return any(os.path.isfile(path / "package.xml") for path in inside)


def _packages_below(root: Path, refused: dict[str, Diagnostic]) -> list[Package]:
    if not root.is_dir():
        raise DefinitionError(Diagnostic(str(root), 0, 0, "expected a folder with interface packages, found none"))
    found: list[Package] = []
    _descend(root, str(root), found, refused, set(), 0)
    if not found and not refused:
        text = "expected a package with definitions (in a folder msg, srv or action), found none in this folder"
        raise DefinitionError(Diagnostic(str(root), 0, 0, text))
    return found


def _descend(
    folder: Path, origin: str, found: list[Package], refused: dict[str, Diagnostic], visited: set[str], depth: int
) -> None:
    real = os.path.realpath(folder)  # links may form loops
    if real in visited or depth > MAX_DEPTH or any(os.path.exists(folder / mark) for mark in IGNORE_MARKS):
        return
    if depth and any(os.path.isfile(folder / mark) for mark in BUILD_TREE_MARKERS):
        return
    visited.add(real)
    manifest = folder / "package.xml"
    is_package = os.path.isfile(manifest)
    if is_package or (holds_interfaces(folder) and not _groups_packages(folder)):
        holds = holds_interfaces(folder)
        if holds or mentions_interfaces(folder):
            name = package_name(manifest, folder)
            package = Package(name, folder, origin, is_package)
            if not holds and not (package.listing and package.listing.files):
                return
            if is_package_name(name):
                found.append(package)
            else:
                shown = str(manifest if is_package else folder)
                refused[name] = Diagnostic(shown, 0, 0, f'"{name[:80]}" is not a legal package name; {PACKAGE_RULE}')
        return
    for entry in _entries(folder):
        # Not entry.is_dir(): that raises for a link to itself.
        if os.path.isdir(entry.path) and not entry.name.startswith(".") and os.access(entry.path, os.R_OK | os.X_OK):
            _descend(Path(entry.path), origin, found, refused, visited, depth + 1)


def package_name(manifest: Path, folder: Path) -> str:
    """What package.xml calls the package, else the folder's name."""
    try:
        with manifest.open("rb") as file:
            text = file.read(_MAX_XML_BYTES).decode(errors="replace")
    except (FileNotFoundError, IsADirectoryError):
        text = ""
    except OSError as error:
        raise DefinitionError(Diagnostic(str(manifest), 0, 0, f"cannot be read: {error.strerror or error}")) from error
    tag = _NAME_TAG.search(re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL))
    return tag[1] if tag else Path(os.path.realpath(folder)).name
