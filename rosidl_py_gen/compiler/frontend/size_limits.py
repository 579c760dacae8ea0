"""Limits on the size of types.

A definition is untrusted, and a few hundred bytes can define a type of any size: by types that contain the next one
twice, by fixed arrays, or by thousands of fields. The limits bound the time of the compiler and the memory of a new
message; `compiler/codegen/layout_planner.py` bounds the generated code. The largest message of ROS packages has a
hundredth of each limit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rosidl_py_gen.cdr.layout import fixed_count, has_count

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.frontend.model import Diagnostics, MessageDef

MAX_LEVELS = 100
"""Maximum depth of nested types."""
MAX_FIELDS = 20_000
"""Maximum fields of a type and all types that it refers to, each once. A nested message of few fields counts with its
fields, as they are emitted inline."""
MAX_TYPES = 500
"""Maximum types that a type refers to, at all levels: the hash of each covers all types that it refers to."""
MAX_VALUES = 1 << 20
"""Maximum fields and elements of fixed arrays of strings and messages in a new message, which takes 0.5 s to create."""
MAX_BYTES = 1 << 28
"""Maximum bytes of fixed arrays of numbers in a new message."""

_MAX_INLINE_FIELDS = 48
"""Fields up to which a nested message counts with its fields: at least `layout_planner.MAX_INLINE_FIELDS`."""


class _TypeSize(NamedTuple):
    """Contribution of a type to the size of types that contain it."""

    values: int
    size: int
    inline_fields: int
    types: frozenset[str]


_UNKNOWN = _TypeSize(1, 1, 1, frozenset())
"""Size of a type that has been reported: it does not exist or is too large."""


class SizeChecker:
    """Sizes by type name; a type must be checked after the types that it refers to."""

    def __init__(self, diagnostics: Diagnostics) -> None:
        self._diagnostics = diagnostics
        self._sizes: dict[str, _TypeSize] = {}

    def check(self, message: MessageDef) -> None:
        """Compute the size of a message, and report the field at which it exceeds a limit."""
        values = size = inline_fields = other_fields = 0
        types: set[str] = set()
        for item in message.fields:
            below = self._sizes.get(item.type.base, _UNKNOWN) if item.type.is_message else _UNKNOWN
            elements = 0 if has_count(item.type) else fixed_count(item.type)
            values += 1 + (0 if item.type.primitive else elements * below.values)
            size += elements * (item.type.primitive.size if item.type.primitive else below.size)
            inline_fields += below.inline_fields if below.inline_fields <= _MAX_INLINE_FIELDS else 1
            if item.type.is_message and item.type.base not in types:
                new = (below.types | {item.type.base}) - types
                other_fields += sum(self._sizes.get(name, _UNKNOWN).inline_fields for name in new)
                types |= new
            for count, maximum, text in (
                (values, MAX_VALUES, "values in nested messages and fixed arrays"),
                (size, MAX_BYTES, "bytes in fixed arrays"),
                (inline_fields + other_fields, MAX_FIELDS, "fields with those of nested messages"),
                (len(types), MAX_TYPES, "types that it refers to"),
            ):
                if count > maximum:
                    text = f"{message.name} has {count} {text} up to here, at most {maximum} are allowed"
                    self._diagnostics.add(item.location, text)
                    self._sizes[str(message.name)] = _UNKNOWN
                    return
        sizes = max(1, values), max(1, size), max(1, inline_fields)
        self._sizes[str(message.name)] = _TypeSize(*sizes, frozenset(types))
