"""Files of one package folder and the interfaces that they define."""

from __future__ import annotations

import os
import re
from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import KINDS, RosName
from rosidl_py_gen.base.scanned_paths import note
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from pathlib import Path

_MENTIONED = re.compile(rb"\brosidl_(generate_interfaces|default_generators|interface_packages)\b", re.IGNORECASE)
IGNORE_MARKS = ("COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE")
BUILD_TREE_MARKERS = ("pyvenv.cfg", "CMakeCache.txt")
"""Marker files of virtual environments and build folders, which contain copies of packages and are skipped."""
_BUILD_FOLDERS = ("build", "install", "log")
MAX_BYTES = 1 << 20
"""Maximum size in bytes of a CMakeLists.txt or another file that is read from a package."""
MAX_FOLDER_DEPTH = 100
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
        note(folder / name)
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
    return RosName(package, kind, stem) if kind in KINDS else None


def is_of_package(folder: Path, path: str) -> bool:
    """Return True if a file belongs to the package.

    Only files in msg, srv and action may be links to files outside of the package.
    """
    return os.path.dirname(path) in KINDS or _is_inside(folder, path)


def _is_inside(folder: Path, path: str) -> bool:
    real, home = os.path.realpath(folder / path), os.path.realpath(folder)
    return os.path.commonpath([real, home]) == home


def files_below(folder: Path) -> list[str]:
    """Return the sorted paths of a package's files, relative to its folder; raises `UnreadableError`.

    Hidden files, the folders ``build``, ``install`` and ``log``, ignored folders and other packages are skipped. Links
    to folders are followed only for msg, srv and action of the package itself.
    """
    found: list[str] = []
    folders = [""]
    count = 0
    for place in folders:  # grows inside the loop
        note(folder / place)
        try:
            with os.scandir(folder / place) as scan:
                entries = list(scan)
        except OSError as error:
            raise UnreadableError(f'the folder "{place}" cannot be read: {error.strerror or error}') from error
        count += len(entries)
        if count > _MAX_ENTRIES:
            raise UnreadableError(f"there are more than {_MAX_ENTRIES} files below the package folder")
        if place.count("/") >= MAX_FOLDER_DEPTH:
            raise UnreadableError(f"folders are nested more than {MAX_FOLDER_DEPTH} deep")
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
    """Return the text of a file of a package.

    Raises `UnreadableError` for a file that is missing, too large, or outside of the package.
    """
    note(folder / name)
    try:
        if not _is_inside(folder, name):
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
