"""Lists of interfaces (messages, services, actions), from the resource index."""

from __future__ import annotations

import os
from collections.abc import Collection

from ament_index_python.resources import get_resource, get_resources, has_resource

_RESOURCE = "rosidl_interfaces"


def get_interface_packages() -> dict[str, str]:
    """Return a dict from package name to prefix, for all packages with interfaces."""
    return get_resources(_RESOURCE)


def get_interfaces(package_names: Collection[str] = ()) -> dict[str, list[str]]:
    """Return a dict from package name to names of interfaces such as ``msg/String``; by default for all packages.

    Raises:
        LookupError: a package does not exist.
    """
    return _interfaces_of_kind(package_names, "", None)


def get_message_interfaces(package_names: Collection[str] = ()) -> dict[str, list[str]]:
    """Return a dict from package name to names of messages such as ``msg/String``; by default for all packages."""
    return _interfaces_of_kind(package_names, "msg/", (".idl", ".msg"))


def get_service_interfaces(package_names: Collection[str] = ()) -> dict[str, list[str]]:
    """Return a dict from package name to names of services such as ``srv/Trigger``; by default for all packages."""
    return _interfaces_of_kind(package_names, "srv/", (".idl", ".srv"))


def get_action_interfaces(package_names: Collection[str] = ()) -> dict[str, list[str]]:
    """Return a dict from package name to names of actions such as ``action/Fibonacci``; by default for all packages."""
    return _interfaces_of_kind(package_names, "action/", (".idl", ".action"))


def get_interface_path(interface_name: str) -> str:
    """Return the path of the definition file of ``std_msgs/msg/String``; the name may have an ending such as ``.idl``.

    Raises:
        ValueError: the name is invalid.
        LookupError: the package or interface does not exist.
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
    installed_path = os.path.join(prefix, "share", *parts)
    source_path = os.path.join(prefix, *parts[1:])  # a package that is not installed has its folder as prefix
    for path in (installed_path, source_path):
        for suffix in (f".{parts[-2]}", ".idl") if "." not in parts[-1] else ("",):
            if os.path.isfile(path + suffix):
                return path + suffix
    path_text = installed_path if "." in parts[-1] else f"{installed_path}.idl"
    raise LookupError(f"Could not find the interface '{path_text}'")


def _interfaces_of_kind(
    packages: Collection[str], folder: str, suffixes: tuple[str, ...] | None
) -> dict[str, list[str]]:
    interfaces: dict[str, list[str]] = {}
    for package in packages or get_resources(_RESOURCE):
        if not has_resource("packages", package):
            raise LookupError(f"Unknown package '{package}'")
        if not has_resource(_RESOURCE, package):
            continue
        files = get_resource(_RESOURCE, package)[0].splitlines()
        names = [
            os.path.splitext(file)[0]
            for file in files
            if "_" not in file and file.startswith(folder) and (suffixes is None or file.endswith(suffixes))
        ]
        if names:
            interfaces[package] = [*dict.fromkeys(names)]
    return interfaces
