"""Conversion of other nodes' type descriptions to classes, and of classes to definition texts, for types not on the
search path.

A loaded class of the same name and hash is used without a compilation, also for nested types. The limits of
descriptions are in `compiler/frontend/type_description_reader.py`. A generated class has names, types, bounds and
default values of its fields, but no comments and no types of constants.
"""

from __future__ import annotations

import os
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import individual_descriptions
from rosidl_py_gen.base.generated_classes import is_generated
from rosidl_py_gen.base.names import KINDS, RosName, split_ros_name
from rosidl_py_gen.base.project import GeneratedPackages
from rosidl_py_gen.cdr.type_queries import hashes_of, type_description, type_name
from rosidl_py_gen.errors import InvalidNameError, TypeNotFoundError, display_path
from rosidl_py_gen.type_loading.class_lookup import class_of_registry, find_installed_class, registry_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.base.descriptions import Description
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry
    from rosidl_py_gen.type_loading.class_lookup import SearchFolders

_EVENT = "_Event"
_EXPORTS = re.compile(r"__all__ = \[([^\]]*)\]")


def _registry(
    name: RosName, individuals: Mapping[str, Description], sources: Mapping[str, tuple[str, str]], is_service: bool
) -> InterfaceRegistry:
    from rosidl_py_gen.compiler.frontend.type_description_reader import registry_from_descriptions

    return registry_from_descriptions(name, individuals, sources, is_service)


def described_hashes(name: str, individuals: Mapping[str, Description], *, is_service: bool = False) -> dict[str, str]:
    """Return the RIHS01 hashes of a described type and of all types that belong to it or that it refers to, by name.

    Args:
        individuals: the description of each type alone, by name; derived messages may be missing.
        is_service: the type is a service, which ``pkg/action/X_SendGoal`` does not show.

    Raises:
        DefinitionError: the description is invalid or too large.
        InvalidNameError: a name is invalid.
    """
    return _registry(split_ros_name(name), individuals, {}, is_service).all_hashes(name)


def compile_described(
    name: str,
    individuals: Mapping[str, Description],
    sources: Mapping[str, tuple[str, str]],
    *,
    is_service: bool = False,
    path: SearchFolders = (),
) -> type[Any]:
    """Return the class of a type that type descriptions describe, such as the descriptions of another node.

    Args:
        individuals: the description of each type alone, by name; derived messages may be missing.
        sources: encoding and text by type name; they add constants, comments and defaults if they have the same fields.
        is_service: the type is a service, which ``pkg/action/X_SendGoal`` does not show.
        path: folders with interface packages, in which classes of the same hash are searched first.

    Raises:
        DefinitionError: the description is invalid or too large.
        InvalidNameError: a name is invalid.
    """
    top = split_ros_name(name)
    return class_of_registry(_registry(top, individuals, sources, is_service), top, path=path)


def definition_text(cls: type[Any]) -> str:
    """Return the definition text of a class with all types that it uses, for bags; `compile_definition` reads the text.

    The text is the text of the file with comments and constants, if the search path has the same definition; otherwise
    it is made from the class. Derived messages, such as ``X_Event``, have the text of their service or action; raises
    `TypeNotFoundError` if that is not on the search path.
    """
    from rosidl_py_gen.compiler.frontend.definition_text import full_text

    name = split_ros_name(type_name(cls))
    registry = registry_of(name)
    if registry is None or registry.all_hashes(str(name)) != hashes_of(cls):
        is_event = name.kind == "srv" and name.name.endswith(_EVENT)  # an event contains request and response
        if is_event:
            name = name._replace(name=name.name.removesuffix(_EVENT))
        elif "_" in name.name:
            raise TypeNotFoundError(f"{name} belongs to a service or action that is not on the search path")
        registry = _registry(name, individual_descriptions(type_description(cls)), {}, is_event)
    return full_text(registry, registry.owner(name) or name)


def generated_names() -> dict[RosName, Path]:
    """Return the interfaces of importable generated packages, each with its package folder, without importing them."""
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
    """Return the definition of an importable generated class with the name ``pkg/kind/Name``, or ``pkg/Name``.

    Returns:
        A registry with the definition, its full name, and a note about its origin; None if no such class can be
            imported.
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
            return _registry(name, individuals, {}, is_service), name, f"{note}, without comments and constants"
    return None
