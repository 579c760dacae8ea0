"""Definitions as plain values that can be compared: interfaces, fields, constants, hashes.

They come from checked registries. Locations are for display and are not compared.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.descriptions import default_text
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.compiler.frontend.model import (
    DERIVED_TYPES_PACKAGES,
    MessageDef,
    messages_of,
    nested_types,
    sections_of,
)
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.model import Location
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


class AmbiguousTypeError(RosidlError):
    """The definitions to compare have two definitions of one type; select the part to compare."""


class FieldDefinition(NamedTuple):
    """A field; `default` and `unit` may be empty, `place` is ``path:line:column``."""

    name: str
    type: FieldType
    default: str = ""
    unit: str = ""
    place: str = ""


class ConstantDefinition(NamedTuple):
    """A constant; `value` is a Python literal."""

    name: str
    type: str
    value: str
    place: str = ""


class MessageDefinition(NamedTuple):
    """A message; `constants` is None if they are unknown, as for type descriptions without text."""

    name: str
    fields: tuple[FieldDefinition, ...]
    constants: tuple[ConstantDefinition, ...] | None

    def comparison_key(self) -> tuple[object, ...]:
        """Return the values to compare: names, types and defaults of fields, and constants, without locations."""
        constants = None if self.constants is None else tuple(one[:3] for one in self.constants)
        return tuple((one.name, canonical_type(one.type), one.default) for one in self.fields), constants


def canonical_type(kind: FieldType) -> FieldType:
    """Return a type as in type descriptions, which do not distinguish ``char`` and ``uint8`` of .msg files."""
    return replace(kind, base="uint8") if kind.base == "char" else kind


@dataclass(frozen=True, slots=True)
class DefinitionSet:
    """A set of definitions.

    Attributes:
        interfaces: full name -> the message itself, or the sections of a service or action.
        messages: these messages, and those that they refer to.
        hashes: RIHS01 hashes of all types, with services and actions.
    """

    interfaces: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    messages: Mapping[str, MessageDefinition] = field(default_factory=dict)
    hashes: Mapping[str, str] = field(default_factory=dict)


def collect(registry: InterfaceRegistry, names: Iterable[RosName]) -> DefinitionSet:
    """Return the definitions of checked interfaces, and of the messages that they refer to."""
    interfaces: dict[str, tuple[str, ...]] = {}
    messages: dict[str, MessageDefinition] = {}
    hashes: dict[str, str] = {}
    for name in names:
        interface = registry.interface(name)
        assert interface is not None, name
        interfaces[str(name)] = tuple(str(section.name) for section in sections_of(interface))
        hashes[str(name)] = registry.type_hash(str(name))
        pending = [str(one.name) for one in messages_of(interface)]
        while pending:
            one = pending.pop()
            if one not in messages:
                message = registry.message(one)
                assert message is not None, one
                messages[one], hashes[one] = _message(message), registry.type_hash(one)
                pending += [item.type.base for item in message.fields if item.type.is_message]
    return DefinitionSet(interfaces, messages, hashes)


def collect_with_dependencies(registry: InterfaceRegistry, top: RosName) -> DefinitionSet:
    """Return the definitions of a checked interface and of all interfaces that it refers to."""
    needed: dict[RosName, None] = {}
    pending = [top]
    while pending:
        name = pending.pop()
        if name in needed:
            continue
        needed[name] = None
        interface = registry.interface(name)
        assert interface is not None, name
        for nested in map(split_ros_name, sorted(nested_types(interface))):
            if name.kind == "msg" or nested.package not in DERIVED_TYPES_PACKAGES:
                pending.append(registry.owner(nested) or nested)
    return collect(registry, needed)


def as_recorded(definitions: DefinitionSet) -> DefinitionSet:
    """Return definitions of a recording: recorders may omit constants, so no constants means unknown constants."""
    messages = {name: one._replace(constants=one.constants or None) for name, one in definitions.messages.items()}
    return replace(definitions, messages=messages)


def merge(parts: Iterable[tuple[str, DefinitionSet]]) -> DefinitionSet:
    """Return the union of sets with the names of their origins; raises `AmbiguousTypeError`."""
    interfaces: dict[str, tuple[str, ...]] = {}
    messages: dict[str, MessageDefinition] = {}
    hashes: dict[str, str] = {}
    places: dict[str, str] = {}
    for place, definitions in parts:
        for name, message in definitions.messages.items():
            before = messages.setdefault(name, message)
            places.setdefault(name, place)
            if before is not message and (
                hashes[name] != definitions.hashes[name]
                or _without_unknown(before, message) != _without_unknown(message, before)
            ):
                raise AmbiguousTypeError(
                    f"there are two definitions of {name}: {hashes[name]} of {places[name]}, and "
                    f"{definitions.hashes[name]} of {place}"
                )
            if before.constants is None and message.constants is not None:
                messages[name] = message
            hashes.setdefault(name, definitions.hashes[name])
        interfaces.update(definitions.interfaces)
        hashes.update(definitions.hashes)
    return DefinitionSet(dict(sorted(interfaces.items())), messages, hashes)


def _without_unknown(one: MessageDefinition, other: MessageDefinition) -> tuple[object, ...]:
    """Return the values to compare, without constants if those of the other message are unknown."""
    return one._replace(constants=None).comparison_key() if other.constants is None else one.comparison_key()


def _message(message: MessageDef) -> MessageDefinition:
    fields = tuple(
        FieldDefinition(one.name, one.type, default_text(one.default), one.unit, _place(one.location))
        for one in message.fields
    )
    constants = tuple(
        ConstantDefinition(one.name, str(one.type), repr(one.value), _place(one.location)) for one in message.constants
    )
    has_constants = message.source.format != "implicit" or bool(constants)
    return MessageDefinition(str(message.name), fields, constants if has_constants else None)


def _place(location: Location) -> str:
    return f"{location.source.path}:{location.line}:{location.column}" if location.source.text else ""
