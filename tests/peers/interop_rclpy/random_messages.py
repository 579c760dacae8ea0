"""Random plain values of any message, equal in every run, with the limits of every type among them.

Not by Hypothesis: messages like test_msgs/MultiNested are larger than it draws, and messages are sent in bulk, so that
nothing could be shrunk. Strings have no NUL, because those of rclpy are C strings.
"""

from __future__ import annotations

import struct
from pathlib import Path
from random import Random
from typing import Any

from support.reference_cdr import NUMBERS

from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity, FieldType
from rosidl_py_gen.compiler.frontend.model import MessageDef
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry
from rosidl_py_gen.compiler.frontend.search_path import SearchPath

FLOATS: tuple[float | str, ...] = (0.0, -0.0, 1.5, 1e-40, "NaN", "Infinity", "-Infinity")
LETTERS = "aZ09 '\"\\/{}%\n\t\x01é€ハ😀\u200d\uffff"


class RandomMessages:
    """Values for messages of the packages in a folder."""

    def __init__(self, share: Path) -> None:
        self._registry = InterfaceRegistry(SearchPath.scan([share], ament="", bundled=False))

    def make(self, name: str, count: int) -> list[dict[str, Any]]:
        """Return values in the format of `to_json`."""
        random = Random(name)
        return [self._message(random, name) for _ in range(count)]

    def _message(self, random: Random, name: str) -> dict[str, Any]:
        definition: MessageDef | None = self._registry.message(name)
        assert definition is not None, name
        return {field.name: self._field(random, field.type) for field in definition.fields}

    def _field(self, random: Random, kind: FieldType) -> Any:
        match kind.arity:
            case Arity.SCALAR:
                return self._value(random, kind)
            case Arity.ARRAY:
                count = kind.capacity
            case Arity.BOUNDED:
                count = random.choice((0, kind.capacity, random.randint(0, kind.capacity)))
            case _:
                count = random.choice((0, 1, 4))
        return [self._value(random, kind) for _ in range(count)]

    def _value(self, random: Random, kind: FieldType) -> Any:
        if kind.is_string:
            max_bytes = min(kind.string_bound or 30, 30)
            text = "".join(random.choices(LETTERS, k=random.choice((0, max_bytes, random.randint(0, max_bytes)))))
            # Bounds count bytes in rclpy and characters in the standard.
            return text.encode()[:max_bytes].decode(errors="ignore") if kind.string_bound else text
        if kind.base not in NUMBERS:
            return self._message(random, kind.base)
        if kind.base == "bool":
            return random.random() < 0.5
        letter = NUMBERS[kind.base][0]
        if letter in "fd":
            value = random.choice((*FLOATS, random.uniform(-1e6, 1e6)))
            return value if isinstance(value, str) else struct.unpack(letter, struct.pack(letter, value))[0]
        low, high = PRIMITIVES[kind.base].integer_range
        return random.choice((low, high, 0, random.randint(low, high)))
