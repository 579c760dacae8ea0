"""Python source text of statements in generated encoders and decoders, the struct functions that they call, and the
differences between the two message APIs.

The emitters decide about names, offsets and conditions; this module only writes the statements.

Native classes have numpy arrays, and a byte is an integer. Classes of rclpy's API have the types of rclpy: an
`array.array` for a sequence of numbers, writable arrays, lists of bool and of bytes, and slots with an underscore.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from struct import calcsize
from typing import TYPE_CHECKING

from rosidl_py_gen.base.fieldtype import PRIMITIVES
from rosidl_py_gen.cdr.rclpy_messages.message import slot_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from rosidl_py_gen.compiler.codegen.python_text import Imports

_NUMPY = {one.code: one.numpy.rstrip("_") for one in PRIMITIVES.values()}
"""Names of numpy types by struct code. Functions and dtypes in `cdr.support` contain these names."""
HEADER_CODE = "Hxx"
"""Struct code of the encapsulation header, which messages pack together with their first fields."""


def block(head: str, body: Iterable[str]) -> list[str]:
    """Return a compound statement: ``head`` and a colon, then the indented body."""
    return [f"{head}:", *(f"    {line}" for line in body)]


def check(condition: str, function: str, number: str, expected: int) -> list[str]:
    """Return an ``if`` statement for generated code that calls a raising function if ``number condition expected`` is
    true.
    """
    return block(f"if {number} {condition} {expected}", [f"{function}({number}, {expected})"])


def read_string(target: str, start: str, end: str, any_buffer: bool) -> list[str]:
    """Return generated code that reads a string up to its NUL and assigns the offset of the NUL to the variable
    ``end``.

    With `any_buffer`, the variable ``raw`` may be a memoryview, which has no `decode`.
    """
    text = f'str(raw[{start}:end], "utf-8")' if any_buffer else f"raw[{start}:end].decode()"
    return [
        f"end = {end}",
        *block("if raw[end]", ['raise ValueError("a string does not end in NUL")']),
        f"{target} = {text}",
    ]


@dataclass(slots=True)
class Structs:
    """Set of the precompiled struct functions that a generated module defines, without duplicates."""

    entries: dict[tuple[str, str, int, bool], str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    def name(self, role: str, code: str, align: int = 1, nul: bool = False) -> str:
        """Return the name of a struct function in the generated module.

        Its role is ``pack``, ``unpack_from`` or ``iter_unpack``.

        Args:
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
    """Return the source text ``expression + number``, or the sum if the expression is a number."""
    if number == 0:
        return expression
    return str(int(expression) + number) if expression.isdigit() else f"{expression} + {number}"


class MessageApi:
    """Source expressions for generated encoders and decoders of one message API.

    Each method also imports the functions that its expression calls into the generated module.
    """

    def __init__(self, imports: Imports) -> None:
        self.imports = imports

    def support(self, name: str, module: str = "rosidl_py_gen.cdr.support") -> str:
        """Import a function of `cdr.support` into the generated module and return its alias there."""
        return self.imports.use(module, name, in_class=False)

    def attribute(self, name: str) -> str:
        """Return the attribute of a message object that stores the field with this Python name."""
        return name

    def fixed(self, code: str) -> str:
        """Return the name of the function that converts a small fixed array to bytes.

        The element type is given as a struct code.
        """
        return self.support(f"fixed_{_NUMPY[code]}s")

    def sequence(self, code: str, *, is_array: bool) -> str:
        """Return the name of the function that converts a sequence, or a large fixed array, to a buffer of encoded
        elements.
        """
        return self.support(f"{_NUMPY[code]}s")

    def listed(self, expression: str) -> str:
        """Return the source text that converts a sequence of strings or messages to a list that can be encoded."""
        return expression

    def numbers(self, code: str, count: str, at: str, *, is_array: bool) -> str:
        """Return the source text that reads an array of `count` numbers at offset `at` of the variable ``view``."""
        if code == "?":
            return f"{self.support('view_of_bools')}(view, {count}, {at})"
        return f"{self.support('frombuffer')}(view, {self.support(_NUMPY[code].upper())}, {count}, {at})"

    def is_array(self, value: str) -> str:
        """Return the source text of a condition that is true if a sequence of messages is a structured array."""
        return f"type({value}) is {self.support('ndarray')}"


class RclpyMessageApi(MessageApi):
    """Source expressions for generated encoders and decoders of classes of rclpy's API."""

    def array_function(self, name: str) -> str:
        return self.support(name, "rosidl_py_gen.cdr.rclpy_messages.arrays")

    def attribute(self, name: str) -> str:
        return slot_name(name)

    def fixed(self, code: str) -> str:
        return self.array_function("fixed_bytes") if code == "c" else super().fixed(code)

    def sequence(self, code: str, *, is_array: bool) -> str:
        if code == "c":
            return self.array_function("joined_bytes")
        if is_array:
            return super().sequence(code, is_array=is_array)
        return self.array_function(f"buffer_of_{_NUMPY[code]}s")

    def listed(self, expression: str) -> str:
        return f"{self.array_function('as_list')}({expression})"

    def numbers(self, code: str, count: str, at: str, *, is_array: bool) -> str:
        if code in "c?":
            return f"{self.array_function('list_of_bytes' if code == 'c' else 'list_of_bools')}(view, {count}, {at})"
        if not is_array:
            return f"{self.array_function(f'array_of_{_NUMPY[code]}s')}(view, {count}, {at})"
        end = plus(at, calcsize(f"<{code}") * int(count))
        support = self.support("support", "rosidl_py_gen.cdr")  # an attribute imports numpy when it is first used
        return f"{support}.ndarray({count}, {support}.{_NUMPY[code].upper()}, bytearray(view[{at}:{end}]))"

    def is_array(self, value: str) -> str:
        return f"type({value}) is not list and type({value}) is {self.support('support', 'rosidl_py_gen.cdr')}.ndarray"
