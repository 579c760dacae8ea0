"""Comparison of two sets of definitions: added, removed and changed types, and the consequences of each change.

The functions read no files, bags or networks. A set has the messages of checked registries, with their type hashes.
Source locations are for display and are not compared.

Fields and constants are identified by name. A removed field and an added field of the same type at the same place are
reported as a probable rename, because a definition does not state renames. CDR data of ROS 2 contain neither names nor
tags, so old messages are decoded to the same values only if the same fields are in the same order
(docs/internals/protocol.md 2).
"""

from __future__ import annotations

import operator
from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.compiler.frontend import (
    MessageDef,
)
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend import ConstantDef, FieldDef, InterfaceRegistry


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
    return [(one.name, canonical_type(one.type), one.default_text) for one in message.fields], constants


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
        interfaces[str(name)] = tuple(str(section.name) for section in interface.sections)
        hashes[str(name)] = registry.type_hash(str(name))
        pending = [str(one.name) for one in interface.messages]
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
    return collect(registry, registry.with_dependencies(top))


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


class ChangeKind(Enum):
    """Kind of consequence that a change of a definition has.

    DATA: recordings, and messages of nodes with the old definition, are not read as before: some or all of them are
    misread, cannot be read, or lack fields. CODE: programs that use the type may fail. HASH: the type hash differs;
    tools warn, and on Zenoh old and new nodes do not match. DEFAULT: new messages have other values. UNIT: numbers have
    another unit, according to the comments. ADDITION: only additions.
    """

    DATA = "data"
    CODE = "code"
    HASH = "hash"
    DEFAULT = "default"
    UNIT = "unit"
    ADDITION = "addition"


class ElementChange(NamedTuple):
    """Change of a field or constant of a message.

    Attributes:
        what: added or removed; renamed (probably), type, moved, default or unit of a field; changed for a constant.
        name: the new name; the old name of a removed element.
        before: the old type, default, unit, place or name, ``type value`` of a constant; empty if there was none.
        after: the new type, default, unit, place or name; empty for a removed element.
        place: location of the new definition, or of the old one of a removed element.
    """

    what: str
    name: str
    before: str
    after: str
    place: str
    consequence: ChangeKind


@dataclass(frozen=True, slots=True)
class MessageChange:
    """Changes of a message, or of one section (such as the request) of a service or action.

    Attributes:
        through: the changed types that the message contains.
        reads_old_data: every old message is decoded to the same values by the new definition.
    """

    name: str
    old_hash: str
    new_hash: str
    fields: tuple[ElementChange, ...]
    constants: tuple[ElementChange, ...]
    through: tuple[str, ...]
    reads_old_data: bool

    def consequences(self) -> frozenset[ChangeKind]:
        """Return the kinds of consequences of the message's changes."""
        found = {one.consequence for one in self.fields} | {one.consequence for one in self.constants}
        if self.old_hash != self.new_hash:
            found.add(ChangeKind.HASH)
        if not self.reads_old_data:
            found.add(ChangeKind.DATA)
        return frozenset(found)


@dataclass(frozen=True, slots=True)
class TypeChange:
    """Changed interface, with its changed messages; `used_by` names the interfaces that contain it."""

    name: str
    old_hash: str
    new_hash: str
    messages: tuple[MessageChange, ...]
    used_by: tuple[str, ...]

    def consequences(self) -> frozenset[ChangeKind]:
        """Return the kinds of consequences of all changes of the interface."""
        return frozenset().union(*(one.consequences() for one in self.messages))


@dataclass(frozen=True, slots=True)
class Comparison:
    """Result of the comparison of two sets of definitions, with sorted full type names.

    `not_compared` has the types that only one set has, if neither set is complete.
    """

    added: tuple[str, ...]
    removed: tuple[str, ...]
    changed: tuple[TypeChange, ...]
    not_compared: tuple[str, ...]
    same: tuple[str, ...]

    def consequences(self) -> frozenset[ChangeKind]:
        """Return the kinds of consequences of all changes; a removed type breaks data and code."""
        found = set().union(*(one.consequences() for one in self.changed))
        if self.added:
            found.add(ChangeKind.ADDITION)
        if self.removed:
            found |= {ChangeKind.DATA, ChangeKind.CODE}
        return frozenset(found)


def select_names(comparison: Comparison, names: Iterable[str]) -> Comparison:
    """Return a comparison reduced to the named packages and interfaces."""
    selected = {*names}

    def has(name: str) -> bool:
        return not selected.isdisjoint((name, name.partition("/")[0]))

    return replace(
        comparison,
        added=tuple(filter(has, comparison.added)),
        removed=tuple(filter(has, comparison.removed)),
        changed=tuple(change for change in comparison.changed if has(change.name)),
        not_compared=tuple(filter(has, comparison.not_compared)),
        same=tuple(filter(has, comparison.same)),
    )


