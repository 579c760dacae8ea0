"""Generated classes that can be imported: those of the user's packages, of `msgs`, and of a wheel's `pregenerated`."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.base.generated_files import is_generated
from rosidl_py_gen.base.names import py_name

if TYPE_CHECKING:
    from importlib.machinery import ModuleSpec

    from rosidl_py_gen.base.names import RosName

MSGS_PACKAGE = "rosidl_py_gen.msgs."
"""Import prefix of the packages that the runtime needs."""
PREGENERATED_PACKAGE = "rosidl_py_gen.pregenerated."
"""Import prefix of the bundled interfaces, which are generated when a wheel is built; a checkout has none."""


ROS_PACKAGE_INDEX = os.path.join("share", "ament_index", "resource_index", "rosidl_interfaces")
"""Folder below an installation prefix with one file per interface package; wheels of ROS install into it, too."""


def has_installed_ros_packages() -> bool:
    """Return True if the environment has interface packages of ROS, such as the wheels ``ros-jazzy-std-msgs``."""
    return os.path.isdir(os.path.join(sys.prefix, ROS_PACKAGE_INDEX))


def find_installed_class(name: RosName, *roots: str) -> type | None:
    """Return the importable generated class of an interface; None if there is none.

    No other package is imported: an import runs code, and names may be from files and networks.

    Args:
        name: name of the interface.
        roots: import prefixes in order; by default packages of the user, then `rosidl_py_gen.msgs`.
    """
    for root in roots or ("", MSGS_PACKAGE):
        # The import hook can add modules to a package; only generated files count here.
        if not (
            _is_generated_package(root + name.package) and _is_generated_package(f"{root}{name.package}.{name.kind}")
        ):
            continue
        try:
            package = import_module(f"{root}{name.package}.{name.kind}")
            cls = getattr(package, py_name(name.name), None)
        except ImportError:
            continue
        if isinstance(cls, type) and getattr(getattr(cls, "_TYPE", None), "name", "") == str(name):
            return cls
    return None


def _is_generated_package(package: str) -> bool:
    loaded = sys.modules.get(package)
    try:
        spec: ModuleSpec | None = loaded.__spec__ if loaded is not None else find_spec(package)
    except (ImportError, ValueError, AttributeError):
        return False
    origin = spec.origin if spec is not None else None
    if origin is None or not origin.endswith("__init__.py"):
        return False
    return is_generated(Path(origin))
