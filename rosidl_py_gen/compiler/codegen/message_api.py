"""The differences between codecs of the two message APIs: names of attributes, and functions that convert arrays.

The native classes have numpy arrays, and a byte is an integer. Classes of rclpy's API have the types of rclpy: an
`array.array` for a sequence of numbers, writable arrays, lists of bool and of bytes, and slots with an underscore.
"""

from __future__ import annotations

from struct import calcsize
from typing import TYPE_CHECKING

from rosidl_py_gen.cdr.rclpy_messages.fields import slot_name
from rosidl_py_gen.compiler.codegen.statements import NUMPY_DTYPE, NUMPY_FIXED, plus

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.codegen.naming import Imports


class MessageApi:
    """Expressions of a generated encoder or decoder; each method imports the functions that its expression calls."""

    def __init__(self, imports: Imports) -> None:
        self.imports = imports

    def support(self, name: str, module: str = "rosidl_py_gen.cdr.support") -> str:
        """Import a function of `cdr.support` and return its name in the module."""
        return self.imports.use(module, name, in_class=False)

    def attribute(self, name: str) -> str:
        """Return the attribute that stores the field of a Python name."""
        return name

    def fixed(self, code: str) -> str:
        """Return the function that makes bytes of a small fixed array."""
        return self.support(NUMPY_FIXED[code])

    def sequence(self, code: str, *, is_array: bool) -> str:
        """Return the function that makes a buffer of a sequence, or of a large fixed array."""
        return self.support(NUMPY_FIXED[code].removeprefix("fixed_"))

    def listed(self, expression: str) -> str:
        """Return the expression of strings or messages as a list that can be encoded."""
        return expression

    def numbers(self, code: str, count: str, at: str, *, is_array: bool) -> str:
        """Return the expression of the numbers at an offset of ``view``."""
        if code == "?":
            return f"{self.support('view_of_bools')}(view, {count}, {at})"
        return f"{self.support('frombuffer')}(view, {self.support(NUMPY_DTYPE[code])}, {count}, {at})"

    def is_array(self, value: str) -> str:
        """Return the test whether messages are a structured array."""
        return f"type({value}) is {self.support('ndarray')}"


class RclpyMessageApi(MessageApi):
    """Expressions for classes of rclpy's API."""

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
        return self.array_function(f"buffer_of_{NUMPY_FIXED[code].removeprefix('fixed_')}")

    def listed(self, expression: str) -> str:
        return f"{self.array_function('as_list')}({expression})"

    def numbers(self, code: str, count: str, at: str, *, is_array: bool) -> str:
        if code in "c?":
            return f"{self.array_function('list_of_bytes' if code == 'c' else 'list_of_bools')}(view, {count}, {at})"
        if not is_array:
            return f"{self.array_function('array_of_' + NUMPY_FIXED[code].removeprefix('fixed_'))}(view, {count}, {at})"
        end = plus(at, calcsize(f"<{code}") * int(count))
        support = self.support("support", "rosidl_py_gen.cdr")  # an attribute imports numpy when it is first used
        return f"{support}.ndarray({count}, {support}.{NUMPY_DTYPE[code]}, bytearray(view[{at}:{end}]))"

    def is_array(self, value: str) -> str:
        return f"type({value}) is not list and type({value}) is {self.support('support', 'rosidl_py_gen.cdr')}.ndarray"
