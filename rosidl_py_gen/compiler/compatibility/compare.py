"""Two sets of definitions compared: types added, removed and changed, and what each change breaks.

Decides what is a change, and of which sort; whether old messages are still read is in `wire`. Fields and constants are
told apart by name. A field that is gone and another one that came in its place with the same type may be the same under
a new name: that is said as a guess, because nothing in a definition tells.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.compiler.compatibility.definition_set import ConstantFact, FieldDefinition, canonical_type
from rosidl_py_gen.compiler.compatibility.wire_compatibility import ReadResult, ReadVerdict, WireCompatibility

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from rosidl_py_gen.compiler.compatibility.definition_set import DefinitionSet, MessageDefinition


class ChangeKind(Enum):
    """Whom a change concerns.

    DATA: recordings, and messages of nodes that were not updated, are read otherwise or not at all. CODE: programs that
    use the type may not work any more. HASH: the type hash is another one; tools warn, and on Zenoh nodes of then and
    now do not meet. DEFAULT: new messages hold other values. UNIT: numbers mean something else, as comments say.
    ADDITION: there is more than before.
    """

    DATA = "data"
    CODE = "code"
    HASH = "hash"
    DEFAULT = "default"
    UNIT = "unit"
    ADDITION = "addition"


class FieldChange(NamedTuple):
    """What became of a field.

    Attributes:
        what: added, removed, renamed (a guess), type, moved, default or unit.
        name: of now; of then, when it is removed.
        before: the type, default, unit or name of then; empty when there was none.
        after: the same of now.
        place: where it is defined now, or was then.
    """

    what: str
    name: str
    before: str
    after: str
    place: str
    sort: ChangeKind


class ConstantChange(NamedTuple):
    """What became of a constant: added, removed or changed; `before` and `after` are ``type value``."""

    what: str
    name: str
    before: str
    after: str
    place: str
    sort: ChangeKind


@dataclass(frozen=True, slots=True)
class MessageChange:
    """A message, or a section of a service or action.

    Attributes:
        fields: changes of its own fields.
        constants: changes of its own constants.
        through: changed types that it contains, by full name.
        old_data: how messages of then are read now.
    """

    name: str
    old_hash: str
    new_hash: str
    fields: tuple[FieldChange, ...]
    constants: tuple[ConstantChange, ...]
    through: tuple[str, ...]
    old_data: ReadVerdict

    def sorts(self) -> frozenset[ChangeKind]:
        """Of all that changed."""
        found = {one.sort for one in self.fields} | {one.sort for one in self.constants}
        if self.old_hash != self.new_hash:
            found.add(ChangeKind.HASH)
        if self.old_data.reading is not ReadResult.SAME:
            found.add(ChangeKind.DATA)
        return frozenset(found)


@dataclass(frozen=True, slots=True)
class TypeChange:
    """An interface that says something else now.

    Attributes:
        messages: what changed: itself, or sections of a service or action.
        used_by: interfaces that contain it, and so change with it.
    """

    name: str
    old_hash: str
    new_hash: str
    messages: tuple[MessageChange, ...]
    used_by: tuple[str, ...]

    def sorts(self) -> frozenset[ChangeKind]:
        """Of all that changed."""
        return frozenset().union(*(one.sorts() for one in self.messages))


@dataclass(frozen=True, slots=True)
class Comparison:
    """What became of a set of definitions; names are full names of interfaces, in order.

    Attributes:
        not_compared: types that only one side has, where each is only part of something.
        same: types that say the same.
    """

    added: tuple[str, ...]
    removed: tuple[str, ...]
    changed: tuple[TypeChange, ...]
    not_compared: tuple[str, ...]
    same: tuple[str, ...]

    def sorts(self) -> frozenset[ChangeKind]:
        """Of all that changed. A type that is gone breaks data and code."""
        found = set().union(*(one.sorts() for one in self.changed))
        if self.added:
            found.add(ChangeKind.ADDITION)
        if self.removed:
            found |= {ChangeKind.DATA, ChangeKind.CODE}
        return frozenset(found)


def chosen(found: Comparison, wanted: Iterable[str]) -> Comparison:
    """What a comparison says of some packages and interfaces."""
    kept = {*wanted}

    def has(name: str) -> bool:
        return name in kept or name.partition("/")[0] in kept

    return replace(
        found,
        added=tuple(filter(has, found.added)),
        removed=tuple(filter(has, found.removed)),
        changed=tuple(one for one in found.changed if has(one.name)),
        not_compared=tuple(filter(has, found.not_compared)),
        same=tuple(filter(has, found.same)),
    )


def compare(
    old: DefinitionSet, new: DefinitionSet, *, old_is_whole: bool = True, new_is_whole: bool = True
) -> Comparison:
    """Compare two sets of definitions.

    Args:
        old_is_whole: the old ones are all there were; what only the new ones have was added.
        new_is_whole: the new ones are all there are; what only the old ones have was removed.
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
    wire = WireCompatibility(old.messages, new.messages)
    owners = {message: name for name in names for message in old.interfaces[name]}
    own: dict[str, tuple[tuple[FieldChange, ...], tuple[ConstantChange, ...]]] = {}
    for message in {*old.messages} & {*new.messages}:
        found = _field_changes(wire, old.messages[message], new.messages[message])
        constants = tuple(_constant_changes(old.messages[message].constants, new.messages[message].constants))
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


