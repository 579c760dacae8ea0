"""Files of one package folder: interfaces, package.xml, the limit of reading, and a record of what a search reads.

A search passes each path to `ReadPaths.note` before it is read, so that its result can be cached until one of them
changes.

The readers of CMakeLists.txt, package.xml, setup.py, setup.cfg and pyproject.toml share one `PackageBudget` for each
package, which limits time and memory. A reader spends work before it does the work, so that a file of a few hundred
bytes cannot request more. Each file of the package enlarges the budget. The budget is restored for another purpose,
such as another file or the installation.

Name, version and build type of a malformed package.xml are returned as far as they can be read, so that one file does
not end the search of a workspace. The time is linear in the size of the file.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from contextvars import ContextVar
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from pathlib import Path

Stamp = tuple[int, ...] | None
"""State of a file or folder: times of change in ns, inode, and size; None if it does not exist."""
_stamps = ContextVar[dict[str, Stamp] | None]("stamps", default=None)


class ReadPaths:
    """Files and folders that a search has read, each with its state before the search.

    Attributes:
        stamps: state of each path.
    """

    def __init__(self, stamps: dict[str, Stamp]) -> None:
        self.stamps = stamps

    @classmethod
    def of(cls, search: Callable[[], Any]) -> tuple[ReadPaths, Any]:
        """Run a search; return the paths that it has passed to `note` in this thread, and the search's result."""
        stamps: dict[str, Stamp] = {}
        token = _stamps.set(stamps)
        try:
            result = search()
        finally:
            _stamps.reset(token)
        return cls(stamps), result

    @staticmethod
    def note(path: str | os.PathLike[str]) -> None:
        """Record the state of a file or folder, which may be missing, for a call of `of` that is running in this
        thread.

        Must be called before the file or folder is read.
        """
        stamps = _stamps.get()
        if stamps is not None and (text := os.path.abspath(path)) not in stamps:
            stamps[text] = ReadPaths.stamp(text)

    @staticmethod
    def stamp(path: str) -> Stamp:
        """Return the present state of a file or folder; None if it does not exist."""
        try:
            found = os.stat(path)
        except (OSError, ValueError):
            return None
        return found.st_mtime_ns, found.st_ctime_ns, found.st_ino, found.st_size

    def are_unchanged(self) -> bool:
        """Return True if every path has the state that it had before the search."""
        return all(self.stamp(path) == old for path, old in self.stamps.items())

    @property
    def newest_ns(self) -> int:
        """Time of the last change of any path, in ns; 0 if no path exists."""
        return max((max(one[:2]) for one in self.stamps.values() if one is not None), default=0)


_MENTIONED = re.compile(rb"\brosidl_(generate_interfaces|default_generators|interface_packages)\b", re.IGNORECASE)
IGNORE_MARKS = ("COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE")
BUILD_TREE_MARKERS = ("pyvenv.cfg", "CMakeCache.txt")
"""Marker files of virtual environments and build folders, which contain copies of packages and are skipped."""
_BUILD_FOLDERS = ("build", "install", "log")
MAX_BYTES = 1 << 20
"""Maximum size in bytes of a CMakeLists.txt or another file that is read from a package."""
_MAX_PATH = 4096
"""Maximum characters of a path in a file of a package: PATH_MAX of Linux."""
_MAX_FOLDER_DEPTH = 100
"""Maximum depth of folders of a package, because the time to reach a folder grows with its depth."""
_MAX_ENTRIES = 100_000
"""Maximum files and folders below a package folder. The limit stops a search that was started in a wrong folder, such
as a home folder."""


class UnreadableError(RosidlError):
    """Error for a package's file or folder that cannot be read; `offset` is the position in the file's text, or -1."""

    def __init__(self, reason: str, offset: int = -1) -> None:
        super().__init__(reason)
        self.reason, self.offset = reason, offset


def mentions_interfaces(folder: Path) -> bool:
    """Return True if a folder has a CMakeLists.txt, and this file or package.xml mentions the generation of
    interfaces.
    """
    for name in ("CMakeLists.txt", "package.xml"):
        ReadPaths.note(folder / name)
        if not os.path.isfile(folder / name):  # opening a pipe would wait for its writer
            return False
        try:
            with open(folder / name, "rb") as file:
                if _MENTIONED.search(file.read(MAX_BYTES + 1)):
                    return True
        except OSError:
            return False
    return False


