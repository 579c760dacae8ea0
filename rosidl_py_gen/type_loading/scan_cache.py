"""Disk cache for the results of two searches: for all packages of a workspace, and for packages with interfaces.

A result is used as long as no file or folder that the search has read has changed, appeared or disappeared.
"""

from __future__ import annotations

import marshal
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from time import time_ns
from typing import Any

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.resources import DataFolders
from rosidl_py_gen.compiler.frontend import (
    Package,
    ReadPaths,
    SearchPath,
    Workspace,
)
from rosidl_py_gen.errors import Diagnostic
from rosidl_py_gen.type_loading import disk_cache

_MAX_FILES = 200
MIN_AGE_NS = 2_000_000_000
"""Minimum time between the last change of a scanned path and the caching of the result: the times of some file systems
have steps of 2 s."""


def workspace_packages(workspace: Workspace) -> dict[str, Path]:
    """Return the folders of a workspace's packages by name, from the cache if nothing has changed."""
    if disk_cache.own_folder() is None:
        return workspace.packages
    settings = ("workspace", str(workspace.folder), workspace.depth, str(workspace.own))

    def scan() -> dict[str, str]:
        # A copy, because a workspace that was read before notes no paths.
        return {name: str(path) for name, path in replace(workspace).packages.items()}

    found = cached(settings, scan)
    return {name: Path(path) for name, path in found.items()}


def search(path: Sequence[str], workspace: Workspace | None, choice: Distribution) -> tuple[list[str], SearchPath]:
    """Return the folders with interfaces in `path` and a workspace, and the packages that a search of these folders
    finds.

    The result comes from the cache if nothing has changed.
    """

    def scan() -> Any:
        # Names of files are cached for other distributions than the default only.
        top, is_default = DataFolders.interfaces(), choice.name == Distribution.DEFAULT
        bundled = [top] if is_default else [place for place, *_ in os.walk(top)]
        for place in (*sys.path, *bundled):
            ReadPaths.note(place)
        # A copy as in `workspace_packages`.
        folders = _folders(path, None if workspace is None else replace(workspace))
        found = SearchPath.scan(folders, distro=choice.name if choice.is_explicit else None)
        rows = [[_row(package) for package in packages] for packages in (found.packages.values(), found.hidden)]
        refused = {name: (one.path, one.line, one.column, one.text) for name, one in found.refused.items()}
        return folders, *rows, found.searched, refused

    finders = [getattr(finder, "__name__", type(finder).__qualname__) for finder in sys.meta_path]
    environment = (os.environ.get("AMENT_PREFIX_PATH"), sys.path, sys.prefix, finders)
    folders, packages, hidden, searched, refused = cached(("search", path, workspace, choice, environment), scan)
    by_name = {row[0]: _package(*row) for row in packages}
    problems = {name: Diagnostic(*values) for name, values in refused.items()}
    return folders, SearchPath(by_name, [_package(*row) for row in hidden], searched, problems)


def _folders(path: Sequence[str], workspace: Workspace | None) -> list[str]:
    folders = [
        one for one in path if Workspace(Path(one)).holds_interfaces or not Workspace(Path(one).resolve()).packages
    ]
    if workspace is not None:
        given = [Path(one).resolve() for one in path]
        roots = (place for place in workspace.roots if not any(map(place.is_relative_to, given)))
        folders += [str(place) for place in roots if Workspace(place).holds_interfaces]
    return folders


def _row(package: Package) -> tuple[Any, ...]:
    files = package.known_files
    known = None if files is None else [(name.kind, name.name, str(path)) for name, path in files.items()]
    return package.name, str(package.folder), package.origin, package.from_source, known


def _package(name: str, folder: str, origin: str, from_source: bool, known: list[Any] | None) -> Package:
    files = None if known is None else {RosName(name, kind, stem): Path(path) for kind, stem, path in known}
    return Package(name, Path(folder), origin, from_source, files)


def cached(settings: object, scan: Callable[[], Any]) -> Any:
    """Return the result of the function `scan`, from the cache if `settings` and all paths that the function read are
    unchanged.

    The result must consist of types that `marshal` supports.
    """
    try:
        place = os.getcwd()
    except OSError:  # it was deleted
        place = ""
    folder = disk_cache.own_folder()
    if folder is None or not place:
        return scan()
    words = f"{disk_cache.version()} {place} {settings!r}"
    file = folder / f"{disk_cache.digest(words.encode(errors='surrogatepass'))}.scan"
    with suppress(OSError, ValueError, EOFError, TypeError):
        stamps, result = marshal.loads(disk_cache.read_checked(file))
        if ReadPaths(stamps).are_unchanged():
            return result
    read, result = ReadPaths.of(scan)
    if read.newest_ns < time_ns() - MIN_AGE_NS:
        disk_cache.store_checked(file, marshal.dumps((read.stamps, result)), max_files=_MAX_FILES)
    return result
