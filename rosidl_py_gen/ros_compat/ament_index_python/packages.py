"""Functions that return the prefix, share folder and list of packages."""

import os
import re
import warnings
from pathlib import Path

from ament_index_python.constants import AMENT_PREFIX_PATH_ENV_VAR
from ament_index_python.resources import get_resource, get_resources
from ament_index_python.search_paths import get_search_paths
from rosidl_py_gen import found_packages


class PackageNotFoundError(KeyError):
    """Raised if a package is neither installed nor in the workspace."""


def get_packages_with_prefixes() -> dict[str, str]:
    """Return a dict from package name to prefix.

    For a package that is not installed, the value is its source folder.
    """
    return get_resources("packages")


def get_package_prefix(package_name: str) -> str:
    """Return the prefix in which a package is installed; for a package that is not installed, its source folder.

    Raises:
        PackageNotFoundError: the package does not exist.
        ValueError: the name is invalid.
    """
    if re.fullmatch("[a-zA-Z0-9][a-zA-Z0-9_-]+", package_name, re.ASCII) is None:
        raise ValueError(f"'{package_name}' is not a valid package name")
    try:
        return get_resource("packages", package_name)[1]
    except LookupError:
        search_paths = get_search_paths() if os.environ.get(AMENT_PREFIX_PATH_ENV_VAR) else []
        raise PackageNotFoundError(f"package '{package_name}' not found, searching: {search_paths}") from None


def get_package_share_directory(package_name: str, print_warning: bool = True) -> str:
    """Return ``share/<package>`` of an installed package, else the source folder of the package.

    If setup.py or CMakeLists.txt of the sources install files to other paths, the result is a folder of links that
    contains both the sources and the installed paths.

    Raises:
        PackageNotFoundError: the package does not exist.
        ValueError: the name is invalid.
    """
    path = _share_folder(package_name)
    if print_warning and not os.path.exists(path):
        warnings.warn(f"Share directory for {package_name} ({path}) does not exist.", stacklevel=2)
    return path


def get_package_share_path(package_name: str, print_warning: bool = True) -> Path:
    """Return the folder of `get_package_share_directory` as a `Path`."""
    path = Path(_share_folder(package_name))
    if print_warning and not path.exists():
        warnings.warn(f"Share path for {package_name} ({path}) does not exist.", stacklevel=2)
    return path


def _share_folder(name: str) -> str:
    prefix = get_package_prefix(name)
    package = found_packages().get(name)
    if package is not None and str(package.folder) == prefix:
        return str(package.share)
    return os.path.join(prefix, "share", name)
