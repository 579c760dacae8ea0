"""Search for packages: interface packages of a search path, packages of a workspace, and texts for missing ones.

Of packages with the same name, the first is used: from the folders of the caller, the prefixes of AMENT_PREFIX_PATH,
wheels of message packages, and the bundled interfaces of a distribution. If the distribution was selected explicitly,
its bundled interfaces follow directly after the folders of the caller.

The search reads only directory entries and names in package.xml; interface files and CMakeLists.txt are opened later. A
folder msg, srv or action without interface files is not a package: Python packages and C++ headers have such folders.
Virtual environments and build folders of CMake are skipped.

A `Workspace` is the colcon workspace around a script or folder: all packages in it that have a package.xml. The error
texts for missing packages and interfaces state where they were found instead, and why the search ignores them.
"""

from __future__ import annotations

import os
import sys
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.names import RosName, did_you_mean
from rosidl_py_gen.base.package_repositories import MessagePackage
from rosidl_py_gen.base.resources import GeneratedCode, InstalledInterfaces
from rosidl_py_gen.compiler.frontend.bundled import BundledInterfaces, other_distributions_note
from rosidl_py_gen.compiler.frontend.package_files import (
    BUILD_TREE_MARKERS,
    IGNORE_MARKS,
    ReadPaths,
    mentions_interfaces,
    read_package_manifest,
)
from rosidl_py_gen.errors import DefinitionError, Diagnostic, TypeNotFoundError, display_path

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.compiler.frontend.cmake_interfaces import CMakeInterfaceList

