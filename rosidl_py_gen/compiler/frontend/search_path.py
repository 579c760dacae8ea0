"""Search for interface packages and their files.

Of packages with the same name, the first is used: from the folders of the caller, the prefixes of AMENT_PREFIX_PATH,
wheels of message packages, and the bundled interfaces of a distribution. If the distribution was selected explicitly,
its bundled interfaces follow directly after the folders of the caller.

The search reads only directory entries and names in package.xml; interface files and CMakeLists.txt are opened later. A
folder msg, srv or action without interface files is not a package: Python packages and C++ headers have such folders.
Virtual environments and build folders of CMake are skipped.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, field
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.base.distributions import DEFAULT, selected
from rosidl_py_gen.base.generated_classes import ROS_PACKAGE_INDEX, has_installed_ros_packages
from rosidl_py_gen.base.names import KINDS, PACKAGE_RULE, RosName, is_package_name
from rosidl_py_gen.base.resources import ENTRY_POINTS
from rosidl_py_gen.base.scanned_paths import note
from rosidl_py_gen.compiler.frontend.bundled import bundled_packages
from rosidl_py_gen.compiler.frontend.package_files import BUILD_TREE_MARKERS, IGNORE_MARKS, mentions_interfaces
from rosidl_py_gen.compiler.frontend.package_manifest import read_package_manifest
from rosidl_py_gen.errors import DefinitionError, Diagnostic

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.compiler.frontend.cmake_interfaces import CMakeInterfaceList

_SUFFIXES = (".idl", *(f".{kind}" for kind in KINDS))
INSTALLED = "installed"
"""Value of `Package.origin` for packages that pip installed."""
BUNDLED = "bundled"
"""Value of `Package.origin` for packages bundled with the product."""
_MAX_DEPTH = 100
"""Maximum depth of folders that are searched for packages; deeper folders would exceed Python's limit of recursion, and
no workspace has them."""
_MAX_XML_BYTES = 1 << 20


@dataclass(frozen=True)
class Package:
    """Interface package on the search path.

    Attributes:
        origin: the search path entry that contains the package, for display.
        from_source: the folder has a package.xml and may have a CMakeLists.txt that lists the files.
    """

    name: str
    folder: Path
    origin: str
    from_source: bool = False
    known_files: dict[RosName, Path] | None = None
    """Interface files of the package, if they are not exactly the files of `folder`; None means the files of `folder`.
    """

    @cached_property
    def listing(self) -> CMakeInterfaceList | None:
        """Interface files that the package's CMakeLists.txt lists; None without such a list or if installed."""
        if not self.from_source or not mentions_interfaces(self.folder):
            return None
        # Not needed for installed packages.
        from rosidl_py_gen.compiler.frontend.cmake_interfaces import CMakeInterfaceList

        return CMakeInterfaceList(self.name, self.folder)

    @cached_property
    def files(self) -> dict[RosName, Path]:
        """Interface files of the package, in the order of their names."""
        if self.known_files is not None:
            return self.known_files
        return self._in_folders() if self.listing is None else self.listing.files

    def not_in_cmake_note(self, name: RosName) -> str:
        """Return an error note if the interface's file exists but CMakeLists.txt does not list it; else ""."""
        file = None if self.listing is None or name in self.files else self._in_folders().get(name)
        return f"; {name.kind}/{file.name} is there, but CMakeLists.txt does not list it" if file else ""

    def _in_folders(self) -> dict[RosName, Path]:
        """Return the interface files in the package's msg, srv and action folders.

        A .msg, .srv or .action file replaces an .idl file of its name.
        """
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
    """Interface packages that a search has found.

    Attributes:
        packages: packages by name, in name order.
        hidden: packages whose name an earlier entry of the search path has, too.
        searched: entries of the search path, for errors.
        refused: diagnostics of packages with an invalid name; an error only if such a package is requested.
    """

    packages: dict[str, Package]
    hidden: list[Package] = field(default_factory=list)
    searched: list[str] = field(default_factory=list)
    refused: dict[str, Diagnostic] = field(default_factory=dict)

    def file(self, name: RosName) -> Path | None:
        package = self.packages.get(name.package)
        return package.files.get(name) if package else None


def scan_search_path(
    folders: Sequence[str | os.PathLike[str]] = (),
    ament: str | None = None,
    bundled: bool = True,
    distro: str | None = None,
) -> SearchPath:
    """Return the packages in folders, ament prefixes, installed wheels and the bundled interfaces.

    Args:
        folders: folders of packages, of one package, or ``src`` of colcon workspaces.
        ament: prefixes joined by the path separator; None reads AMENT_PREFIX_PATH.
        bundled: search installed wheels and the bundled interfaces, too.
        distro: distribution of the bundled interfaces, which then precede ament prefixes and wheels; None uses the
            selection of the command or of ROS_DISTRO.

    Raises:
        DefinitionError: a folder does not exist, cannot be read, or contains no package or two of one name.
        UnknownDistributionError: the definitions of `distro` are not bundled.
    """
    found = SearchPath({})
    for folder in folders:
        _add(found, str(folder), _packages_below(Path(folder), found.refused))
    choice = selected(distro) if bundled else None
    if choice is not None and choice.is_explicit:
        _add_bundled(found, choice.name)
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "") if ament is None else ament
    for prefix in filter(None, prefixes.split(os.pathsep)):
        share = Path(prefix) / "share"
        holders = (Path(entry.path) for entry in _entries(share) if holds_interfaces(Path(entry.path)))
        _add(found, prefix, (Package(path.name, path, prefix) for path in holders if is_package_name(path.name)))
    if choice is not None:
        if installed := [*_installed()]:
            _add(found, INSTALLED, installed)
        if not choice.is_explicit:
            _add_bundled(found, choice.name)
    return SearchPath(dict(sorted(found.packages.items())), found.hidden, found.searched, found.refused)


