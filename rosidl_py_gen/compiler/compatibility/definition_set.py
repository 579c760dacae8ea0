"""Sets of message definitions that can be compared: the messages of checked registries, with their type hashes.

Source locations are for display and are not compared.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

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
    from rosidl_py_gen.compiler.frontend.model import ConstantDef
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


class AmbiguousTypeError(RosidlError):
    """Error for two different definitions of one type in sets that are used together; the user must select
    one of them.
    """


def known_constants(message: MessageDef) -> tuple[ConstantDef, ...] | None:
    """Return the constants of a message; None if they are unknown, as for type descriptions without text."""
    return None if message.source.format == "implicit" and not message.constants else message.constants


def comparison_key(message: MessageDef, *, with_constants: bool) -> tuple[object, ...]:
    """Return the values by which message definitions are compared: fields with types and defaults, and constants."""
    constants = [(one.name, one.type, repr(one.value)) for one in message.constants if with_constants]
    return [(one.name, canonical_type(one.type), default_text(one.default)) for one in message.fields], constants


def canonical_type(kind: FieldType) -> FieldType:
    """Return a field type as type descriptions spell it, which do not distinguish ``char`` and ``uint8`` of
    .msg files.
    """
    return replace(kind, base="uint8") if kind.base == "char" else kind


@dataclass(frozen=True, slots=True)
class DefinitionSet:
    """Set of interface definitions with their messages and hashes.

    Attributes:
        interfaces: names of an interface's messages by its full name: a message itself, or the sections of a service or
            action.
        messages: the messages of the interfaces and all messages that they refer to, by full name.
        hashes: RIHS01 hashes of all types, with services and actions.
    """

    interfaces: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    messages: Mapping[str, MessageDef] = field(default_factory=dict)
    hashes: Mapping[str, str] = field(default_factory=dict)


def collect(registry: InterfaceRegistry, names: Iterable[RosName]) -> DefinitionSet:
    """Return the set of the named interfaces, which are checked, and of all messages that they refer to."""
    interfaces: dict[str, tuple[str, ...]] = {}
    messages: dict[str, MessageDef] = {}
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
                messages[one], hashes[one] = message, registry.type_hash(one)
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
    """Return the definitions of a recording, in which the constants of a message without constants count as unknown.

    Recorders may omit constants.
    """
    messages = {
        name: one if one.constants else one._replace(source=one.source._replace(format="implicit"))
        for name, one in definitions.messages.items()
    }
    return replace(definitions, messages=messages)


def merge(parts: Iterable[tuple[str, DefinitionSet]]) -> DefinitionSet:
    """Return the union of several definition sets; errors name the origin of each set.

    Raises:
        AmbiguousTypeError: two sets define a type differently.
    """
    interfaces: dict[str, tuple[str, ...]] = {}
    messages: dict[str, MessageDef] = {}
    hashes: dict[str, str] = {}
    places: dict[str, str] = {}
    for place, definitions in parts:
        for name, message in definitions.messages.items():
            before = messages.setdefault(name, message)
            places.setdefault(name, place)
            are_known = None not in (known_constants(before), known_constants(message))
            keys = (comparison_key(one, with_constants=are_known) for one in (before, message))
            if before is not message and (hashes[name] != definitions.hashes[name] or operator.ne(*keys)):
                raise AmbiguousTypeError(
                    f"there are two definitions of {name}: {hashes[name]} of {places[name]}, and "
                    f"{definitions.hashes[name]} of {place}"
                )
            if known_constants(before) is None:
                messages[name] = message
            hashes.setdefault(name, definitions.hashes[name])
        interfaces.update(definitions.interfaces)
        hashes.update(definitions.hashes)
    return DefinitionSet(dict(sorted(interfaces.items())), messages, hashes)
