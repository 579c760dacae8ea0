"""Environment variables of processes that use a prefix, and the cached prefix of workspaces."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from rosidl_py_gen.base.distributions import ASSUMED_VARIABLE, DEFAULT, ENVIRONMENT_VARIABLE, selected
from rosidl_py_gen.base.scanned_paths import note
from rosidl_py_gen.compiler.frontend.package_files import UnreadableError, files_below
from rosidl_py_gen.compiler.frontend.workspace import Workspace
from rosidl_py_gen.type_loading.scan_cache import cached

SITE_PACKAGES = f"lib/python{sys.version_info[0]}.{sys.version_info[1]}/site-packages"
FIXED = {"ROS_VERSION": "2", "ROS_PYTHON_VERSION": "3"}


def variables(prefix: Path | None) -> dict[str, str]:
    """Return the environment variables of a process that may use a prefix; lists continue with their current values."""
    found = {name: os.environ.get(name, value) for name, value in FIXED.items()} | of_distribution()
    for name, folder in folders(prefix).items() if prefix is not None else ():
        places = (str(folder), *filter(None, os.environ.get(name, "").split(os.pathsep)))
        found[name] = os.pathsep.join(dict.fromkeys(places))
    return found


def of_distribution() -> dict[str, str]:
    """Return the variables of the selected distribution; none if ROS_DISTRO has another value than the default."""
    choice = selected()
    if choice.is_explicit:
        return {ENVIRONMENT_VARIABLE: choice.name}
    is_default = os.environ.get(ENVIRONMENT_VARIABLE) in (None, "", os.environ.get(ASSUMED_VARIABLE))
    return {ASSUMED_VARIABLE: DEFAULT, ENVIRONMENT_VARIABLE: DEFAULT} if is_default else {}


def folders(prefix: Path) -> dict[str, Path]:
    """Return the folders of a prefix by the variables that list them."""
    return {"AMENT_PREFIX_PATH": prefix, "PYTHONPATH": prefix / SITE_PACKAGES, "PATH": prefix / "bin"}


def cached_prefix(workspaces: Sequence[Workspace]) -> Path:
    """Return the prefix of some workspaces in the cache; it is built again only if files or folders have changed.

    Raises:
        CommandError: the prefix cannot be written.
    """

    def build() -> str:
        from rosidl_py_gen.ros_cli.prefix.build import STATE, build_prefix  # slow to import

        for place in sys.path:
            note(place)
        copies = [replace(one) for one in workspaces]  # a workspace that was read before notes no paths
        prefix = build_prefix(root for one in copies if one.packages for root in one.roots)
        for folder in prefix.packages.values():
            with suppress(UnreadableError):
                files_below(folder)
        note(prefix.folder / STATE)
        return str(prefix.folder)

    return Path(cached(("prefix", sys.executable, sys.path, workspaces), build))
