"""Python text of the statements in encoders and decoders, and the struct functions they use.

The emitters decide about names, offsets and conditions; the functions of this module only spell statements.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

NUMPY_FIXED = {
    "?": "fixed_bools", "b": "fixed_int8s", "B": "fixed_uint8s", "h": "fixed_int16s", "H": "fixed_uint16s",
    "i": "fixed_int32s", "I": "fixed_uint32s", "q": "fixed_int64s", "Q": "fixed_uint64s",
    "f": "fixed_float32s", "d": "fixed_float64s",
}  # fmt: skip
NUMPY_DTYPE = {
    "b": "INT8", "B": "UINT8", "h": "INT16", "H": "UINT16", "i": "INT32", "I": "UINT32", "q": "INT64", "Q": "UINT64",
    "f": "FLOAT32", "d": "FLOAT64",
}  # fmt: skip


def block(head: str, body: Iterable[str]) -> list[str]:
    """Return a compound statement: ``head`` and a colon, then the indented body."""
    return [f"{head}:", *(f"    {line}" for line in body)]


def check(condition: str, function: str, number: str, expected: int) -> list[str]:
    """Return the statement that calls a function, which raises, if a condition is true for a number."""
    return block(f"if {number} {condition} {expected}", [f"{function}({number}, {expected})"])


def read_string(target: str, start: str, end: str, any_buffer: bool) -> list[str]:
    """Return the code that reads a string and leaves the offset of its NUL in ``end``.

    Args:
        target: receives the string.
        start: offset of the first character.
        end: offset of the NUL.
        any_buffer: ``raw`` may be a memoryview, which has no `decode`.
    """
    text = f'str(raw[{start}:end], "utf-8")' if any_buffer else f"raw[{start}:end].decode()"
    return [
        f"end = {end}",
        *block("if raw[end]", ['raise ValueError("a string does not end in NUL")']),
        f"{target} = {text}",
    ]


@dataclass(slots=True)
class Structs:
    """The precompiled struct functions of a module, each once."""

    entries: dict[tuple[str, str, int, bool], str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    def name(self, role: str, code: str, align: int = 1, nul: bool = False) -> str:
        """Return the name of a struct function.

        Args:
            role: pack, unpack_from or iter_unpack.
            code: struct code without byte order.
            align: a boundary above 1 makes a table of eight functions, indexed by ``pos & 7``.
            nul: the functions write the terminator of a string first.
        """
        key = (role, code, align, nul)
        if key not in self.entries:
            prefix = {"pack": "_pack", "unpack_from": "_unpack", "iter_unpack": "_iter"}[role]
            number = self.counts.get(role, 0)
            self.counts[role] = number + 1
            self.entries[key] = f"{prefix}_{number}"
        return self.entries[key]

    def __iter__(self) -> Iterator[tuple[str, str, str, int, bool]]:
        for (role, code, align, nul), name in self.entries.items():
            yield name, role, code, align, nul


def plus(expression: str, number: int) -> str:
    """Return ``expression + number``, as one number if the expression is a number."""
    if number == 0:
        return expression
    return str(int(expression) + number) if expression.isdigit() else f"{expression} + {number}"