def holds_packages(folder: Path) -> bool:
    """Return True if a folder contains a package with interfaces.

    Raises:
        DefinitionError: a folder or package.xml cannot be read.
    """
    refused: dict[str, Diagnostic] = {}
    return bool([*_descend(folder, str(folder), refused, set())] or refused)


def _add_bundled(found: SearchPath, distro: str) -> None:
    packages = (
        Package(name, one.folder, BUNDLED, known_files=one.files) for name, one in bundled_packages(distro).items()
    )
    _add(found, BUNDLED if distro == DEFAULT else f"{BUNDLED} ({distro})", packages)


def _installed() -> Iterator[Package]:
    """Yield the interface packages that pip installed: wheels with entry points, then ROS packages of the prefix.

    ROS packages install into ``share`` of the prefix. Only packages of the ament index are read: ``share`` of a system
    has thousands of other folders, and ROS 1 packages.
    """
    names: set[str] = set()
    for package in _installed_by_entry_points():
        names.add(package.name)
        yield package
    note(os.path.join(sys.prefix, ROS_PACKAGE_INDEX))
    if has_installed_ros_packages():
        for entry in _entries(Path(sys.prefix, ROS_PACKAGE_INDEX)):
            folder = Path(sys.prefix, "share", entry.name)
            if entry.name not in names and is_package_name(entry.name) and holds_interfaces(folder):
                yield Package(entry.name, folder, INSTALLED)


def _installed_by_entry_points() -> Iterator[Package]:
    from importlib.metadata import entry_points  # slow to import

    for name, module in sorted({(entry.name, entry.value) for entry in entry_points(group=ENTRY_POINTS)}):
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
        if first is package or os.path.realpath(first.folder) == os.path.realpath(package.folder):
            continue  # a folder may be given twice
        if first.origin == package.origin:
            text = (
                f'two packages are called "{package.name}": {first.folder} and {package.folder}; give one folder '
                "as --path, or put an empty file COLCON_IGNORE into the other"
            )
            raise DefinitionError(Diagnostic(origin, 0, 0, text))
        found.hidden.append(package)


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    """Return the directory entries of a folder, sorted by name; [] if the folder does not exist.

    Raises `DefinitionError` for a folder that cannot be read: if the folder were ignored, definitions would be lost.
    """
    note(folder)
    try:
        with os.scandir(folder) as entries:
            return sorted(entries, key=lambda entry: entry.name)
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        text = f"the folder cannot be read: {error.strerror or error}"
        raise DefinitionError(Diagnostic(str(folder), 0, 0, text)) from error


def holds_interfaces(folder: Path) -> bool:
    """Return True if a folder has a msg, srv or action folder that contains interfaces or is empty.

    An empty folder counts because its last interface may have been removed.
    """
    return any(_is_for_interfaces(folder / kind) for kind in KINDS)


def _is_for_interfaces(folder: Path) -> bool:
    note(folder)
    try:
        with os.scandir(folder) as entries:
            names = [entry.name for entry in entries]
            return not names or any(name.endswith(_SUFFIXES) for name in names)
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:  # reported when it is read
        return True


def _groups_packages(folder: Path) -> bool:
    inside = [Path(entry.path) for kind in KINDS for entry in _entries(folder / kind)]
    for path in inside:
        note(path / "package.xml")
    return any(os.path.isfile(path / "package.xml") for path in inside)


def _packages_below(root: Path, refused: dict[str, Diagnostic]) -> list[Package]:
    if not root.is_dir():
        raise DefinitionError(Diagnostic(str(root), 0, 0, "expected a folder with interface packages, found none"))
    packages = [*_descend(root, str(root), refused, set())]
    if not packages and not refused:
        text = "expected a package with definitions (in a folder msg, srv or action), found none in this folder"
        raise DefinitionError(Diagnostic(str(root), 0, 0, text))
    return packages


def _descend(
    folder: Path, origin: str, refused: dict[str, Diagnostic], visited: set[str], depth: int = 0
) -> Iterator[Package]:
    note(folder)
    real = os.path.realpath(folder)  # links may form loops
    if real in visited or depth > _MAX_DEPTH or any(os.path.exists(folder / mark) for mark in IGNORE_MARKS):
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
                yield package
            else:
                place = str(manifest if is_package else folder)
                refused[name] = Diagnostic(place, 0, 0, f'"{name[:80]}" is not a legal package name; {PACKAGE_RULE}')
        return
    for entry in _entries(folder):
        is_folder = os.path.isdir(entry.path)  # entry.is_dir() raises for a link to itself
        if is_folder and not entry.name.startswith(".") and os.access(entry.path, os.R_OK | os.X_OK):
            yield from _descend(Path(entry.path), origin, refused, visited, depth + 1)
        elif not entry.name.startswith(".") and (is_folder or entry.is_symlink()):
            note(entry.path)


def package_name(manifest: Path, folder: Path) -> str:
    """Return the name of a package as its package.xml states it, else the name of the folder.

    Raises `DefinitionError` if the file cannot be read.
    """
    note(manifest)
    text = ""
    try:
        if manifest.is_file():  # opening a pipe would wait for its writer
            with manifest.open("rb") as file:
                text = file.read(_MAX_XML_BYTES).decode(errors="replace")
    except OSError as error:
        raise DefinitionError(Diagnostic(str(manifest), 0, 0, f"cannot be read: {error.strerror or error}")) from error
    return read_package_manifest(text).name or Path(os.path.realpath(folder)).name
