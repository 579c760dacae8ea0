"""Which interfaces there are, by what the resource index says."""

from __future__ import annotations

import os
from collections.abc import Collection

from ament_index_python import get_resource, get_resources, has_resource

_RESOURCE = "rosidl_interfaces"


def get_interface_packages() -> dict[str, str]:
    """The prefix of each package with interfaces, by its name."""
    return get_resources(_RESOURCE)


def get_interfaces(package_names: Collection[str] = ()) -> dict[str, list[str]]:
    """Names such as ``msg/String`` by package; of all packages when none is named.

    Raises:
        LookupError: there is no such package.
    """
    return _of_kind(package_names, "", None)


def get_message_interfaces(package_names: Collection[str] = ()) -> dict[str, list[str]]:
    """The messages among `get_interfaces`."""
    return _of_kind(package_names, "msg/", (".idl", ".msg"))


def get_service_interfaces(package_names: Collection[str] = ()) -> dict[str, list[str]]:
    """The services among `get_interfaces`."""
    return _of_kind(package_names, "srv/", (".idl", ".srv"))


def get_action_interfaces(package_names: Collection[str] = ()) -> dict[str, list[str]]:
    """The actions among `get_interfaces`."""
    return _of_kind(package_names, "action/", (".idl", ".action"))


def get_interface_path(interface_name: str) -> str:
    """The file that defines an interface, such as ``std_msgs/msg/String`` or ``std_msgs/msg/String.idl``.

    Raises:
        ValueError: no legal name.
        LookupError: there is no such package or interface.
    """
    parts = interface_name.split("/")
    if len(parts) < 2:
        raise ValueError(f"Invalid name '{interface_name}'. Expected at least two parts separated by '/'")
    if not all(parts):
        raise ValueError(f"Invalid name '{interface_name}'. Must not contain empty parts")
    if ".." in parts:
        raise ValueError(f"Invalid name '{interface_name}'. Must not contain '..'")
    prefix = has_resource("packages", parts[0])
    if not prefix:
        raise LookupError(f"Unknown package '{parts[0]}'")
    installed = os.path.join(prefix, "share", *parts)
    in_sources = os.path.join(prefix, *parts[1:])  # of a package that is not installed the prefix is its folder
    for path in (installed, in_sources):
        for suffix in (f".{parts[-2]}", ".idl") if "." not in parts[-1] else ("",):
            if os.path.isfile(path + suffix):
                return path + suffix
    shown = installed if "." in parts[-1] else f"{installed}.idl"
    raise LookupError(f"Could not find the interface '{shown}'")


def _of_kind(packages: Collection[str], start: str, suffixes: tuple[str, ...] | None) -> dict[str, list[str]]:
    """Visible interfaces that begin and end so."""
    found: dict[str, list[str]] = {}
    for package in packages or get_resources(_RESOURCE):
        if not has_resource("packages", package):
            raise LookupError(f"Unknown package '{package}'")
        if not has_resource(_RESOURCE, package):
            continue
        files = get_resource(_RESOURCE, package)[0].splitlines()
        names = [
            os.path.splitext(file)[0]
            for file in files
            if "_" not in file and file.startswith(start) and (suffixes is None or file.endswith(suffixes))
        ]
        if names:
            found[package] = [*dict.fromkeys(names)]
    return found
