"""Result of reading bytes with another definition than that of the writer.

It follows from the layout alone (docs/internals/protocol.md 2): CDR of ROS 2 has neither names nor tags, so a reader
expects each field at its position. Fields are compared by position; names only show whether a value belongs there. A
result is valid for every message, except `ReadResult.MISREAD`, which guarantees nothing.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import INTEGER_RANGES, Arity

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.compiler.frontend.model import FieldDef, MessageDef

_MAX_REASONS = 10


class ReadResult(Enum):
    """Result of reading old messages, best first.

    SAME: all values are read. TRUNCATED: all values are read except for removed fields at the end. RENAMED: all values
    are read, some under a new name. DEPENDS_ON_VALUES: some values differ or cannot be read. FAILS: no message can be
    read. MISREAD: values are wrong, or the message cannot be read.
    """

    SAME = "same"
    TRUNCATED = "without"
    RENAMED = "renamed"
    DEPENDS_ON_VALUES = "sometimes"
    FAILS = "fails"
    MISREAD = "other"


_ORDER = {reading: place for place, reading in enumerate(ReadResult)}


class ReadVerdict(NamedTuple):
    """Result of reading old messages of a type, with the reasons by field, at most ten."""

    reading: ReadResult
    reasons: tuple[str, ...] = ()


_SAME = ReadVerdict(ReadResult.SAME)


class WireCompatibility:
    """Compares the messages of two sets of definitions, which have all messages that they refer to."""

    def __init__(self, old: Mapping[str, MessageDef], new: Mapping[str, MessageDef]) -> None:
        self._old, self._new = old, new
        self._verdicts: dict[tuple[str, str, bool], ReadVerdict] = {}

    def verdict(self, old: str, new: str) -> ReadVerdict:
        """Return the result of reading messages of an old type as a new one."""
        return self._message(old, new, True)

    def field(self, old: FieldType, new: FieldType) -> ReadVerdict:
        """Return the result of reading a field of an old type as a new one, with other data after it."""
        return self._type(old, new, False)

    def _message(self, old: str, new: str, is_last: bool) -> ReadVerdict:
        """Return a verdict; with `is_last` no data follows, so surplus and missing bytes do not affect other fields."""
        key = old, new, is_last
        if key not in self._verdicts:
            found = [*self._fields(self._old[old].fields, self._new[new].fields, is_last)]
            reading = max((one.reading for one in found), key=_ORDER.__getitem__, default=ReadResult.SAME)
            reasons = [reason for one in found if one.reading is not ReadResult.SAME for reason in one.reasons]
            self._verdicts[key] = ReadVerdict(reading, tuple(reasons[:_MAX_REASONS]))
        return self._verdicts[key]

    def _fields(self, old: tuple[FieldDef, ...], new: tuple[FieldDef, ...], is_last: bool) -> Iterator[ReadVerdict]:
        if bool(old) is not bool(new) and not (is_last and old):
            field = (old or new)[0].name
            yield _misread(f"{field}: a message without fields is one byte that belongs to no field")
            return
        then, now = {one.name for one in old}, {one.name for one in new}
        for place, (one, other) in enumerate(zip(old, new, strict=False)):
            is_end = is_last and place == len(old) - 1 == len(new) - 1
            found = self._type(one.type, other.type, is_end)
            if one.name == other.name:
                found = found._replace(reasons=tuple(_below(one.name, reason) for reason in found.reasons))
            elif one.name in now or other.name in then:
                found = _misread(f"{other.name}: is read from the place of {one.name}")
            elif found.reading is ReadResult.SAME:
                found = ReadVerdict(ReadResult.RENAMED, (f"{other.name}: is what {one.name} was",))
            else:
                found = _misread(f"{other.name}: is read from the place of {one.name}, {one.type}")
            yield found
            if found.reading is ReadResult.MISREAD:  # the positions after it are meaningless
                return
        if len(old) > len(new):
            removed = ", ".join(one.name for one in old[len(new) :][:_MAX_REASONS])
            is_ignored = ReadVerdict(ReadResult.TRUNCATED, (f"{removed}: not read",))
            yield is_ignored if is_last else _misread(f"{removed}: is read as the next field")
        elif len(new) > len(old):
            field = new[len(old)].name
            is_missing = ReadVerdict(ReadResult.FAILS, (f"{field}: messages end before it",))
            yield is_missing if is_last else _misread(f"{field}: is read from the data after the message")

    def _type(self, old: FieldType, new: FieldType, is_last: bool) -> ReadVerdict:
        if any((old.arity is arity) is not (new.arity is arity) for arity in (Arity.SCALAR, Arity.ARRAY)):
            return _other(old, new)
        if old.arity is Arity.ARRAY and old.capacity != new.capacity:
            return _other(old, new)
        # After an element, the next one follows.
        element = self._element(old, new, is_last and old.arity is Arity.SCALAR)
        if _is_narrower(old.capacity, new.capacity) and old.arity is not Arity.ARRAY:
            too_many = _depends(f": more than {new.capacity} elements cannot be read")
            return too_many if _ORDER[element.reading] < _ORDER[too_many.reading] else element
        return element

    def _element(self, old: FieldType, new: FieldType, is_last: bool) -> ReadVerdict:
        if old.is_message and new.is_message:
            found = self._message(old.base, new.base, is_last)
            if found.reading in (ReadResult.SAME, ReadResult.TRUNCATED, ReadResult.FAILS) or old.arity is Arity.SCALAR:
                return found
            within = tuple(f"[]{'' if reason.startswith(':') else '.'}{reason}" for reason in found.reasons)
            return found._replace(reasons=within)
        if old.is_string and old.base == new.base:
            if _is_narrower(old.string_bound, new.string_bound):
                return _depends(f": texts of more than {new.string_bound} characters are too long")
            return _SAME
        one, other = old.primitive, new.primitive
        if one is None or other is None:
            return _other(old, new)
        if one.code == other.code or (one.code == "?" and other.size == 1):
            return _SAME
        if one.size != other.size:
            return _other(old, new)
        if other.code == "?":
            return _depends(f": {old} is read as {new}, of which only 0 and 1 are values")
        if one.code in INTEGER_RANGES and other.code in INTEGER_RANGES:
            low = max(INTEGER_RANGES[one.code][0], INTEGER_RANGES[other.code][0])
            high = min(INTEGER_RANGES[one.code][1], INTEGER_RANGES[other.code][1])
            return _depends(f": {old} is read as {new}, the same from {low} to {high}")
        return _other(old, new)


def _misread(reason: str) -> ReadVerdict:
    return ReadVerdict(ReadResult.MISREAD, (reason,))


def _depends(reason: str) -> ReadVerdict:
    return ReadVerdict(ReadResult.DEPENDS_ON_VALUES, (reason,))


def _other(old: FieldType, new: FieldType) -> ReadVerdict:
    return _misread(f": {old} is read as {new}")


def _is_narrower(old: int, new: int) -> bool:
    """Return True if a new upper bound is lower; 0 means no bound."""
    return new != 0 and (old == 0 or new < old)


def _below(field: str, reason: str) -> str:
    """Return a reason with the field that contains it: ``pose`` and ``x: not read`` -> ``pose.x: not read``."""
    return f"{field}{reason}" if reason.startswith((":", "[")) else f"{field}.{reason}"