def _contained_types(message: str, sides: Iterable[Mapping[str, MessageDefinition]]) -> set[str]:
    """Names of all types that a message contains, on either side."""
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
    """The interfaces that contain one which changed itself, by the name of that one."""
    found: dict[str, set[str]] = {}
    for message, user in owners.items():
        for part in inside[message] & own.keys():
            name = owners.get(part, part)
            if name != user:
                found.setdefault(name, set()).add(user)
    return {name: tuple(sorted(users)) for name, users in found.items()}


# ------------------------------------------------------------------------------------------------------------- fields


def _field_changes(wire: WireCompatibility, old: MessageDefinition, new: MessageDefinition) -> tuple[FieldChange, ...]:
    then, now = {one.name: one for one in old.fields}, {one.name: one for one in new.fields}
    renamed = _probable_renames(old.fields, new.fields)
    moved = _reordered([one.name for one in old.fields if one.name in now], [one.name for one in new.fields])
    found = [
        FieldChange("removed", one.name, str(one.type), "", one.place, ChangeKind.CODE)
        for one in old.fields
        if one.name not in now and one.name not in renamed.values()
    ]
    for one in new.fields:
        before = then.get(one.name) or then.get(renamed.get(one.name, ""))
        if before is None:
            found.append(FieldChange("added", one.name, "", str(one.type), one.place, ChangeKind.ADDITION))
            continue
        if before.name != one.name:
            found.append(FieldChange("renamed", one.name, before.name, one.name, one.place, ChangeKind.CODE))
        if canonical_type(before.type) != canonical_type(one.type):
            sort = ChangeKind.HASH if wire.field(before.type, one.type).reading is ReadResult.SAME else ChangeKind.CODE
            found.append(FieldChange("type", one.name, str(before.type), str(one.type), one.place, sort))
        if one.name in moved:
            places = str(_place(old.fields, one.name)), str(_place(new.fields, one.name))
            found.append(FieldChange("moved", one.name, *places, one.place, ChangeKind.HASH))
        if before.default != one.default:
            found.append(FieldChange("default", one.name, before.default, one.default, one.place, ChangeKind.DEFAULT))
        # Texts that bags and nodes give may have lost their comments.
        if before.unit and one.unit and before.unit != one.unit:
            found.append(FieldChange("unit", one.name, before.unit, one.unit, one.place, ChangeKind.UNIT))
    return tuple(found)


def _place(fields: Sequence[FieldDefinition], name: str) -> int:
    return next(number for number, one in enumerate(fields, 1) if one.name == name)


def _probable_renames(old: Sequence[FieldDefinition], new: Sequence[FieldDefinition]) -> dict[str, str]:
    """New name -> old name of fields that came where others of the same type went, between the same neighbours."""
    then, now = {one.name for one in old}, {one.name for one in new}
    gone, came = _unmatched_runs(old, now), _unmatched_runs(new, then)
    found: dict[str, str] = {}
    for gap, fields in came.items():
        pairs = zip(fields, gone.get(gap, []), strict=False)
        found |= {
            one.name: other.name for one, other in pairs if canonical_type(one.type) == canonical_type(other.type)
        }
    return found


def _unmatched_runs(fields: Sequence[FieldDefinition], kept: set[str]) -> dict[str, list[FieldDefinition]]:
    """Fields that only one side has, by the common field in front of them."""
    found: dict[str, list[FieldDefinition]] = {}
    behind = ""
    for one in fields:
        if one.name in kept:
            behind = one.name
        else:
            found.setdefault(behind, []).append(one)
    return found


def _reordered(old: Sequence[str], new: Sequence[str]) -> set[str]:
    """Names that are on both sides, in another order: as few as explain it."""
    places = {name: number for number, name in enumerate(new)}
    kept: list[int] = []  # the last places of the longest rising runs, by length
    links: dict[int, int | None] = {}
    for name in old:
        place = places[name]
        length = bisect_left(kept, place)
        links[place] = kept[length - 1] if length else None
        kept[length : length + 1] = [place]
    staying: set[int] = set()
    one = kept[-1] if kept else None
    while one is not None:
        staying.add(one)
        one = links[one]
    return {name for name in old if places[name] not in staying}


def _constant_changes(
    old: tuple[ConstantFact, ...] | None, new: tuple[ConstantFact, ...] | None
) -> Iterator[ConstantChange]:
    if old is None or new is None:  # nobody told
        return
    then, now = {one.name: one for one in old}, {one.name: one for one in new}
    for name, one in then.items():
        if name not in now:
            yield ConstantChange("removed", name, f"{one.type} {one.value}", "", one.place, ChangeKind.CODE)
    for name, one in now.items():
        before = then.get(name)
        shown = f"{one.type} {one.value}"
        if before is None:
            yield ConstantChange("added", name, "", shown, one.place, ChangeKind.ADDITION)
        elif before[:3] != one[:3]:
            yield ConstantChange("changed", name, f"{before.type} {before.value}", shown, one.place, ChangeKind.CODE)
