"""The resource index of installed packages.

Packages that are not installed have two resources here: that they are there, and which interfaces they define. Their
prefix is their folder.
"""

from __future__ import annotations

import os
from typing import Literal

from ament_index_python.constants import AMENT_PREFIX_PATH_ENV_VAR, RESOURCE_INDEX_SUBFOLDER
from ament_index_python.search_paths import get_search_paths
from rosidl_py_gen import found_packages

_PACKAGES, _INTERFACES = "packages", "rosidl_interfaces"


class InvalidResourceTypeNameError(ValueError):
    """The name of a resource type has a path separator in it."""


class InvalidResourceNameError(ValueError):
    """The name of a resource has a path separator in it."""


def get_resource(resource_type: str, resource_name: str) -> tuple[str, str]:
    """The content of a resource, and the prefix that has it.

    Raises:
        LookupError: there is none.
        OSError: it cannot be read.
        InvalidResourceTypeNameError, InvalidResourceNameError: a name with a path separator.
    """
    prefix = has_resource(resource_type, resource_name)
    if prefix is False:
        raise LookupError(f"Could not find the resource '{resource_name}' of type '{resource_type}'")
    path = _place(prefix, resource_type, resource_name)
    if not os.path.isfile(path):
        return _of_sources(resource_type)[resource_name][1], prefix
    try:
        with open(path, encoding="utf-8") as file:
            return file.read(), prefix
    except OSError as error:
        text = f"Could not open the resource '{resource_name}' of type '{resource_type}':\n{error}"
        raise OSError(text) from error


def get_resources(resource_type: str) -> dict[str, str]:
    """The prefix of each resource of a type, by its name.

    Raises:
        InvalidResourceTypeNameError: a name with a path separator.
    """
    _check(resource_type)
    found: dict[str, str] = {}
    for prefix in _prefixes():
        for name in _names(_place(prefix, resource_type)):
            if not os.path.isdir(_place(prefix, resource_type, name)):
                found.setdefault(name, prefix)
    for name, (folder, _) in _of_sources(resource_type).items():
        found.setdefault(name, folder)
    return found


def get_resource_types() -> set[str]:
    """All types of resources."""
    found = {name for prefix in _prefixes() for name in _names(_place(prefix)) if os.path.isdir(_place(prefix, name))}
    return found | {name for name in (_PACKAGES, _INTERFACES) if _of_sources(name)}


def has_resource(resource_type: str, resource_name: str) -> str | Literal[False]:
    """The prefix that has a resource, or False.

    Raises:
        InvalidResourceTypeNameError, InvalidResourceNameError: a name with a path separator.
    """
    _check(resource_type)
    assert resource_name, "The resource name must not be empty"
    if "/" in resource_name or "\\" in resource_name:
        raise InvalidResourceNameError(f"Resource name '{resource_name}' is invalid")
    for prefix in _prefixes():
        if os.path.isfile(_place(prefix, resource_type, resource_name)):
            return prefix
    found = _of_sources(resource_type).get(resource_name)
    return False if found is None else found[0]


def _check(resource_type: str) -> None:
    assert resource_type, "The resource type must not be empty"
    if "/" in resource_type or "\\" in resource_type:
        raise InvalidResourceTypeNameError(f"Resource type '{resource_type}' is invalid")


def _prefixes() -> list[str]:
    return get_search_paths() if os.environ.get(AMENT_PREFIX_PATH_ENV_VAR) else []


def _place(prefix: str, *names: str) -> str:
    return os.path.join(prefix, RESOURCE_INDEX_SUBFOLDER, *names)


def _names(folder: str) -> list[str]:
    try:
        return [name for name in os.listdir(folder) if not name.startswith(".")]
    except (FileNotFoundError, NotADirectoryError):
        return []


def _of_sources(resource_type: str) -> dict[str, tuple[str, str]]:
    """Folder and content of what packages have that are not installed."""
    if resource_type not in (_PACKAGES, _INTERFACES):
        return {}
    found = found_packages().values()
    if resource_type == _PACKAGES:
        return {one.name: (str(one.folder), "") for one in found}
    return {one.name: (str(one.folder), "\n".join(one.interfaces)) for one in found if one.interfaces}
