"""Conversion of type descriptions to classes, and of classes to definition texts, for types not on the search path.

The descriptions come from other nodes, or are made for other ROS distributions than the distribution of a class. A
loaded class of the same name and hash is used without a compilation, also for nested types. The limits of descriptions
are in `compiler/frontend/type_description_reader.py`. A generated class has names, types, bounds and default values of
its fields, but no comments and no types of constants.

A type may also differ in another distribution because a type in it differs: `my_msgs/msg/Sonar` with a field
`sensor_msgs/Range` has another hash in each distribution whose `Range` differs. So the definition for a distribution is
made from the type's own definition, in which types that the distribution defines otherwise are replaced.
"""

from __future__ import annotations

import os
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.descriptions import full_description, individual_descriptions, rihs01
from rosidl_py_gen.base.distributions import DISTRIBUTIONS
from rosidl_py_gen.base.names import KINDS, RosName, split_ros_name
from rosidl_py_gen.base.project import GeneratedPackages
from rosidl_py_gen.base.resources import is_generated
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.cdr.layout import NETWORK_ALIGN
from rosidl_py_gen.cdr.structured_arrays import cached_per_class
from rosidl_py_gen.cdr.type_queries import hashes_of, type_description, type_name
from rosidl_py_gen.errors import DecodeError, EncodeError, InvalidNameError, TypeNotFoundError, display_path
from rosidl_py_gen.type_loading.class_lookup import (
    class_of_registry,
    distribution_definitions,
    find_class,
    find_installed_class,
    find_named_class,
    registry_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.base.descriptions import Description
    from rosidl_py_gen.compiler.frontend import InterfaceRegistry
    from rosidl_py_gen.type_loading.class_lookup import SearchFolders

_EVENT = "_Event"
_EXPORTS = re.compile(r"__all__ = \[([^\]]*)\]")


def _registry(
    name: RosName, individuals: Mapping[str, Description], sources: Mapping[str, tuple[str, str]], is_service: bool
) -> InterfaceRegistry:
    from rosidl_py_gen.compiler.frontend import registry_from_descriptions

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
    from rosidl_py_gen.compiler.frontend import DefinitionText

    name = split_ros_name(type_name(cls))
    registry = registry_of(name)
    if registry is None or registry.all_hashes(str(name)) != hashes_of(cls):
        is_event = name.kind == "srv" and name.name.endswith(_EVENT)  # an event contains request and response
        if is_event:
            name = name._replace(name=name.name.removesuffix(_EVENT))
        elif "_" in name.name:
            raise TypeNotFoundError(f"{name} belongs to a service or action that is not on the search path")
        registry = _registry(name, individual_descriptions(type_description(cls)), {}, is_event)
    return DefinitionText(registry, registry.owner(name) or name).full


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


def other_hashes(cls: type[Any]) -> Mapping[str, str]:
    """Return the hashes that a class's type has in the distributions whose definition differs, oldest distribution
    first.
    """
    return {distro: rihs01(description) for distro, description in _other_descriptions(cls).items()}


def distributions_with(name: str, own_hash: str, other_hash: str) -> tuple[str, ...]:
    """Return the distributions whose definition of a type has a hash, oldest first; empty if no distribution has it.

    Args:
        own_hash: hash of the definition that this process uses.

    Raises:
        RosidlError: the name is invalid, or a definition cannot be read.
    """
    cls = find_class(name, lambda hashes: hashes[name] == own_hash)
    return () if cls is None else tuple(one for one, text in other_hashes(cls).items() if text == other_hash)


@cached_per_class
def class_in(distro: str, cls: type[Any]) -> type[Any]:
    """Return the class with the definition that a class's type has in a given distribution."""
    description = _other_descriptions(cls).get(distro)
    if description is None:
        return cls
    found: type[Any] = compile_described(cls._TYPE.name, individual_descriptions(description), {})
    return found


def find_class_of(distro: str, name: str, path: SearchFolders) -> type[Any] | None:
    """Return the class that nodes of a distribution use for a type, as far as it is known on this machine.

    Returns None if it is not known.
    """
    cls = find_named_class(name, path=path, distro=distro)
    if cls is None or not issubclass(cls, Message) or find_installed_class(split_ros_name(name)) is not cls:
        return cls
    # A generated class contains the types of the distribution for which it was generated.
    return class_in(distro, cls)


def fits_exactly(cls: type[Any], data: Any) -> bool:
    """Return True if data is exactly one message of the class; after it, only the padding of the network may follow."""
    try:
        size = len(cls._decode(data)._encode())
    except (DecodeError, EncodeError):
        return False
    return 0 <= len(data) - size < NETWORK_ALIGN


@cached_per_class
def _other_descriptions(cls: type[Any]) -> Mapping[str, Description]:
    own_hash, description = cls._TYPE.hash, type_description(cls)
    if rihs01(description) != own_hash:  # a class of raw data has a hash without the fields
        return {}
    individuals = individual_descriptions(description)
    replaced: dict[str, dict[str, Description]] = {distro: {} for distro in DISTRIBUTIONS}
    for name, own in individuals.items():
        for definition in distribution_definitions(name):
            found = type_description(definition.load())
            if _fields(found["type_description"]) != _fields(own):
                for distro in definition.distributions:
                    replaced[distro].update(individual_descriptions(found))
    others = {
        distro: full_description(cls._TYPE.name, {**individuals, **parts}.__getitem__)
        for distro, parts in replaced.items()
        if parts
    }
    return {distro: other for distro, other in others.items() if rihs01(other) != own_hash}


def _fields(description: Description) -> list[tuple[object, object]]:
    return [(field["name"], field["type"]) for field in description["fields"]]
