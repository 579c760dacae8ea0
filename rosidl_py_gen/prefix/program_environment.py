"""Environment variables and imports of a program that `rosidl-py run` starts, with a prefix of its workspaces.

The prefix is in the cache, and child processes of the program find all packages in it. It is built again only if files
or folders have changed.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

from rosidl_py_gen.base.resources import RUN_PREFIX
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.compiler.frontend import PackageFiles, ReadPaths, Workspace
from rosidl_py_gen.prefix.environment import SITE_PACKAGES, roots, variables, workspaces
from rosidl_py_gen.type_loading import CacheFolder, cached


def set_environment(place: Path, paths: Sequence[str]) -> None:
    """Set environment variables of ROS, with a prefix in which child processes of the program find all packages."""
    prefix = None
    if os.name != "nt":  # it cannot have links
        try:
            prefix = _cached_prefix(workspaces(paths, place))
        except CommandError as error:
            terminal_output.note(f"warning: programs that this one starts will not find rclpy: {error}")
    os.environ.update(variables(prefix) | {RUN_PREFIX: str(prefix or "")})
    if prefix is not None:
        sys.meta_path.append(_PrefixFinder(prefix))


class _PrefixFinder:
    """Import finder for modules that are in a prefix, such as modules that a package installs as data files."""

    def __init__(self, prefix: Path) -> None:
        self._places = [str(prefix / SITE_PACKAGES)]

    def find_spec(self, name: str, path: object = None, target: ModuleType | None = None) -> ModuleSpec | None:
        return PathFinder.find_spec(name, self._places, target) if path is None else None


def _cached_prefix(workspaces: Sequence[Workspace]) -> Path:
    """Return a prefix of workspaces in the cache; it is built again only if files or folders have changed."""
    built = []

    def build() -> list[str]:
        # Slow to import.
        from rosidl_py_gen.prefix.build import STATE, build_prefix

        for place in sys.path:
            ReadPaths.note(place)
        copies = [replace(one) for one in workspaces]  # a workspace that was read before notes no paths
        prefix = build_prefix(roots(copies), runs_setup=True)
        for folder in prefix.packages.values():
            PackageFiles(folder).note_folders()
        ReadPaths.note(prefix.folder / STATE)
        built.append(prefix)
        return [str(prefix.folder), *prefix.notes]

    folder, *notes = cached(("prefix", sys.executable, sys.path, workspaces), build)
    if not built and not CacheFolder(Path(folder)).is_usable():
        # The temporary prefix of another process, or other users have been able to enter the prefix.
        folder, *notes = build()
    for text in notes:
        terminal_output.note_once(f"warning: {text}")
    return Path(folder)
