"""Types of message fields, and the tables of primitives and type ids.

The text of a type is written as in a .msg file, with full names, such as ``float64[36]``, ``string<=8[<=3]`` or
``geometry_msgs/msg/Point[]``. Generated classes contain this text. Source: docs/internals/protocol.md 1.1 and 3.2.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping


class Primitive(NamedTuple):
    """Primitive type of a field.

    Attributes:
        code: struct code.
        size: size and alignment in bytes.
        type_id: id of the type in type descriptions, less than 48.
        numpy: name of the numpy type.
        python: name of the Python type.
        idl: name of the type in IDL, in the spelling of rosidl.
        array_code: type code of the `array.array` that sequences are in messages of rclpy's API, of a larger type if
            `array.array` lacks the type; "" for bool and byte, whose sequences are lists.
        max_float: maximum of finite floats, with the digits that rclpy's checks have; 0 for other types.
    """

    code: str
    size: int
    type_id: int
    numpy: str
    python: str
    idl: str
    array_code: str
    max_float: float = 0.0

    @property
    def integer_range(self) -> tuple[int, int]:
        """Minimum and maximum of an integer type."""
        return _INTEGER_RANGES[self.code]


# docs/internals/protocol.md 1.1, 2.2, 3.2. `char` of a .msg is an unsigned byte with the id of uint8; `idl_char` and
# `wchar` exist only in .idl files.
PRIMITIVES: dict[str, Primitive] = {
    "bool": Primitive("?", 1, 15, "bool_", "bool", "boolean", ""),
    "byte": Primitive("B", 1, 16, "uint8", "int", "octet", ""),
    "char": Primitive("B", 1, 3, "uint8", "int", "uint8", "B"),
    "float32": Primitive("f", 4, 10, "float32", "float", "float", "f", 3.402823466e38),
    "float64": Primitive("d", 8, 11, "float64", "float", "double", "d", 1.7976931348623157e308),
    "int8": Primitive("b", 1, 2, "int8", "int", "int8", "b"),
    "uint8": Primitive("B", 1, 3, "uint8", "int", "uint8", "B"),
    "int16": Primitive("h", 2, 4, "int16", "int", "int16", "h"),
    "uint16": Primitive("H", 2, 5, "uint16", "int", "uint16", "H"),
    "int32": Primitive("i", 4, 6, "int32", "int", "int32", "i"),
    "uint32": Primitive("I", 4, 7, "uint32", "int", "uint32", "I"),
    "int64": Primitive("q", 8, 8, "int64", "int", "int64", "q"),
    "uint64": Primitive("Q", 8, 9, "uint64", "int", "uint64", "Q"),
    "idl_char": Primitive("B", 1, 13, "uint8", "int", "char", "B"),
    "wchar": Primitive("H", 2, 14, "uint16", "int", "wchar", "H"),
}
_INTEGER_BITS = {one.code: 8 * one.size for one in PRIMITIVES.values() if one.python == "int"}
_INTEGER_RANGES: dict[str, tuple[int, int]] = {
    code: (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if code.islower() else (0, 2**bits - 1)
    for code, bits in _INTEGER_BITS.items()
}
"""Minimum and maximum by struct code. The codes of signed integers are lower-case letters."""
_STRINGS = {"string": 17, "wstring": 18}
_BOUNDED_STRINGS = {"string": 21, "wstring": 22}
_MESSAGE = 1
_BASES = {_MESSAGE: "", **{one.type_id: name for name, one in PRIMITIVES.items() if name != "char"}}
"""Names of types by type id; empty for messages. The id of `char` means uint8."""
_BASES |= {number: name for ids in (_STRINGS, _BOUNDED_STRINGS) for name, number in ids.items()}


class Arity(Enum):
    """Kinds of fields: one value, array or sequence. The number of a kind is added to the type id in type descriptions.

    Source: docs/internals/protocol.md 3.2.
    """

    SCALAR = 0
    ARRAY = 48
    BOUNDED = 96
    UNBOUNDED = 144


_TEXT = re.compile(r"([a-zA-Z0-9_/]+)(?:<=(\d+))?(?:\[(<=)?(\d*)\])?\Z", re.ASCII)


@dataclass(frozen=True, slots=True)
class FieldType:
    """Type of one message field.

    Attributes:
        base: a key of PRIMITIVES, ``string``, ``wstring``, or a full interface name ``pkg/msg/Name``.
        arity: one value, a fixed array, a bounded or an unbounded sequence.
        capacity: elements of an array, upper bound of a bounded sequence, else 0.
        string_bound: upper bound in characters of a bounded string, else 0.
    """

    MSG_BASES: ClassVar = (*(name for name in PRIMITIVES if name not in ("idl_char", "wchar")), *_STRINGS)
    """Bases that .msg files have except messages, in the order of rosidl_adapter."""

    base: str
    arity: Arity = Arity.SCALAR
    capacity: int = 0
    string_bound: int = 0

    @staticmethod
    @lru_cache(maxsize=4096)
    def parse(text: str) -> FieldType:
        """Return the field type whose text, ``str(FieldType)``, a generated class contains.

        The text is trusted, so it is not checked.
        """
        match = _TEXT.match(text)
        assert match is not None, text
        base, bound, upper, size = match.groups()
        string_bound = int(bound or 0)
        if size is None:
            return FieldType(base, string_bound=string_bound)
        arity = Arity.BOUNDED if upper else Arity.ARRAY if size else Arity.UNBOUNDED
        return FieldType(base, arity, int(size or 0), string_bound)

    @staticmethod
    def of_description(description: Mapping[str, Any]) -> FieldType | None:
        """Return the type with the values of a dictionary that `description` returned; None if its type id is unknown.

        Capacities and the nested name are not checked.
        """
        number, capacity, bound = (description[key] for key in ("type_id", "capacity", "string_capacity"))
        base = _BASES.get(number % 48)
        if base is None or number // 48 > 3:
            return None
        arity = Arity(number // 48 * 48)
        if number == _BOUNDED_STRINGS["wstring"] + Arity.BOUNDED.value and capacity == bound:
            # The description of wstring<=N[] by rosidl (docs/internals/protocol.md 1.7).
            arity, capacity = Arity.UNBOUNDED, 0
        return FieldType(base or description["nested_type_name"], arity, capacity, bound)

    @property
    def is_message(self) -> bool:
        return "/" in self.base

    @property
    def is_string(self) -> bool:
        return self.base in _STRINGS

    @property
    def is_sequence(self) -> bool:
        """True for bounded and unbounded sequences, whose number of elements varies."""
        return self.arity in (Arity.BOUNDED, Arity.UNBOUNDED)

    @property
    def fixed_count(self) -> int:
        """Number of elements of an array, and 1 for a single value."""
        return self.capacity if self.arity is Arity.ARRAY else 1

    @property
    def has_fixed_size(self) -> bool:
        """True if the size of a field does not depend on its value; the sizes of nested messages are ignored."""
        return not (self.is_string or self.is_sequence)

    @property
    def primitive(self) -> Primitive | None:
        return PRIMITIVES.get(self.base)

    @property
    def element(self) -> FieldType:
        """Type of one element of the array or sequence."""
        return FieldType(self.base, string_bound=self.string_bound)

    def __str__(self) -> str:
        bound = f"<={self.string_bound}" if self.string_bound else ""
        arity = {Arity.SCALAR: "", Arity.UNBOUNDED: "[]", Arity.ARRAY: "[{}]", Arity.BOUNDED: "[<={}]"}[self.arity]
        return self.base + bound + arity.format(self.capacity)

    def description(self) -> dict[str, int | str]:
        """Return the field `type` of a type description for this type (docs/internals/protocol.md 3.2).

        rosidl describes an unbounded sequence of bounded wstrings wrongly; this method returns the same wrong values
        (1.7).
        """
        arity, capacity = self.arity, self.capacity
        if self.base == "wstring" and self.string_bound and arity is Arity.UNBOUNDED:
            arity, capacity = Arity.BOUNDED, self.string_bound
        primitive = self.primitive
        if primitive is not None:
            base_id = primitive.type_id
        elif self.is_string:
            base_id = (_BOUNDED_STRINGS if self.string_bound else _STRINGS)[self.base]
        else:
            base_id = _MESSAGE
        return {
            "type_id": base_id + arity.value,
            "capacity": capacity,
            "string_capacity": self.string_bound,
            "nested_type_name": self.base if self.is_message else "",
        }
