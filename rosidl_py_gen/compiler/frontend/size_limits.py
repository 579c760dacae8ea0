"""How large a type may be.

Decides the figures. A definition is untrusted, and a few hundred bytes of it can stand for any amount: types that hold
two of the next at each level, fixed arrays, thousands of fields that each are printed in line. What is bounded is what
the compiler's time and a class's first instance grow with; code that is printed is kept in proportion by
`compiler/codegen/layout_planner.py`. The largest message that ROS packages have is a hundredth of each limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.base.fieldtype import Arity

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.model import Diagnostics, FieldDef, MessageDef

MAX_LEVELS = 100
"""Of types that contain each other."""
MAX_FIELDS = 20_000
"""Of a type and all types it refers to, each once; a nested message of few fields counts with them, as those are
printed where it is used."""
MAX_TYPES = 500
"""A type refers to, at all levels: its hash, and that of each of them, covers all that it refers to."""
MAX_VALUES = 1 << 20
"""In a new message: fields, elements of fixed arrays of strings and messages, at all levels. Half a second to make."""
MAX_BYTES = 1 << 28
"""Of fixed arrays of numbers in a new message, at all levels."""

_FEW = 48
"""Fields of a nested message that may be printed where it is used; `codegen.weights.MAX_INLINE_FIELDS`, at least."""


class _TypeSize(NamedTuple):
    """A type as others hold it."""

    values: int
    size: int
    flat: int
    parts: frozenset[str]


_NOTHING = _TypeSize(1, 1, 1, frozenset())
"""Stands for what is unknown or refused: that has been said already."""


class SizeChecker:
    """Sizes by type name; a type is taken after those it refers to."""

    def __init__(self, findings: Diagnostics) -> None:
        self._findings = findings
        self._known: dict[str, _TypeSize] = {}

    def check(self, message: MessageDef) -> None:
        """Measure a message, with a finding where it becomes too large."""
        values = size = flat = others = 0
        parts: set[str] = set()
        for item in message.fields:
            below = self._known.get(item.type.base, _NOTHING) if item.type.is_message else _NOTHING
            count = _count(item)
            values += 1 + (0 if item.type.primitive else count * below.values)
            size += count * (item.type.primitive.size if item.type.primitive else below.size)
            flat += below.flat if below.flat <= _FEW else 1
            if item.type.is_message and item.type.base not in parts:
                new = (below.parts | {item.type.base}) - parts
                others += sum(self._known.get(part, _NOTHING).flat for part in new)
                parts |= new
            if self._is_too_large(message, item, values, size, flat + others, len(parts)):
                self._known[str(message.name)] = _NOTHING
                return
        flat = max(1, flat)
        self._known[str(message.name)] = _TypeSize(max(1, values), max(1, size), flat, frozenset(parts))

    def _is_too_large(
        self, message: MessageDef, item: FieldDef, values: int, size: int, fields: int, types: int
    ) -> bool:
        for found, most, what in (
            (values, MAX_VALUES, "values in nested messages and fixed arrays"),
            (size, MAX_BYTES, "bytes in fixed arrays"),
            (fields, MAX_FIELDS, "fields with those of nested messages"),
            (types, MAX_TYPES, "types that it refers to"),
        ):
            if found > most:
                text = f"{message.name} has {found} {what} up to here, at most {most} are allowed"
                self._findings.add(item.location, text)
                return True
        return False


def _count(item: FieldDef) -> int:
    """How many there are in a new message."""
    if item.type.arity is Arity.SCALAR:
        return 1
    return item.type.capacity if item.type.arity is Arity.ARRAY else 0