def compare(
    old: DefinitionSet, new: DefinitionSet, *, old_is_whole: bool = True, new_is_whole: bool = True
) -> Comparison:
    """Return the comparison of two sets of definitions.

    A type that only one set has was added or removed if the other set is whole; else it is not compared.
    """
    only_new = sorted(set(new.interfaces) - set(old.interfaces))
    only_old = sorted(set(old.interfaces) - set(new.interfaces))
    both = sorted(set(old.interfaces) & set(new.interfaces))
    changed = tuple(_changed(old, new, both))
    return Comparison(
        tuple(only_new) if old_is_whole else (),
        tuple(only_old) if new_is_whole else (),
        changed,
        () if old_is_whole or new_is_whole else tuple(sorted([*only_new, *only_old])),
        tuple(sorted({*both} - {one.name for one in changed})),
    )


def _changed(old: DefinitionSet, new: DefinitionSet, names: Sequence[str]) -> Iterator[TypeChange]:
    layouts = _Layouts(old.messages, new.messages)
    owners = {message: name for name in names for message in old.interfaces[name]}
    own: dict[str, tuple[tuple[ElementChange, ...], tuple[ElementChange, ...]]] = {}
    for message in {*old.messages} & {*new.messages}:
        found = _field_changes(layouts, old.messages[message], new.messages[message])
        constants = tuple(_constant_changes(old.messages[message], new.messages[message]))
        if found or constants:
            own[message] = found, constants
    inside = {message: _contained_types(message, (old.messages, new.messages)) for message in owners}
    users = _dependents(own, owners, inside)
    for name in names:
        messages = []
        for message in old.interfaces[name]:
            fields, constants = own.get(message, ((), ()))
            hashes = old.hashes[message], new.hashes[message]
            if fields or constants or hashes[0] != hashes[1]:
                through = tuple(sorted(inside[message] & own.keys()))
                messages.append(
                    MessageChange(message, *hashes, fields, constants, through, layouts.are_read(message, message))
                )
        if messages:
            yield TypeChange(name, old.hashes[name], new.hashes[name], tuple(messages), users.get(name, ()))


class _Layouts:
    """Comparison of the CDR layouts of old and new messages by name.

    Each set contains all messages to which its messages refer.
    """

    def __init__(self, old: Mapping[str, MessageDef], new: Mapping[str, MessageDef]) -> None:
        self._old, self._new = old, new
        self._results: dict[tuple[str, str], bool] = {}

    def are_read(self, old: str, new: str) -> bool:
        """Return True if the new type decodes every message of the old type to the same values."""
        if (old, new) not in self._results:
            old_fields, new_fields = self._old[old].fields, self._new[new].fields
            has_same_names = [one.name for one in old_fields] == [one.name for one in new_fields]
            self._results[old, new] = has_same_names and all(
                self.is_read(one.type, other.type) for one, other in zip(old_fields, new_fields, strict=True)
            )
        return self._results[old, new]

    def is_read(self, old: FieldType, new: FieldType) -> bool:
        """Return True if a new field type decodes every value of the old field type to the same value."""
        # A sequence may lose its bound, or get a wider one.
        if any((old.arity is arity) is not (new.arity is arity) for arity in (Arity.SCALAR, Arity.ARRAY)):
            return False
        if old.capacity != new.capacity if old.arity is Arity.ARRAY else _is_narrower(old.capacity, new.capacity):
            return False
        if old.is_message and new.is_message:
            return self.are_read(old.base, new.base)
        if old.is_string:
            return old.base == new.base and not _is_narrower(old.string_bound, new.string_bound)
        if old.primitive is None or new.primitive is None:
            return False
        is_bool_as_byte = old.primitive.code == "?" and new.primitive.size == 1
        return old.primitive.code == new.primitive.code or is_bool_as_byte


def _is_narrower(old: int, new: int) -> bool:
    """Return True if the new upper bound is lower than the old; 0 means no bound."""
    return new != 0 and (old == 0 or new < old)


def _contained_types(message: str, sides: Iterable[Mapping[str, MessageDef]]) -> set[str]:
    found: set[str] = set()
    for messages in sides:
        pending, seen = [message], set[str]()
        while pending:
            one = messages.get(pending.pop())
            below = {item.type.base for item in one.fields if item.type.is_message} - seen if one else set[str]()
            seen |= below
            pending += below
        found |= seen
    return found - {message}


def _dependents(
    own: Mapping[str, object], owners: Mapping[str, str], inside: Mapping[str, set[str]]
) -> dict[str, tuple[str, ...]]:
    """Return the interfaces that contain a changed message directly or indirectly, by the name of the changed interface
    or message.

    Args:
        own: the changed messages by name.
        owners: the interface of each message.
        inside: the types that each message contains.
    """
    found: dict[str, set[str]] = {}
    for message, user in owners.items():
        for part in inside[message] & own.keys():
            name = owners.get(part, part)
            if name != user:
                found.setdefault(name, set()).add(user)
    return {name: tuple(sorted(users)) for name, users in found.items()}


