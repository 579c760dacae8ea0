"""Files of one package folder: which there are, what they contain, and which interface a file defines."""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import KINDS, RosName
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from pathlib import Path

_MENTIONED = re.compile(rb"\brosidl_(generate_interfaces|default_generators|interface_packages)\b", re.IGNORECASE)
IGNORE_MARKS = ("COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE")
BUILD_TREE_MARKERS = ("pyvenv.cfg", "CMakeCache.txt")
"""Files of folders that hold copies: of a virtual environment, and of a build."""
_BUILD_FOLDERS = ("build", "install", "log")
MAX_BYTES = 1 << 20
"""Size of a CMakeLists.txt or another file of a package that is read."""
_MAX_ENTRIES = 100_000
"""Files and folders below one package folder. More are an error, so that a wrong folder does not take minutes."""


class UnreadableError(RosidlError):
    """A file or folder of a package cannot be read, or not understood; `offset` is the place in the file's text."""

    def __init__(self, reason: str, offset: int = -1) -> None:
        super().__init__(reason)
        self.reason, self.offset = reason, offset


def mentions_interfaces(folder: Path) -> bool:
    """Return True if there is a CMakeLists.txt, and it or package.xml mentions the generation of interfaces."""
    for name in ("CMakeLists.txt", "package.xml"):
        try:
            with open(folder / name, "rb") as file:
                if _MENTIONED.search(file.read(MAX_BYTES + 1)):
                    return True
        except OSError:
            return False
    return False


def interface_name(package: str, path: str) -> RosName | None:
    """Return the interface that a file defines; None if it is not an interface file.

    The suffix tells the kind, for an .idl its folder.
    """
    holder, file = os.path.split(path)
    stem, suffix = os.path.splitext(file)
    kind = os.path.basename(holder) if suffix == ".idl" else suffix[1:]
    return RosName(package, kind, stem) if kind in KINDS else None


def is_of_package(folder: Path, path: str) -> bool:
    """Return True if the file lies in the package: links lead elsewhere only from its msg, srv and action."""
    return os.path.dirname(path) in KINDS or _lies_inside(folder, path)


def _lies_inside(folder: Path, path: str) -> bool:
    real, home = os.path.realpath(folder / path), os.path.realpath(folder)
    return os.path.commonpath([real, home]) == home


def files_below(folder: Path) -> list[str]:
    """Return the files of a package by their sorted paths below its folder.

    Hidden files, the folders ``build``, ``install`` and ``log``, ignored folders and other packages are left out. Links
    to folders are followed only for msg, srv and action of the package itself.

    Raises:
        UnreadableError: a folder cannot be read, or there are too many files.
    """
    found: list[str] = []
    folders = [""]
    count = 0
    for place in folders:  # grows inside the loop
        try:
            with os.scandir(folder / place) as scan:
                entries = list(scan)
        except OSError as error:
            raise UnreadableError(f'the folder "{place}" cannot be read: {error.strerror or error}') from error
        count += len(entries)
        if count > _MAX_ENTRIES:
            raise UnreadableError(f"there are more than {_MAX_ENTRIES} files below the package folder")
        names = {entry.name for entry in entries}
        if place and not names.isdisjoint(("package.xml", *IGNORE_MARKS, *BUILD_TREE_MARKERS)):
            continue
        holds_interfaces = not set(KINDS).isdisjoint(place.split("/"))  # msg/log may be a folder of definitions
        for entry in entries:
            path = f"{place}/{entry.name}" if place else entry.name
            if entry.name[0] == "." or (entry.name in _BUILD_FOLDERS and not holds_interfaces):
                continue
            if not os.path.isdir(entry.path):
                found.append(path)
            elif path in KINDS or not entry.is_symlink():
                folders.append(path)
    return sorted(found)


def read_text(folder: Path, name: str) -> str:
    """Return the text of a file of the package. Raises `UnreadableError`."""
    try:
        if not _lies_inside(folder, name):
            raise UnreadableError("the file lies outside the package folder")
        if not os.path.isfile(folder / name):  # opening a pipe would wait for its writer
            raise UnreadableError("there is no such file")
        with open(folder / name, "rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise UnreadableError(f"the file cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if len(raw) > MAX_BYTES:
        raise UnreadableError(f"the file is longer than {MAX_BYTES} bytes")
    return raw.decode(errors="replace").replace("\0", "\ufffd")
