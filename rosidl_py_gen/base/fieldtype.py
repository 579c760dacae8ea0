"""The type of a field: base, string bound, arity and capacity, and its text form.

The text form is that of a .msg file with full names, for example ``float64[36]``, ``string<=8[<=3]`` or
``geometry_msgs/msg/Point[]``. Generated classes carry it, the compiler's model uses it, so there is one table of
primitives and one of type ids (docs/internals/protocol.md 1.1 and 3.2) for both sides.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import NamedTuple


class Primitive(NamedTuple):
    """How a primitive travels: struct code, bytes (also its alignment), rosidl type id, numpy name, Python type."""

    code: str
    size: int
    type_id: int
    numpy: str
    python: str


# docs/internals/protocol.md 1.1, 2.2, 3.2. `char` of a .msg is an unsigned byte with the id of uint8; `idl_char`,
# `wchar` and `float128` exist only in .idl files.
PRIMITIVES: dict[str, Primitive] = {
    "bool": Primitive("?", 1, 15, "bool_", "bool"),
    "byte": Primitive("B", 1, 16, "uint8", "int"),
    "char": Primitive("B", 1, 3, "uint8", "int"),
    "int8": Primitive("b", 1, 2, "int8", "int"),
    "uint8": Primitive("B", 1, 3, "uint8", "int"),
    "int16": Primitive("h", 2, 4, "int16", "int"),
    "uint16": Primitive("H", 2, 5, "uint16", "int"),
    "int32": Primitive("i", 4, 6, "int32", "int"),
    "uint32": Primitive("I", 4, 7, "uint32", "int"),
    "int64": Primitive("q", 8, 8, "int64", "int"),
    "uint64": Primitive("Q", 8, 9, "uint64", "int"),
    "float32": Primitive("f", 4, 10, "float32", "float"),
    "float64": Primitive("d", 8, 11, "float64", "float"),
    "idl_char": Primitive("B", 1, 13, "uint8", "int"),
    "wchar": Primitive("H", 2, 14, "uint16", "int"),
}
STRINGS = {"string": 17, "wstring": 18}
_BOUNDED_STRINGS = {"string": 21, "wstring": 22}

INTEGER_RANGES: dict[str, tuple[int, int]] = {
    "b": (-(2**7), 2**7 - 1),
    "B": (0, 2**8 - 1),
    "h": (-(2**15), 2**15 - 1),
    "H": (0, 2**16 - 1),
    "i": (-(2**31), 2**31 - 1),
    "I": (0, 2**32 - 1),
    "q": (-(2**63), 2**63 - 1),
    "Q": (0, 2**64 - 1),
}


class Arity(Enum):
    """How many values a field holds; the number is the offset of the type id (docs/internals/protocol.md 3.2)."""

    SCALAR = 0
    ARRAY = 48
    BOUNDED = 96
    UNBOUNDED = 144


@dataclass(frozen=True, slots=True)
class FieldType:
    """The type of one field.

    Attributes:
        base: a key of PRIMITIVES, ``string``, ``wstring``, or a full interface name ``pkg/msg/Name``.
        arity: one value, a fixed array, a bounded or an unbounded sequence.
        capacity: elements of an array, upper bound of a bounded sequence, else 0.
        string_bound: upper bound in characters of a bounded string, else 0.
    """

    base: str
    arity: Arity = Arity.SCALAR
    capacity: int = 0
    string_bound: int = 0

    @property
    def is_message(self) -> bool:
        return "/" in self.base

    @property
    def is_string(self) -> bool:
        return self.base in STRINGS

    @property
    def primitive(self) -> Primitive | None:
        return PRIMITIVES.get(self.base)

    @property
    def element(self) -> FieldType:
        """The type of one element of an array or sequence."""
        return FieldType(self.base, string_bound=self.string_bound)

    def __str__(self) -> str:
        text = self.base + (f"<={self.string_bound}" if self.string_bound else "")
        match self.arity:
            case Arity.SCALAR:
                return text
            case Arity.ARRAY:
                return f"{text}[{self.capacity}]"
            case Arity.BOUNDED:
                return f"{text}[<={self.capacity}]"
            case Arity.UNBOUNDED:
                return f"{text}[]"

    def description(self) -> dict[str, int | str]:
        """The `type` member of a type description: type_id, capacity, string_capacity, nested_type_name.

        Source: docs/internals/protocol.md 3.2, and 1.7 for the one type whose reference description is wrong and must
        be matched.
        """
        arity, capacity = self.arity, self.capacity
        if self.base == "wstring" and self.string_bound and arity is Arity.UNBOUNDED:
            arity, capacity = Arity.BOUNDED, self.string_bound
        primitive = self.primitive
        if primitive is not None:
            base_id = primitive.type_id
        elif self.is_string:
            base_id = (_BOUNDED_STRINGS if self.string_bound else STRINGS)[self.base]
        else:
            base_id = 1
        return {
            "type_id": base_id + arity.value,
            "capacity": capacity,
            "string_capacity": self.string_bound,
            "nested_type_name": self.base if self.is_message else "",
        }


_TEXT = re.compile(r"([a-zA-Z0-9_/]+)(?:<=(\d+))?(?:\[(<=)?(\d*)\])?\Z", re.ASCII)


@lru_cache(maxsize=4096)
def parse_field_type(text: str) -> FieldType:
    """The inverse of ``str(FieldType)``; the text comes from generated code and is taken as right."""
    found = _TEXT.match(text)
    assert found is not None, text
    base, bound, upper, size = found.groups()
    string_bound = int(bound or 0)
    if size is None:
        return FieldType(base, string_bound=string_bound)
    if upper:
        return FieldType(base, Arity.BOUNDED, int(size), string_bound)
    if size:
        return FieldType(base, Arity.ARRAY, int(size), string_bound)
    return FieldType(base, Arity.UNBOUNDED, 0, string_bound)
