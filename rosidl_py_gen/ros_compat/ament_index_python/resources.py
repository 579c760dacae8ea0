"""Functions that read the resource index of installed packages.

Packages that are not installed have two resources here: their existence and their interfaces. The prefix of such a
package is its source folder.
"""

from __future__ import annotations

import os
from typing import Literal

from ament_index_python.constants import AMENT_PREFIX_PATH_ENV_VAR, RESOURCE_INDEX_SUBFOLDER
from ament_index_python.search_paths import get_search_paths
from rosidl_py_gen import found_packages

_PACKAGES = "packages"
_INTERFACES = "rosidl_interfaces"
_RUN_PREFIX = "ROSIDL_PY_GEN_RUN_PREFIX"
_SOURCES = ""
"""Placeholder in a list of prefixes that stands for all packages which are not installed."""


class InvalidResourceTypeNameError(ValueError):
    """Raised if the name of a resource type has a path separator."""


class InvalidResourceNameError(ValueError):
    """Raised if the name of a resource has a path separator."""


def get_resource(resource_type: str, resource_name: str) -> tuple[str, str]:
    """Return the content of a resource (a file of the index), and the prefix that contains it.

    Raises:
        LookupError: the resource does not exist.
        OSError: the resource cannot be read.
        InvalidResourceTypeNameError, InvalidResourceNameError: a name has a path separator.
    """
    prefix = has_resource(resource_type, resource_name)
    if prefix is False:
        raise LookupError(f"Could not find the resource '{resource_name}' of type '{resource_type}'")
    path = _path(prefix, resource_type, resource_name)
    if not os.path.isfile(path):
        return _source_resources(resource_type)[resource_name][1], prefix
    with open(path, encoding="utf-8") as file:
        return file.read(), prefix


def get_resources(resource_type: str) -> dict[str, str]:
    """Return a dict from resource name to prefix, for all resources of a type.

    Raises:
        InvalidResourceTypeNameError: the name of the type has a path separator.
    """
    _check_type_name(resource_type)
    found: dict[str, str] = {}
    for prefix in _prefixes():
        if prefix == _SOURCES:
            here = {name: folder for name, (folder, _) in _source_resources(resource_type).items()}
        else:
            names = _list_names(_path(prefix, resource_type))
            here = {name: prefix for name in names if not os.path.isdir(_path(prefix, resource_type, name))}
        found = here | found
    return found


def get_resource_types() -> set[str]:
    """Return the names of all types of resources that the index contains."""
    types = {
        name
        for prefix in filter(None, _prefixes())
        for name in _list_names(_path(prefix))
        if os.path.isdir(_path(prefix, name))
    }
    return types | {name for name in (_PACKAGES, _INTERFACES) if _source_resources(name)}


def has_resource(resource_type: str, resource_name: str) -> str | Literal[False]:
    """Return the prefix that contains a resource, or False if there is none.

    Raises:
        InvalidResourceTypeNameError, InvalidResourceNameError: a name has a path separator.
    """
    _check_type_name(resource_type)
    assert resource_name, "The resource name must not be empty"
    if "/" in resource_name or "\\" in resource_name:
        raise InvalidResourceNameError(f"Resource name '{resource_name}' is invalid")
    for prefix in _prefixes():
        if prefix == _SOURCES:
            if (resource := _source_resources(resource_type).get(resource_name)) is not None:
                return resource[0]
        elif os.path.isfile(_path(prefix, resource_type, resource_name)):
            return prefix
    return False


def _check_type_name(resource_type: str) -> None:
    assert resource_type, "The resource type must not be empty"
    if "/" in resource_type or "\\" in resource_type:
        raise InvalidResourceTypeNameError(f"Resource type '{resource_type}' is invalid")


def _prefixes() -> list[str]:
    """Return the prefixes in the order of the search, with `_SOURCES` for packages that are not installed.

    `_SOURCES` precedes the prefix of ``rosidl-py run``, so that a program under ``rosidl-py run`` finds files of the
    workspace that no install rule mentions.
    """
    paths = get_search_paths() if os.environ.get(AMENT_PREFIX_PATH_ENV_VAR) else []
    of_run = [path for path in paths if path == os.environ.get(_RUN_PREFIX)]
    return [*(path for path in paths if path not in of_run), _SOURCES, *of_run]


def _path(prefix: str, *names: str) -> str:
    return os.path.join(prefix, RESOURCE_INDEX_SUBFOLDER, *names)


def _list_names(folder: str) -> list[str]:
    try:
        return [name for name in os.listdir(folder) if not name.startswith(".")]
    except (FileNotFoundError, NotADirectoryError):
        return []


def _source_resources(resource_type: str) -> dict[str, tuple[str, str]]:
    """Return the resources of packages that are not installed: a dict from resource name to source folder
    and content.
    """
    if resource_type not in (_PACKAGES, _INTERFACES):
        return {}
    packages = found_packages().values()
    if resource_type == _PACKAGES:
        return {package.name: (str(package.folder), "") for package in packages}
    return {
        package.name: (str(package.folder), "\n".join(package.interfaces)) for package in packages if package.interfaces
    }
