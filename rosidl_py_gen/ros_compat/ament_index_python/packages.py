"""The folders of packages."""

from __future__ import annotations

import os
import re
import warnings
from pathlib import Path

from ament_index_python.constants import AMENT_PREFIX_PATH_ENV_VAR
from ament_index_python.resources import get_resource, get_resources
from ament_index_python.search_paths import get_search_paths
from rosidl_py_gen import found_packages


class PackageNotFoundError(KeyError):
    """There is no package of this name, installed or in the workspace."""


def get_packages_with_prefixes() -> dict[str, str]:
    """The prefix of each package, by its name; that of one that is not installed is its folder."""
    return get_resources("packages")


def get_package_prefix(package_name: str) -> str:
    """The prefix that a package is installed in; of one that is not installed its folder.

    Raises:
        PackageNotFoundError: there is no such package.
        ValueError: no legal name.
    """
    if re.fullmatch("[a-zA-Z0-9][a-zA-Z0-9_-]+", package_name, re.ASCII) is None:
        raise ValueError(f"'{package_name}' is not a valid package name")
    try:
        return get_resource("packages", package_name)[1]
    except LookupError:
        searched = get_search_paths() if os.environ.get(AMENT_PREFIX_PATH_ENV_VAR) else []
        text = f"package '{package_name}' not found, searching: {searched}"
        raise PackageNotFoundError(text) from None


def get_package_share_directory(package_name: str, print_warning: bool = True) -> str:
    """Return ``share/<package>`` of an installed package, else the source folder of the package.

    Where setup.py or CMakeLists.txt install files under other paths than they have in the sources, it is a folder of
    links that has both.

    Raises:
        PackageNotFoundError: there is no such package.
        ValueError: no legal name.
    """
    path = _share(package_name)
    if print_warning and not os.path.exists(path):
        warnings.warn(f"Share directory for {package_name} ({path}) does not exist.", stacklevel=2)
    return path


def get_package_share_path(package_name: str, print_warning: bool = True) -> Path:
    """The same as a path."""
    path = Path(_share(package_name))
    if print_warning and not path.exists():
        warnings.warn(f"Share path for {package_name} ({path}) does not exist.", stacklevel=2)
    return path


def _share(name: str) -> str:
    prefix = get_package_prefix(name)
    found = found_packages().get(name)
    if found is not None and str(found.folder) == prefix:
        return str(found.share)
    return os.path.join(prefix, "share", name)
