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
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen.base.descriptions import TypeDescriptions
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.project import GeneratedPackages
from rosidl_py_gen.base.resources import GeneratedCode
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.cdr.layout import Alignment
from rosidl_py_gen.cdr.structured_arrays import cached_per_class
from rosidl_py_gen.cdr.type_queries import hashes_of, type_description, type_name
from rosidl_py_gen.errors import DecodeError, EncodeError, InvalidNameError, TypeNotFoundError, display_path
from rosidl_py_gen.type_loading.class_lookup import (
    ClassSearch,
    class_of_registry,
    distribution_definitions,
    find_installed_class,
    registry_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.base.descriptions import Description
    from rosidl_py_gen.compiler.frontend import DescribedInterface, InterfaceRegistry
    from rosidl_py_gen.type_loading.class_lookup import SearchFolders

_EVENT = "_Event"
_EXPORTS = re.compile(r"__all__ = \[([^\]]*)\]")


class DescribedType:
    """Type that type descriptions describe, such as the descriptions of another node.

    Its methods raise `DefinitionError` if the description is invalid or too large, and `InvalidNameError` for an
    invalid name.
    """

    def __init__(
        self,
        name: str,
        individuals: Mapping[str, Description],
        sources: Mapping[str, tuple[str, str]] | None = None,
        *,
        is_service: bool = False,
    ) -> None:
        """Store the descriptions, which are read when a method is called.

        Args:
            name: full name of the type.
            individuals: the description of each type alone, by name; derived messages may be missing.
            sources: encoding and text by type name; they add constants, comments and defaults if they have the same
                fields.
            is_service: the type is a service, which ``pkg/action/X_SendGoal`` does not show.
        """
        self._name, self._individuals, self._is_service = name, individuals, is_service
        self._sources = {} if sources is None else sources

    @classmethod
    def of_class(cls, described: type[Any]) -> DescribedType:
        """Return the type of a generated class, as the description of the class states it."""
        name = RosName.parse(type_name(described))
        individuals = TypeDescriptions.by_name(type_description(described))
        return cls(str(name), individuals, is_service=name.kind == "srv" and "_" not in name.name)

    @property
    def name(self) -> RosName:
        """Name of the type."""
        return RosName.parse(self._name)

    @property
    def is_complete(self) -> bool:
        """True if each message that the type's file states is described."""
        return all(message in self._individuals for message in self.messages)

    @property
    def messages(self) -> tuple[str, ...]:
        """Names of the messages that the type's file states, without the messages that ROS derives from them."""
        return self._interface.messages

    @property
    def _interface(self) -> DescribedInterface:
        from rosidl_py_gen.compiler.frontend import DescribedInterface

        return DescribedInterface(self.name, self._individuals, self._sources, self._is_service)

    def registry(self) -> InterfaceRegistry:
        """Return a checked registry with the type and all types that it refers to."""
        return self._interface.registry()

    def hashes(self) -> dict[str, str]:
        """Return the RIHS01 hashes of the type and of all types that belong to it or that it refers to, by name."""
        without_sources = DescribedType(self._name, self._individuals, is_service=self._is_service)
        return without_sources.registry().all_hashes(self._name)

    def load(self, path: SearchFolders = ()) -> type[Any]:
        """Return the class of the type, which is compiled unless a loaded or importable class has the same hash.

        Args:
            path: folders with interface packages, in which classes of the same hash are searched first.
        """
        return class_of_registry(self.registry(), self.name, path=path)


def definition_text(cls: type[Any]) -> str:
    """Return the definition text of a class with all types that it uses, for bags; `compile_definition` reads the text.

    The text is the text of the file with comments and constants, if the search path has the same definition; otherwise
    it is made from the class. Derived messages, such as ``X_Event``, have the text of their service or action; raises
    `TypeNotFoundError` if that is not on the search path.
    """
    from rosidl_py_gen.compiler.frontend import DefinitionText

    name = RosName.parse(type_name(cls))
    registry = registry_of(name)
    if registry is None or registry.all_hashes(str(name)) != hashes_of(cls):
        is_event = name.kind == "srv" and name.name.endswith(_EVENT)  # an event contains request and response
        if is_event:
            name = name._replace(name=name.name.removesuffix(_EVENT))
        elif "_" in name.name:
            raise TypeNotFoundError(f"{name} belongs to a service or action that is not on the search path")
        individuals = TypeDescriptions.by_name(type_description(cls))
        registry = DescribedType(str(name), individuals, is_service=is_event).registry()
    return DefinitionText(registry, registry.owner(name) or name).full


class GeneratedDefinition(NamedTuple):
    """Definition of an importable generated class.

    Attributes:
        registry: registry with the definition.
        name: full name of the type.
        note: text about the origin of the definition.
    """

    registry: InterfaceRegistry
    name: RosName
    note: str

    @classmethod
    def find(cls, text: str) -> GeneratedDefinition | None:
        """Return the definition of the class with the name ``pkg/kind/Name``, or ``pkg/Name``; None if no such class
        can be imported.
        """
        for kind in RosName.KINDS if text.count("/") == 1 else ("msg",):
            try:
                name = RosName.parse(text, kind)
            except InvalidNameError:
                return None
            found = find_installed_class(name, "")
            if found is not None:
                file = import_module(found.__module__).__file__ or ""
                note = f"{name} is not on the search path: this is its generated class in {display_path(file)}"
                registry = DescribedType.of_class(found).registry()
                return cls(registry, name, f"{note}, without comments and constants")
        return None

    @staticmethod
    def names() -> dict[RosName, Path]:
        """Return the interfaces of importable generated packages, each with its package folder; imports nothing."""
        found: dict[RosName, Path] = {}
        current = [finder.folder for finder in sys.meta_path if isinstance(finder, GeneratedPackages)]
        for entry in map(Path, [*sys.path, *current]):
            try:
                folders = [Path(one.path) for one in os.scandir(entry) if one.name.isidentifier()]
            except OSError:  # a zip file, or nothing
                continue
            for folder, kind in ((folder, kind) for folder in folders for kind in RosName.KINDS):
                file = folder / kind / "__init__.py"
                if GeneratedCode.is_generated(file):
                    exports = _EXPORTS.search(file.read_text(encoding="utf-8", errors="replace"))
                    stems = re.findall(r'"([A-Za-z0-9]+)_?"', exports[1]) if exports else []
                    for stem in stems:
                        found.setdefault(RosName(folder.name, kind, stem), folder)
        return found


class DistributionVariants:
    """Definitions that the type of a class has in the distributions that define it otherwise.

    Attributes:
        hashes: RIHS01 hash of each of these definitions by distribution, oldest distribution first.
    """

    def __init__(self, cls: type[Any]) -> None:
        self._cls = cls
        others = _other_descriptions(cls)
        self.hashes = {distro: TypeDescriptions.rihs01(description) for distro, description in others.items()}

    @classmethod
    def find(cls, name: str, type_hash: str) -> DistributionVariants | None:
        """Return the variants of the type with a name and hash; None if no class has this hash.

        Raises:
            RosidlError: the name is invalid, or a definition cannot be read.
        """
        found = ClassSearch().find(name, lambda hashes: hashes[name] == type_hash)
        return None if found is None else cls(found)

    @staticmethod
    def get_class(name: str, distro: str, path: SearchFolders = ()) -> type[Any]:
        """Return the message, service or action class that nodes of a distribution use.

        Definitions that this machine does not have are not considered.

        Args:
            name: full name of the type.
            distro: name of the distribution.
            path: folders that are searched first, as by `get_message`.

        Raises:
            RosidlError: as for `get_message`.
        """
        cls = ClassSearch(path, distro).get(name)
        if not issubclass(cls, Message) or find_installed_class(RosName.parse(name)) is not cls:
            return cls
        # A generated class contains the types of the distribution for which it was generated.
        return _class_in(distro, cls)

    def with_hash(self, type_hash: str) -> tuple[str, ...]:
        """Return the distributions whose definition has a hash, oldest first; empty if no distribution has it."""
        return tuple(distro for distro, one in self.hashes.items() if one == type_hash)

    def fits(self, data: Any, distro: str = "") -> bool:
        """Return True if data is exactly one message of the class, or, with `distro`, of its type in that distribution.

        After the message, only the padding of the network may follow.
        """
        try:
            cls = _class_in(distro, self._cls) if distro else self._cls
            size = len(cls._decode(data)._encode())
        except (DecodeError, EncodeError):
            return False
        return 0 <= len(data) - size < Alignment.NETWORK


@cached_per_class
def _class_in(distro: str, cls: type[Any]) -> type[Any]:
    """Return the class with the definition that the type of a class has in a distribution."""
    description = _other_descriptions(cls).get(distro)
    if description is None:
        return cls
    return DescribedType(cls._TYPE.name, TypeDescriptions.by_name(description)).load()


@cached_per_class
def _other_descriptions(cls: type[Any]) -> Mapping[str, Description]:
    own_hash, description = cls._TYPE.hash, type_description(cls)
    if TypeDescriptions.rihs01(description) != own_hash:  # a class of raw data has a hash without the fields
        return {}
    individuals = TypeDescriptions.by_name(description)
    replaced: dict[str, dict[str, Description]] = {distro: {} for distro in Distribution.BUNDLED}
    for name, own in individuals.items():
        for definition in distribution_definitions(name):
            found = type_description(definition.load())
            if _fields(found["type_description"]) != _fields(own):
                for distro in definition.distributions:
                    replaced[distro].update(TypeDescriptions.by_name(found))
    others = {
        distro: TypeDescriptions.assemble(cls._TYPE.name, {**individuals, **parts}.__getitem__)
        for distro, parts in replaced.items()
        if parts
    }
    return {distro: other for distro, other in others.items() if TypeDescriptions.rihs01(other) != own_hash}


def _fields(description: Description) -> list[tuple[object, object]]:
    return [(field["name"], field["type"]) for field in description["fields"]]