_SUFFIXES = (".idl", *(f".{kind}" for kind in RosName.KINDS))
_INSTALLED = "installed"
"""Value of `Package.origin` for packages that pip installed."""
_BUNDLED = "bundled"
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

    @classmethod
    def of_sources(cls, name: str, folder: Path) -> Package | None:
        """Return the interface package in a source folder; None if the folder has no interfaces, or for an invalid
        name.
        """
        if not RosName.PACKAGE_RULE.allows(name) or not (holds_interfaces(folder) or mentions_interfaces(folder)):
            return None
        return cls(name, folder, "", from_source=True)

    @property
    def is_bundled(self) -> bool:
        """True if the package is bundled with rosidl-py-gen."""
        return self.origin == _BUNDLED

    @property
    def is_installed(self) -> bool:
        """True if pip installed the package."""
        return self.origin == _INSTALLED

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
        for kind in RosName.KINDS:
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

    @classmethod
    def scan(
        cls,
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
        found = cls({})
        for folder in folders:
            _add(found, str(folder), _packages_below(Path(folder), found.refused))
        choice = Distribution.selected(distro) if bundled else None
        if choice is not None and choice.is_explicit:
            _add_bundled(found, choice.name)
        prefixes = os.environ.get("AMENT_PREFIX_PATH", "") if ament is None else ament
        for prefix in filter(None, prefixes.split(os.pathsep)):
            share = Path(prefix) / "share"
            holders = (Path(entry.path) for entry in _entries(share) if holds_interfaces(Path(entry.path)))
            named = (path for path in holders if RosName.PACKAGE_RULE.allows(path.name))
            _add(found, prefix, (Package(path.name, path, prefix) for path in named))
        if choice is not None:
            if installed := [*_installed()]:
                _add(found, _INSTALLED, installed)
            if not choice.is_explicit:
                _add_bundled(found, choice.name)
        return cls(dict(sorted(found.packages.items())), found.hidden, found.searched, found.refused)

    def file(self, name: RosName) -> Path | None:
        package = self.packages.get(name.package)
        return package.files.get(name) if package else None

    def resolve(self, text: str) -> RosName:
        """Return the interface that a user's text names: ``pkg/msg/Name``, ``pkg/Name``, or ``Name`` of one package.

        Raises:
            InvalidNameError: the text is not a valid name.
            TypeNotFoundError: several interfaces have the name.
        """
        if "/" in text:
            kinds = (kind for kind in RosName.KINDS if self.file(RosName.parse(text, kind)) is not None)
            return RosName.parse(text, next(kinds, "msg"))
        found = [name for package in self.packages.values() for name in package.files if name.name == text]
        if len(found) > 1:
            raise TypeNotFoundError(f'"{text}" may be {", ".join(map(str, found))}')
        return found[0] if found else RosName.parse(text)

    def notes(self, names: Iterable[RosName]) -> list[Diagnostic]:
        """Return notes on assumptions that were made about the CMakeLists.txt of the packages of some interfaces."""
        listings = (self.packages[package].listing for package in sorted({name.package for name in names}))
        return [note for listing in listings if listing for note in listing.notes]

    def missing_package(self, package: str, subject: str, type_name: str = "") -> str:
        """Return an error text, beginning with `subject`, for a package that the search path lacks.

        `type_name` is the full name of the interface that was requested; empty for the whole package.
        """
        where = f"(searched: {', '.join(self.searched) or 'nothing'})"
        if note := other_distributions_note(package):
            return f"{subject}{note} {where}"
        searched = [Path(entry) for entry in self.searched if os.path.isdir(entry)]
        here = Path()
        for root in (*searched, *(root / "share" / package for root in searched), here):
            place = _find(root, package)
            if place is None:
                continue
            shown = display_path(place.folder)
            if place.mark is not None:
                return f"{subject}: {shown} is ignored because of {display_path(place.mark)}; remove that file {where}"
            if not place.has_interfaces:
                return f"{subject} with interfaces: {shown} has no .msg, .srv, .action or .idl file {where}"
            if root is here:
                return f"{subject} on the search path, but {shown} has it; use --path . {where}"
        module = _generated_package(package)
        if module is not None and type_name:
            text = f"the importable package {display_path(module)} has no {type_name}"
            return f"{subject}: {text}; generate it again {where}"
        if module is not None:
            return f"{subject} with definitions: {display_path(module)} has generated classes only {where}"
        named = (name for name in Distribution.BUNDLED if f"{_BUNDLED} ({name})" in self.searched)
        distro = next(named, Distribution.DEFAULT if _BUNDLED in self.searched else Distribution.selected().name)
        if note := MessagePackage(package).download_note(distro):
            return f"{subject} {where}. {note}"
        return f"{subject}{did_you_mean(package, self.packages)} {where}"

    def missing_interface(self, name: RosName, subject: str) -> str:
        """Return an error text for an interface that the search path lacks.

        The text starts with `subject` if the package exists, otherwise it is about the missing package.
        """
        package = self.packages.get(name.package)
        if package is None and name.package not in self.refused:
            return self.missing_package(name.package, f'no package "{name.package}" for {name}', str(name))
        known = [str(other) for one in self.packages.values() for other in one.files]
        hint = (package.not_in_cmake_note(name) if package else "") or other_distributions_note(name.package, name)
        hint = hint or did_you_mean(str(name), known)
        return f"{subject}{hint} (searched: {', '.join(self.searched) or 'nothing'})"


def _add_bundled(found: SearchPath, distro: str) -> None:
    packages = (
        Package(name, one.folder, _BUNDLED, known_files=one.files)
        for name, one in BundledInterfaces.of(distro).packages.items()
    )
    _add(found, _BUNDLED if distro == Distribution.DEFAULT else f"{_BUNDLED} ({distro})", packages)


def _installed() -> Iterator[Package]:
    """Yield the interface packages that pip installed: wheels with entry points, then ROS packages of the prefix.

    ROS packages install into ``share`` of the prefix. Only packages of the ament index are read: ``share`` of a system
    has thousands of other folders, and ROS 1 packages.
    """
    names: set[str] = set()
    for package in _installed_by_entry_points():
        names.add(package.name)
        yield package
    index = InstalledInterfaces.ros_index()
    ReadPaths.note(index)
    for entry in _entries(Path(index)) if os.path.isdir(index) else ():  # no folder, or one that cannot be reached
        folder = Path(sys.prefix, "share", entry.name)
        if entry.name not in names and RosName.PACKAGE_RULE.allows(entry.name) and holds_interfaces(folder):
            yield Package(entry.name, folder, _INSTALLED)


def _installed_by_entry_points() -> Iterator[Package]:
    from importlib.metadata import entry_points  # slow to import

    entries = entry_points(group=InstalledInterfaces.ENTRY_POINTS)
    for name, module in sorted({(entry.name, entry.value) for entry in entries}):
        try:
            spec = find_spec(module.partition(".")[0])
        except (ImportError, ValueError):
            continue
        if spec is not None and spec.origin and RosName.PACKAGE_RULE.allows(name):
            folder = Path(spec.origin).parent
            if holds_interfaces(folder):
                yield Package(name, folder, _INSTALLED)


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
    ReadPaths.note(folder)
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
    return any(_is_for_interfaces(folder / kind) for kind in RosName.KINDS)


def _is_for_interfaces(folder: Path) -> bool:
    ReadPaths.note(folder)
    try:
        with os.scandir(folder) as entries:
            names = [entry.name for entry in entries]
            return not names or any(name.endswith(_SUFFIXES) for name in names)
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:  # reported when it is read
        return True


def _groups_packages(folder: Path) -> bool:
    inside = [Path(entry.path) for kind in RosName.KINDS for entry in _entries(folder / kind)]
    for path in inside:
        ReadPaths.note(path / "package.xml")
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
    ReadPaths.note(folder)
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
            if RosName.PACKAGE_RULE.allows(name):
                yield package
            else:
                place = str(manifest if is_package else folder)
                text = f'"{name[:80]}" is not a legal package name; {RosName.PACKAGE_RULE}'
                refused[name] = Diagnostic(place, 0, 0, text)
        return
    for entry in _entries(folder):
        is_folder = os.path.isdir(entry.path)  # entry.is_dir() raises for a link to itself
        if is_folder and not entry.name.startswith(".") and os.access(entry.path, os.R_OK | os.X_OK):
            yield from _descend(Path(entry.path), origin, refused, visited, depth + 1)
        elif not entry.name.startswith(".") and (is_folder or entry.is_symlink()):
            ReadPaths.note(entry.path)


def package_name(manifest: Path, folder: Path) -> str:
    """Return the name of a package as its package.xml states it, else the name of the folder.

    Raises `DefinitionError` if the file cannot be read.
    """
    ReadPaths.note(manifest)
    text = ""
    try:
        if manifest.is_file():  # opening a pipe would wait for its writer
            with manifest.open("rb") as file:
                text = file.read(_MAX_XML_BYTES).decode(errors="replace")
    except OSError as error:
        raise DefinitionError(Diagnostic(str(manifest), 0, 0, f"cannot be read: {error.strerror or error}")) from error
    return read_package_manifest(text).name or Path(os.path.realpath(folder)).name


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
            entries = _readable_entries(folder)
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
                        ReadPaths.note(entry.path)
        return found, True

    @classmethod
    def around(cls, place: Path) -> Workspace | None:
        """Return the workspace that contains a file or a folder; None for a script outside of packages.

        The workspace is the folder ``src`` that contains the package, else the package and its siblings. For a folder
        outside of packages, the workspace is its subfolder ``src``, else the folder itself.
        """
        package = cls.package_around(place)
        if package is not None:
            source = next((folder for folder in package.parents if folder.name == "src"), None)
            return cls(package.parent, 1, package) if source is None else cls(source)
        if not place.is_dir():
            return None
        source = place if place.name == "src" else place / "src"
        return cls(source) if source.is_dir() else cls(place, holds_others=True)

    @staticmethod
    def package_around(place: Path) -> Path | None:
        """Return the folder of the package that contains a file or folder: the nearest folder with a package.xml.

        Returns None without such a folder.
        """
        above = [place, *place.parents] if place.is_dir() else [*place.parents]
        return next((folder for folder in above if os.path.isfile(folder / MANIFEST)), None)

    @property
    def holds_interfaces(self) -> bool:
        """True if `folder` itself contains a package with interfaces; reads the folder at each access.

        Raises:
            DefinitionError: a folder or package.xml cannot be read.
        """
        refused: dict[str, Diagnostic] = {}
        return bool([*_descend(self.folder, str(self.folder), refused, set())] or refused)

    @property
    def roots(self) -> list[Path]:
        """Folders that contain all packages: the workspace folder, or each package if the folder contains much else."""
        return [*self.packages.values()] if self.holds_others or self.depth is not None else [self.folder]


def _readable_entries(folder: Path) -> list[os.DirEntry[str]]:
    """Return the entries of a folder, sorted by name; [] for an unreadable folder, which is skipped."""
    ReadPaths.note(folder)
    with suppress(OSError), os.scandir(folder) as entries:
        return sorted(entries, key=lambda entry: entry.name)
    return []


def _is_folder(entry: os.DirEntry[str]) -> bool:
    with suppress(OSError):  # a link to itself
        return entry.is_dir()
    return False


MAX_FOLDERS = 2000
"""Maximum number of folders that are searched to improve an error text, which takes 0.1 s; a large home folder has many
more."""
_NOT_SOURCES = ("build", "install", "log", "node_modules", "site-packages")


class _Place(NamedTuple):
    """Folder in which a missing package was found.

    `mark` is the marker file that makes the search ignore the folder, or None.
    """

    folder: Path
    mark: Path | None
    has_interfaces: bool


def _find(root: Path, package: str) -> _Place | None:
    """Return the folder of a package below `root`.

    Of several folders, preferably one that the search path does not ignore.
    """
    found: list[_Place] = []
    waiting: list[tuple[Path, Path | None]] = [(root, None)]
    for folder, above in waiting:  # grows inside the loop
        try:
            entries = {entry.name: entry for entry in os.scandir(folder)}
        except OSError:
            continue
        mark = above or next((folder / name for name in IGNORE_MARKS if name in entries), None)
        if folder != root and not entries.keys().isdisjoint(BUILD_TREE_MARKERS):
            continue
        is_package = "package.xml" in entries
        if is_package or holds_interfaces(folder):
            if _name(folder) == package:
                found.append(_Place(folder, mark, _has_interfaces(package, folder, is_package)))
            continue
        for name in sorted(entries):
            is_source = name[0] != "." and name not in _NOT_SOURCES and len(waiting) < MAX_FOLDERS
            if is_source and entries[name].is_dir(follow_symlinks=False):
                waiting.append((folder / name, mark))
    return min(found, key=lambda place: (place.mark is not None, not place.has_interfaces), default=None)


def _name(folder: Path) -> str:
    try:
        return package_name(folder / "package.xml", folder)
    except DefinitionError:
        return ""


def _has_interfaces(package: str, folder: Path, from_source: bool) -> bool:
    try:
        return bool(Package(package, folder, "", from_source).files)
    except DefinitionError:
        return True


def _generated_package(package: str) -> Path | None:
    try:
        spec = find_spec(package) if package.isidentifier() else None
    except (ImportError, ValueError, AttributeError):
        return None
    folder = Path(spec.origin).parent if spec is not None and spec.origin else None
    if folder is None:
        return None
    return folder if any(GeneratedCode.is_generated(folder / kind / "__init__.py") for kind in RosName.KINDS) else None
