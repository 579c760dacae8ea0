"""What becomes of bytes that were written with one definition and are read with another.

Decided from the layout alone (docs/internals/protocol.md 2): CDR of ROS 2 has neither names nor tags, so a reader takes
what it expects from where it expects it. Fields are compared by their place; names only tell whether a value arrives
where it belongs. What is claimed holds for every message, except `ReadResult.OTHER`, which claims nothing.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import INTEGER_RANGES, Arity

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.compiler.compatibility.definition_set import FieldDefinition, MessageDefinition

_MAX_REASONS = 10


class ReadResult(Enum):
    """How old messages are read, best first.

    SAME: every field has the value that was written. WITHOUT: also, but fields at the end are gone. RENAMED: every
    value is there, some under a new name. DEPENDS_ON_VALUES: it depends on the values; those that are read at all
    may differ. FAILS: no message can be read. OTHER: values are wrong, or the message cannot be read.
    """

    SAME = "same"
    TRUNCATED = "without"
    RENAMED = "renamed"
    DEPENDS_ON_VALUES = "sometimes"
    FAILS = "fails"
    MISREAD = "other"


_ORDER = {reading: place for place, reading in enumerate(ReadResult)}


class ReadVerdict(NamedTuple):
    """How old messages of a type are read, and why; a reason for each field that matters, ten at most."""

    reading: ReadResult
    reasons: tuple[str, ...] = ()


_SAME = ReadVerdict(ReadResult.SAME)


class WireCompatibility:
    """Compares the messages of two sets of definitions.

    Args:
        old: the messages of then, with all they refer to.
        new: those of now.
    """

    def __init__(self, old: Mapping[str, MessageDefinition], new: Mapping[str, MessageDefinition]) -> None:
        self._old, self._new = old, new
        self._known: dict[tuple[str, str, bool], ReadVerdict] = {}

    def verdict(self, old: str, new: str) -> ReadVerdict:
        """How messages of the old type are read as the new one."""
        return self._message(old, new, True)

    def field(self, old: FieldType, new: FieldType) -> ReadVerdict:
        """How values of a field of one type are read as another, with something behind them."""
        return self._type(old, new, False)

    def _message(self, old: str, new: str, is_last: bool) -> ReadVerdict:
        """`is_last`: nothing follows, so that what is left over or missing harms nobody else."""
        key = old, new, is_last
        if key not in self._known:
            found = [*self._fields(self._old[old].fields, self._new[new].fields, is_last)]
            reading = max((one.reading for one in found), key=_ORDER.__getitem__, default=ReadResult.SAME)
            # What is certain to fail fails, whatever would become of the values before.
            reasons = [reason for one in found if one.reading is not ReadResult.SAME for reason in one.reasons]
            self._known[key] = ReadVerdict(reading, tuple(reasons[:_MAX_REASONS]))
        return self._known[key]

    def _fields(
        self, old: tuple[FieldDefinition, ...], new: tuple[FieldDefinition, ...], is_last: bool
    ) -> Iterator[ReadVerdict]:
        if bool(old) is not bool(new) and not (is_last and old):
            field = (old or new)[0].name
            yield ReadVerdict(
                ReadResult.MISREAD, (f"{field}: a message without fields is one byte, which is no field's",)
            )
            return
        then, now = {one.name for one in old}, {one.name for one in new}
        for place, (one, other) in enumerate(zip(old, new, strict=False)):
            is_end = is_last and place == len(old) - 1 == len(new) - 1
            found = self._type(one.type, other.type, is_end)
            if one.name == other.name:
                found = found._replace(reasons=tuple(_below(one.name, reason) for reason in found.reasons))
            elif one.name in now or other.name in then:
                found = ReadVerdict(ReadResult.MISREAD, (f"{other.name}: is read from the place of {one.name}",))
            elif found.reading is ReadResult.SAME:
                found = ReadVerdict(ReadResult.RENAMED, (f"{other.name}: is what {one.name} was",))
            else:
                found = ReadVerdict(
                    ReadResult.MISREAD, (f"{other.name}: is read from the place of {one.name}, {one.type}",)
                )
            yield found
            if found.reading is ReadResult.MISREAD:  # from here on places mean nothing
                return
        if len(old) > len(new):
            gone = ", ".join(one.name for one in old[len(new) :][:_MAX_REASONS])
            if is_last:
                yield ReadVerdict(ReadResult.TRUNCATED, (f"{gone}: not read",))
            else:
                yield ReadVerdict(ReadResult.MISREAD, (f"{gone}: is taken for what comes behind",))
        elif len(new) > len(old):
            field = new[len(old)].name
            if is_last:
                yield ReadVerdict(ReadResult.FAILS, (f"{field}: messages end before it",))
            else:
                yield ReadVerdict(ReadResult.MISREAD, (f"{field}: is read from what comes behind",))

    def _type(self, old: FieldType, new: FieldType, is_last: bool) -> ReadVerdict:
        if (old.arity is Arity.SCALAR) is not (new.arity is Arity.SCALAR) or (
            (old.arity is Arity.ARRAY) is not (new.arity is Arity.ARRAY)
        ):
            return _other(old, new)
        if old.arity is Arity.ARRAY and old.capacity != new.capacity:
            return _other(old, new)
        # Behind an element comes the next one.
        element = self._element(old, new, is_last and old.arity is Arity.SCALAR)
        if _is_narrower(old.capacity, new.capacity) and old.arity is not Arity.ARRAY:
            many = ReadVerdict(ReadResult.DEPENDS_ON_VALUES, (f": more than {new.capacity} elements cannot be read",))
            return many if _ORDER[element.reading] < _ORDER[many.reading] else element
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
                text = f": texts of more than {new.string_bound} characters are too long"
                return ReadVerdict(ReadResult.DEPENDS_ON_VALUES, (text,))
            return _SAME
        one, other = old.primitive, new.primitive
        if one is None or other is None:
            return _other(old, new)
        if one.code == other.code or (one.code == "?" and other.size == 1):
            return _SAME
        if one.size != other.size:
            return _other(old, new)
        if other.code == "?":
            return ReadVerdict(
                ReadResult.DEPENDS_ON_VALUES, (f": {old} is read as {new}, of which only 0 and 1 are values",)
            )
        if one.code in INTEGER_RANGES and other.code in INTEGER_RANGES:
            low = max(INTEGER_RANGES[one.code][0], INTEGER_RANGES[other.code][0])
            high = min(INTEGER_RANGES[one.code][1], INTEGER_RANGES[other.code][1])
            return ReadVerdict(
                ReadResult.DEPENDS_ON_VALUES, (f": {old} is read as {new}, the same from {low} to {high}",)
            )
        return _other(old, new)


def _other(old: FieldType, new: FieldType) -> ReadVerdict:
    return ReadVerdict(ReadResult.MISREAD, (f": {old} is read as {new}",))


def _is_narrower(old: int, new: int) -> bool:
    """Of upper bounds, where 0 is none."""
    return new != 0 and (old == 0 or new < old)


def _below(field: str, reason: str) -> str:
    """A reason of a field's type, with the field: ``pose`` and ``x: gone`` -> ``pose.x: gone``."""
    return f"{field}{reason}" if reason.startswith((":", "[")) else f"{field}.{reason}"
