"""Error texts for packages and interfaces that are missing on the search path: where they were found instead, and why
the search ignores them.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.distributions import DEFAULT, DISTRIBUTIONS, selected
from rosidl_py_gen.base.generated_classes import is_generated
from rosidl_py_gen.base.message_packages import download_note
from rosidl_py_gen.base.names import KINDS, did_you_mean
from rosidl_py_gen.compiler.frontend.bundled import other_distributions_note
from rosidl_py_gen.compiler.frontend.package_files import BUILD_TREE_MARKERS, IGNORE_MARKS
from rosidl_py_gen.compiler.frontend.search_path import BUNDLED, Package, holds_interfaces, package_name
from rosidl_py_gen.errors import DefinitionError, display_path

if TYPE_CHECKING:
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.search_path import SearchPath

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


def missing_package(search: SearchPath, package: str, subject: str, type_name: str = "") -> str:
    """Return an error text, beginning with `subject`, for a package that the search path lacks.

    `type_name` is the full name of the interface that was requested; empty for the whole package.
    """
    where = f"(searched: {', '.join(search.searched) or 'nothing'})"
    if note := other_distributions_note(package):
        return f"{subject}{note} {where}"
    searched = [Path(entry) for entry in search.searched if os.path.isdir(entry)]
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
        return f"{subject}: the importable package {display_path(module)} has no {type_name}; generate it again {where}"
    if module is not None:
        return f"{subject} with definitions: {display_path(module)} has generated classes only {where}"
    named = (name for name in DISTRIBUTIONS if f"{BUNDLED} ({name})" in search.searched)
    distro = next(named, DEFAULT if BUNDLED in search.searched else selected().name)
    if note := download_note(package, distro):
        return f"{subject} {where}. {note}"
    return f"{subject}{did_you_mean(package, search.packages)} {where}"


def missing_interface(search: SearchPath, name: RosName, subject: str) -> str:
    """Return an error text for an interface that the search path lacks.

    The text starts with `subject` if the package exists, otherwise it is about the missing package.
    """
    package = search.packages.get(name.package)
    if package is None and name.package not in search.refused:
        return missing_package(search, name.package, f'no package "{name.package}" for {name}', str(name))
    known = [str(other) for one in search.packages.values() for other in one.files]
    hint = (package.not_in_cmake_note(name) if package else "") or other_distributions_note(name.package, name)
    hint = hint or did_you_mean(str(name), known)
    return f"{subject}{hint} (searched: {', '.join(search.searched) or 'nothing'})"


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
    return folder if folder is not None and any(is_generated(folder / kind / "__init__.py") for kind in KINDS) else None
