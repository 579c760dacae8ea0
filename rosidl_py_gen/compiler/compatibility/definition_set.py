"""What is compared of definitions: interfaces, fields, constants, hashes, as plain values.

Facts come from checked registries, whatever these were read from. Places are for people and never make a difference.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.descriptions import default_text
from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.compiler.frontend.model import ActionDef, MessageDef, ServiceDef, messages_of
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.model import Interface, Location
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


_IMPLIED_PACKAGES = ("service_msgs", "unique_identifier_msgs", "builtin_interfaces")
"""Of types that every service or action leads to."""


class AmbiguousTypeError(RosidlError):
    """What is compared has two definitions of a type; the user has to say which part of it is meant."""


class FieldDefinition(NamedTuple):
    """One field; `default` and `unit` are empty when there is none, `place` is ``path:line:column``."""

    name: str
    type: FieldType
    default: str = ""
    unit: str = ""
    place: str = ""


class ConstantFact(NamedTuple):
    """One constant; `value` as Python writes it."""

    name: str
    type: str
    value: str
    place: str = ""


class MessageDefinition(NamedTuple):
    """One message.

    Attributes:
        constants: None when nobody tells them, as for descriptions that come without their text.
    """

    name: str
    fields: tuple[FieldDefinition, ...]
    constants: tuple[ConstantFact, ...] | None

    def comparison_key(self) -> tuple[object, ...]:
        """What makes a difference."""
        constants = None if self.constants is None else tuple(one[:3] for one in self.constants)
        return tuple((one.name, canonical_type(one.type), one.default) for one in self.fields), constants


def canonical_type(kind: FieldType) -> FieldType:
    """A type as descriptions know it, which make no difference between ``char`` and ``uint8`` of .msg files."""
    return replace(kind, base="uint8") if kind.base == "char" else kind


@dataclass(frozen=True, slots=True)
class DefinitionSet:
    """A set of definitions.

    Attributes:
        interfaces: full name -> the messages it is written as: itself, or the sections of a service or action.
        messages: those, and every one they refer to.
        hashes: RIHS01 of all of them, services and actions included.
    """

    interfaces: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    messages: Mapping[str, MessageDefinition] = field(default_factory=dict)
    hashes: Mapping[str, str] = field(default_factory=dict)


def collect(registry: InterfaceRegistry, names: Iterable[RosName]) -> DefinitionSet:
    """Facts of checked interfaces, and of what they refer to as far as that is needed to read them."""
    interfaces: dict[str, tuple[str, ...]] = {}
    messages: dict[str, MessageDefinition] = {}
    hashes: dict[str, str] = {}
    for name in names:
        interface = registry.interface(name)
        assert interface is not None, name
        interfaces[str(name)] = _sections(interface)
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


def facts_with_needs(registry: InterfaceRegistry, top: RosName) -> DefinitionSet:
    """Facts of a checked interface and of every interface it leads to, as of something that has no other files."""
    needed: dict[RosName, None] = {}
    pending = [top]
    while pending:
        name = pending.pop()
        if name in needed:
            continue
        needed[name] = None
        interface = registry.interface(name)
        assert interface is not None, name
        own = {str(one.name) for one in messages_of(interface)}
        bases = {item.type.base for one in messages_of(interface) for item in one.fields if item.type.is_message}
        for base in sorted(bases - own):
            part = split_ros_name(base)
            if name.kind == "msg" or part.package not in _IMPLIED_PACKAGES:
                pending.append(registry.owner(part) or part)
    return collect(registry, needed)


def as_recorded(facts: DefinitionSet) -> DefinitionSet:
    """The same as a recorder tells it, who may leave out constants: where there are none, nobody knows of any."""
    messages = {name: one._replace(constants=one.constants or None) for name, one in facts.messages.items()}
    return replace(facts, messages=messages)


def merge(parts: Iterable[tuple[str, DefinitionSet]]) -> DefinitionSet:
    """Facts of several places as one.

    Args:
        parts: each with the name of its place, such as a topic.

    Raises:
        AmbiguousTypeError: two places say something else of one type.
    """
    interfaces: dict[str, tuple[str, ...]] = {}
    messages: dict[str, MessageDefinition] = {}
    hashes: dict[str, str] = {}
    places: dict[str, str] = {}
    for place, facts in parts:
        for name, message in facts.messages.items():
            before = messages.setdefault(name, message)
            places.setdefault(name, place)
            if before is not message and (
                hashes[name] != facts.hashes[name]
                or _without_unknown(before, message) != _without_unknown(message, before)
            ):
                raise AmbiguousTypeError(
                    f"there are two definitions of {name}: {hashes[name]} of {places[name]}, and {facts.hashes[name]} "
                    f"of {place}"
                )
            if before.constants is None and message.constants is not None:
                messages[name] = message
            hashes.setdefault(name, facts.hashes[name])
        interfaces.update(facts.interfaces)
        hashes.update(facts.hashes)
    return DefinitionSet(dict(sorted(interfaces.items())), messages, hashes)


def _without_unknown(one: MessageDefinition, other: MessageDefinition) -> tuple[object, ...]:
    """What `one` says of what the other may contradict."""
    return one._replace(constants=None).comparison_key() if other.constants is None else one.comparison_key()


def _sections(interface: Interface) -> tuple[str, ...]:
    match interface:
        case MessageDef():
            parts: tuple[MessageDef, ...] = (interface,)
        case ServiceDef():
            parts = (interface.request, interface.response)
        case ActionDef():
            parts = (interface.goal, interface.result, interface.feedback)
    return tuple(str(one.name) for one in parts)


def _message(message: MessageDef) -> MessageDefinition:
    fields = tuple(
        FieldDefinition(one.name, one.type, default_text(one.default), one.unit, _place(one.location))
        for one in message.fields
    )
    constants = tuple(
        ConstantFact(one.name, str(one.type), repr(one.value), _place(one.location)) for one in message.constants
    )
    is_told = message.source.format != "implicit" or bool(constants)
    return MessageDefinition(str(message.name), fields, constants if is_told else None)


def _place(location: Location) -> str:
    return f"{location.source.path}:{location.line}:{location.column}" if location.source.text else ""
