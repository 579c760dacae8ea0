"""Comparison of two sets of definitions: added, removed and changed types, and the consequences of each change.

Fields and constants are identified by name. A removed field and an added field of the same type at the same place are
reported as a probable rename, because a definition does not state renames. `wire_compatibility` decides whether old
messages can be read.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.descriptions import default_text
from rosidl_py_gen.compiler.compatibility.definition_set import canonical_type, known_constants
from rosidl_py_gen.compiler.compatibility.wire_compatibility import ReadResult, ReadVerdict, WireCompatibility

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from rosidl_py_gen.compiler.compatibility.definition_set import DefinitionSet
    from rosidl_py_gen.compiler.frontend.model import ConstantDef, FieldDef, MessageDef


class ChangeKind(Enum):
    """Consequence of a change.

    DATA: recordings, and messages of nodes with the old definition, are misread or cannot be read. CODE: programs that
    use the type may fail. HASH: the type hash differs; tools warn, and on Zenoh old and new nodes do not match.
    DEFAULT: new messages have other values. UNIT: numbers have another unit, by their comments. ADDITION: only
    additions.
    """

    DATA = "data"
    CODE = "code"
    HASH = "hash"
    DEFAULT = "default"
    UNIT = "unit"
    ADDITION = "addition"


class ElementChange(NamedTuple):
    """A change of a field or constant.

    Attributes:
        what: added or removed; renamed (probably), type, moved, default or unit of a field; changed for a constant.
        name: the new name; the old name of a removed element.
        before: the old type, default, unit, place or name, ``type value`` of a constant; empty if there was none.
        after: the new one.
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
    """Changes of a message, or of a section of a service or action.

    `through` has the changed types that it contains, `old_data` the result of reading old messages.
    """

    name: str
    old_hash: str
    new_hash: str
    fields: tuple[ElementChange, ...]
    constants: tuple[ElementChange, ...]
    through: tuple[str, ...]
    old_data: ReadVerdict

    def consequences(self) -> frozenset[ChangeKind]:
        """Return the consequences of the changes."""
        found = {one.consequence for one in self.fields} | {one.consequence for one in self.constants}
        if self.old_hash != self.new_hash:
            found.add(ChangeKind.HASH)
        if self.old_data.reading is not ReadResult.SAME:
            found.add(ChangeKind.DATA)
        return frozenset(found)


@dataclass(frozen=True, slots=True)
class TypeChange:
    """A changed interface with its changed messages, and the interfaces that contain it."""

    name: str
    old_hash: str
    new_hash: str
    messages: tuple[MessageChange, ...]
    used_by: tuple[str, ...]

    def consequences(self) -> frozenset[ChangeKind]:
        """Return the consequences of the changes."""
        return frozenset().union(*(one.consequences() for one in self.messages))


@dataclass(frozen=True, slots=True)
class Comparison:
    """Result of a comparison: sorted full names; `not_compared` has only one set, if neither set is complete."""

    added: tuple[str, ...]
    removed: tuple[str, ...]
    changed: tuple[TypeChange, ...]
    not_compared: tuple[str, ...]
    same: tuple[str, ...]

    def consequences(self) -> frozenset[ChangeKind]:
        """Return the consequences of the changes; a removed type breaks data and code."""
        found = set().union(*(one.consequences() for one in self.changed))
        if self.added:
            found.add(ChangeKind.ADDITION)
        if self.removed:
            found |= {ChangeKind.DATA, ChangeKind.CODE}
        return frozenset(found)


def select_names(comparison: Comparison, names: Iterable[str]) -> Comparison:
    """Return the part of a comparison for some packages and interfaces."""
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
    """Compare two sets of definitions; a type that only one has was added or removed if the other set is whole."""
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
    wire = WireCompatibility(old.messages, new.messages)
    owners = {message: name for name in names for message in old.interfaces[name]}
    own: dict[str, tuple[tuple[ElementChange, ...], tuple[ElementChange, ...]]] = {}
    for message in {*old.messages} & {*new.messages}:
        found = _field_changes(wire, old.messages[message], new.messages[message])
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
            verdict = wire.verdict(message, message)
            if fields or constants or hashes[0] != hashes[1]:
                through = tuple(sorted(inside[message] & own.keys()))
                messages.append(MessageChange(message, *hashes, fields, constants, through, verdict))
        if messages:
            yield TypeChange(name, old.hashes[name], new.hashes[name], tuple(messages), users.get(name, ()))


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
    """Return the interfaces that contain a changed one, by the name of the changed one."""
    found: dict[str, set[str]] = {}
    for message, user in owners.items():
        for part in inside[message] & own.keys():
            name = owners.get(part, part)
            if name != user:
                found.setdefault(name, set()).add(user)
    return {name: tuple(sorted(users)) for name, users in found.items()}


# ------------------------------------------------------------------------------------------------------------- fields


def _place(message: MessageDef, one: FieldDef | ConstantDef) -> str:
    """Return the location of an element as ``path:line:column``; empty without a text."""
    return f"{message.source.path}:{one.location.line}:{one.location.column}" if message.source.text else ""


def _field_changes(wire: WireCompatibility, old: MessageDef, new: MessageDef) -> tuple[ElementChange, ...]:
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
            is_same = wire.field(before.type, one.type).reading is ReadResult.SAME
            consequence = ChangeKind.HASH if is_same else ChangeKind.CODE
            found.append(ElementChange("type", one.name, str(before.type), str(one.type), place, consequence))
        if one.name in moved:
            old_number, new_number = (
                str([item.name for item in side.fields].index(one.name) + 1) for side in (old, new)
            )
            found.append(ElementChange("moved", one.name, old_number, new_number, place, ChangeKind.HASH))
        defaults = default_text(before.default), default_text(one.default)
        if defaults[0] != defaults[1]:
            found.append(ElementChange("default", one.name, *defaults, place, ChangeKind.DEFAULT))
        # Texts of bags and nodes may lack comments.
        if before.unit and one.unit and before.unit != one.unit:
            found.append(ElementChange("unit", one.name, before.unit, one.unit, place, ChangeKind.UNIT))
    return tuple(found)


def _probable_renames(old: Sequence[FieldDef], new: Sequence[FieldDef]) -> dict[str, str]:
    """Return new name -> old name of fields that replace a field of the same type between the same neighbours."""
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
    """Return the fewest names that must have moved: those outside of the longest increasing subsequence.

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