def interface_name(package: str, path: str) -> RosName | None:
    """Return the name of the interface that a file defines, from suffix and folder; None for other files.

    The kind of an .idl file is the name of its folder.
    """
    holder, file = os.path.split(path)
    stem, suffix = os.path.splitext(file)
    kind = os.path.basename(holder) if suffix == ".idl" else suffix[1:]
    return RosName(package, kind, stem) if kind in RosName.KINDS else None


class PackageFiles:
    """Files below a package folder; paths are relative to the folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @staticmethod
    def inside(path: str) -> str | None:
        """Return the normal form of a path; None for the folder itself, and for a path outside of it.

        A path with a NUL, such as `CMakeScript.UNKNOWN`, counts as outside.
        """
        path = posixpath.normpath(path)
        is_outside = len(path) > _MAX_PATH or "\0" in path or path.startswith(("/", "../")) or path in (".", "..")
        return None if is_outside else path

    def owns(self, path: str) -> bool:
        """Return True if a file belongs to the package.

        Only files in msg, srv and action may be links to files outside of the package.
        """
        return os.path.dirname(path) in RosName.KINDS or self._contains(path)

    def _contains(self, path: str) -> bool:
        real, home = os.path.realpath(self.folder / path), os.path.realpath(self.folder)
        return os.path.commonpath([real, home]) == home

    def paths(self) -> list[str]:
        """Return the sorted paths of all files; raises `UnreadableError`.

        Hidden files, the folders ``build``, ``install`` and ``log``, ignored folders and other packages are skipped.
        Links to folders are followed only for msg, srv and action of the package itself.
        """
        found: list[str] = []
        folders = [""]
        count = 0
        for place in folders:  # grows inside the loop
            ReadPaths.note(self.folder / place)
            try:
                with os.scandir(self.folder / place) as scan:
                    entries = list(scan)
            except OSError as error:
                raise UnreadableError(f'the folder "{place}" cannot be read: {error.strerror or error}') from error
            count += len(entries)
            if count > _MAX_ENTRIES:
                raise UnreadableError(f"there are more than {_MAX_ENTRIES} files below the package folder")
            if problem := PackageBudget.depth_problem(place):
                raise UnreadableError(problem)
            names = {entry.name for entry in entries}
            if place and not names.isdisjoint(("package.xml", *IGNORE_MARKS, *BUILD_TREE_MARKERS)):
                continue
            # msg/log may be a folder of definitions
            holds_interfaces = not set(RosName.KINDS).isdisjoint(place.split("/"))
            for entry in entries:
                path = f"{place}/{entry.name}" if place else entry.name
                if entry.name[0] == "." or (entry.name in _BUILD_FOLDERS and not holds_interfaces):
                    continue
                if not os.path.isdir(entry.path):
                    found.append(path)
                elif path in RosName.KINDS or not entry.is_symlink():
                    folders.append(path)
        return sorted(found)

    def note_folders(self) -> None:
        """Pass all folders to `ReadPaths.note`, as far as they can be read."""
        with suppress(UnreadableError):
            self.paths()

    def read_text(self, name: str) -> str:
        """Return the text of a file.

        Raises `UnreadableError` for a file that is missing, too large, or outside of the package.
        """
        path = self.folder / name
        ReadPaths.note(path)
        try:
            if not self._contains(name):
                raise UnreadableError("the file lies outside the package folder")
            if not os.path.isfile(path):  # opening a pipe would wait for its writer
                raise UnreadableError("there is no such file")
            with open(path, "rb") as file:
                raw = file.read(MAX_BYTES + 1)
        except (OSError, ValueError) as error:
            raise UnreadableError(f"the file cannot be read: {getattr(error, 'strerror', None) or error}") from error
        if len(raw) > MAX_BYTES:
            raise UnreadableError(f"the file is longer than {MAX_BYTES} bytes")
        return raw.decode(errors="replace").replace("\0", "\ufffd")

    def manifest(self) -> ManifestValues:
        """Return name, version and build type of package.xml; all are empty if the file cannot be read."""
        with suppress(UnreadableError):
            return read_package_manifest(self.read_text("package.xml"))
        return ManifestValues()


_MAX_WORK = 2_000_000
"""Maximum work for reading one package, measured in characters of values and names; the maximum takes Python about 1 s.
"""
_ACCESS_WORK = 500
"""Work that one access to a file or folder counts as, in characters of text; the access takes at least one system call.
"""
_ENTRY_WORK = 20
"""Work that reading one directory entry counts as, in characters of text."""
_STEP_WORK = 8
"""Work that one command, statement or expression counts as, in characters of text, in addition to the characters of its
value."""
_LINK_WORK = 60
"""Work that installing one file of the package as a link counts as, in characters of text."""
_CREATION_WORK = 1000
"""Work that creating one installed file that does not come from the package counts as, in characters of text."""
_OWN_FILE_WORK = 1200
"""Work, in characters of text, by which each file of a package enlarges the package's budget: for one test of the file,
and for computing its paths."""
_MAX_OWN_FILES = 20_000
"""Maximum number of files of a package that add work to its budget."""
_T = TypeVar("_T")


class PackageBudget:
    """Remaining work for reading the files of one package.

    A method that would spend more than remains raises `ExceededError`.
    """

    class ExceededError(UnreadableError):
        """Error of a package whose reading would take more work than any package can need."""

    def __init__(self, work: int = _MAX_WORK) -> None:
        self._work = self._start = work
        self._folders: set[str] = set()
        self._own_files = 0

    def renew(self) -> None:
        """Restore the initial work of the budget for another purpose, such as another file or the installation."""
        self._work = max(self._work, self._start)

    def entries(self, folder: str, scan: Iterable[_T]) -> Iterator[_T]:
        """Yield the entries of a folder of the package.

        When a folder is read for the first time, each entry enlarges the budget. `folder` is the real path: through
        links, one folder could have many paths.
        """
        is_new = folder not in self._folders
        self._folders.add(folder)
        for entry in scan:
            if is_new and self._own_files < _MAX_OWN_FILES:
                self._own_files += 1
                self._work += _OWN_FILE_WORK
            yield entry

    @staticmethod
    def depth_problem(place: str) -> str:
        """Return a text about a folder at a path of the package that is nested too deeply; "" for other folders."""
        return f"folders are nested more than {_MAX_FOLDER_DEPTH} deep" if place.count("/") >= _MAX_FOLDER_DEPTH else ""

    def spend(self, characters: int) -> None:
        """Spend the work for reading or building values of this many characters."""
        self._work -= characters + 1
        if self._work < 0:
            raise self.ExceededError("reading it takes more work than a package can need")

    def matches(self, name: str, pattern: str) -> bool:
        """Return `fnmatchcase(name, pattern)` after spending work for it.

        Each star in the pattern may search the rest of the name.
        """
        self.spend(len(name) * len(pattern) // 20 if "*" in pattern else 0)
        return fnmatchcase(name, pattern)

    def access(self, entries: int = 0) -> None:
        """Spend the work for one access to a file, or to a folder with this many entries."""
        self.spend(_ACCESS_WORK + _ENTRY_WORK * entries)

    def step(self) -> None:
        """Spend the work for one command, expression or statement."""
        self.spend(_STEP_WORK)

    def install(self, place: str, *, is_new_source: bool) -> None:
        """Spend the work for one installed file at the path `place`.

        A second copy of a package file, and a file in a deep folder, cost more, because a short text can list many of
        them.
        """
        depth = max(0, place.count("/") - 8)
        self.spend(len(place) + (_LINK_WORK if is_new_source else _CREATION_WORK) + depth * _ACCESS_WORK)


_START = re.compile(r"<(name|version|build_type)(?=[\s>])")


class ManifestValues(NamedTuple):
    """Name, version and build type of a package.xml; missing values are empty.

    Attributes:
        build_type: the build type for ROS 2; types with the condition `$ROS_VERSION == 1` are skipped.
    """

    name: str = ""
    version: str = ""
    build_type: str = ""


def read_package_manifest(text: str) -> ManifestValues:
    """Return name, version and build type from the text of a package.xml."""
    found: dict[str, str] = {}
    for tag, attributes, content in _elements(text):
        is_of_ros_1 = tag == "build_type" and "ROS_VERSION==1" in "".join(attributes.split())
        if content and not is_of_ros_1:
            found.setdefault(tag, content)
    return ManifestValues(**found)


def _elements(text: str) -> Iterator[tuple[str, str, str]]:
    """Yield tag, attributes and text of each XML element of a package.xml whose tag the reader uses."""
    text = _without_comments(text)
    position = 0
    while start := _START.search(text, position):
        close = text.find(">", start.end())
        position = text.find("<", close)
        if close < 0 or position < 0:
            return
        if text.startswith(f"</{start[1]}", position):
            yield start[1], text[start.end() : close], text[close + 1 : position].strip()


def _without_comments(text: str) -> str:
    parts = []
    position = 0
    while (start := text.find("<!--", position)) >= 0:
        parts.append(text[position:start])
        position = text.find("-->", start) + 3
        if position < 3:  # the comment has no end
            return "".join(parts)
    return "".join((*parts, text[position:]))
