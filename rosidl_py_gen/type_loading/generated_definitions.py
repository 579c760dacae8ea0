"""Definitions of importable generated packages, for types that are not on the search path.

A generated class has names, types, bounds and default values of its fields, but no comments and no types of constants.
"""

from __future__ import annotations

import os
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from rosidl_py_gen.base.descriptions import individual_descriptions
from rosidl_py_gen.base.generated_files import is_generated
from rosidl_py_gen.base.installed_classes import find_installed_class
from rosidl_py_gen.base.names import KINDS, RosName, split_ros_name
from rosidl_py_gen.base.project import GeneratedPackages
from rosidl_py_gen.cdr.type_queries import type_description
from rosidl_py_gen.compiler.frontend.type_description_reader import registry_from_descriptions
from rosidl_py_gen.errors import InvalidNameError, display_path

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


_EXPORTS = re.compile(r"__all__ = \[([^\]]*)\]")


def generated_names() -> dict[RosName, Path]:
    """Return the interfaces of importable generated packages with the packages' folders, without an import."""
    found: dict[RosName, Path] = {}
    current = [finder.folder for finder in sys.meta_path if isinstance(finder, GeneratedPackages)]
    for entry in map(Path, [*sys.path, *current]):
        try:
            folders = [Path(one.path) for one in os.scandir(entry) if one.name.isidentifier()]
        except OSError:  # a zip file, or nothing
            continue
        for folder, kind in ((folder, kind) for folder in folders for kind in KINDS):
            file = folder / kind / "__init__.py"
            if is_generated(file):
                exports = _EXPORTS.search(file.read_text(encoding="utf-8", errors="replace"))
                stems = re.findall(r'"([A-Za-z0-9]+)_?"', exports[1]) if exports else []
                for stem in stems:
                    found.setdefault(RosName(folder.name, kind, stem), folder)
    return found


def registry_of_generated_class(text: str) -> tuple[InterfaceRegistry, RosName, str] | None:
    """Return the definition of a generated class.

    Args:
        text: ``pkg/kind/Name``, or ``pkg/Name`` of any kind.

    Returns:
        The definition, its full name, and a note about its origin; None if no such class can be imported.
    """
    for kind in KINDS if text.count("/") == 1 else ("msg",):
        try:
            name = split_ros_name(text, kind)
        except InvalidNameError:
            return None
        cls = find_installed_class(name, "")
        if cls is not None:
            individuals = individual_descriptions(type_description(cls))
            is_service = name.kind == "srv" and "_" not in name.name
            file = import_module(cls.__module__).__file__ or ""
            note = f"{name} is not on the search path: this is its generated class in {display_path(file)}"
            return (
                registry_from_descriptions(name, individuals, {}, is_service),
                name,
                f"{note}, without comments and constants",
            )
    return None