# ------------------------------------------------------------------------------------------------------------- fields


def _place(message: MessageDef, one: FieldDef | ConstantDef) -> str:
    """Return the location of a field or constant as ``path:line:column``; empty if its source text is unknown."""
    return f"{message.source.path}:{one.location.line}:{one.location.column}" if message.source.text else ""


def _field_changes(layouts: _Layouts, old: MessageDef, new: MessageDef) -> tuple[ElementChange, ...]:
    then, now = {one.name: one for one in old.fields}, {one.name: one for one in new.fields}
    renamed = _probable_renames(old.fields, new.fields)
    moved = _reordered([one.name for one in old.fields if one.name in now], [one.name for one in new.fields])
    found = [
        ElementChange("removed", one.name, str(one.type), "", _place(old, one), ChangeKind.CODE)
        for one in old.fields
        if one.name not in now and one.name not in renamed.values()
    ]
    for one in new.fields:
        place = _place(new, one)
        before = then.get(one.name) or then.get(renamed.get(one.name, ""))
        if before is None:
            found.append(ElementChange("added", one.name, "", str(one.type), place, ChangeKind.ADDITION))
            continue
        if before.name != one.name:
            found.append(ElementChange("renamed", one.name, before.name, one.name, place, ChangeKind.CODE))
        if canonical_type(before.type) != canonical_type(one.type):
            consequence = ChangeKind.HASH if layouts.is_read(before.type, one.type) else ChangeKind.CODE
            found.append(ElementChange("type", one.name, str(before.type), str(one.type), place, consequence))
        if one.name in moved:
            old_number, new_number = (
                str([item.name for item in side.fields].index(one.name) + 1) for side in (old, new)
            )
            found.append(ElementChange("moved", one.name, old_number, new_number, place, ChangeKind.HASH))
        defaults = before.default_text, one.default_text
        if defaults[0] != defaults[1]:
            found.append(ElementChange("default", one.name, *defaults, place, ChangeKind.DEFAULT))
        # Texts of bags and nodes may lack comments.
        if before.unit and one.unit and before.unit != one.unit:
            found.append(ElementChange("unit", one.name, before.unit, one.unit, place, ChangeKind.UNIT))
    return tuple(found)


def _probable_renames(old: Sequence[FieldDef], new: Sequence[FieldDef]) -> dict[str, str]:
    """Return probable renames, as old name by new name: a field that replaces a field of the same type between the same
    neighbours.
    """
    removed = _unmatched_runs(old, {one.name for one in new})
    added = _unmatched_runs(new, {one.name for one in old})
    found: dict[str, str] = {}
    for previous, fields in added.items():
        for one, other in zip(fields, removed.get(previous, []), strict=False):
            if canonical_type(one.type) == canonical_type(other.type):
                found[one.name] = other.name
    return found


def _unmatched_runs(fields: Sequence[FieldDef], common: set[str]) -> dict[str, list[FieldDef]]:
    found: dict[str, list[FieldDef]] = {}
    previous = ""
    for one in fields:
        if one.name in common:
            previous = one.name
        else:
            found.setdefault(previous, []).append(one)
    return found


def _reordered(old: Sequence[str], new: Sequence[str]) -> set[str]:
    """Return the smallest set of names whose move explains the new order: all names outside of the longest increasing
    subsequence.

    Patience sorting: `ends` has the last place of the best subsequence of each length, `previous` links its places.
    """
    places = {name: number for number, name in enumerate(new)}
    ends: list[int] = []
    previous: dict[int, int | None] = {}
    for place in map(places.__getitem__, old):
        length = bisect_left(ends, place)
        previous[place] = ends[length - 1] if length else None
        ends[length : length + 1] = [place]
    ordered: set[int] = set()
    place_in_order = ends[-1] if ends else None
    while place_in_order is not None:
        ordered.add(place_in_order)
        place_in_order = previous[place_in_order]
    return {name for name in old if places[name] not in ordered}


def _constant_changes(old: MessageDef, new: MessageDef) -> Iterator[ElementChange]:
    if known_constants(old) is None or known_constants(new) is None:
        return
    then, now = ({one.name: (f"{one.type} {one.value!r}", one) for one in side.constants} for side in (old, new))
    for name, (before, one) in then.items():
        if name not in now:
            yield ElementChange("removed", name, before, "", _place(old, one), ChangeKind.CODE)
    for name, (after, one) in now.items():
        if name not in then:
            yield ElementChange("added", name, "", after, _place(new, one), ChangeKind.ADDITION)
        elif then[name][0] != after:
            yield ElementChange("changed", name, then[name][0], after, _place(new, one), ChangeKind.CODE)
