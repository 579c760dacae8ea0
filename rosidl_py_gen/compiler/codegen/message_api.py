"""Where the codecs of the two flavours differ: what attributes are called, and which functions convert arrays.

Our own classes hold numpy arrays, and bytes as integers. Those of rclpy's flavour have what rclpy's have: `array.array`
for sequences of numbers, arrays that can be written to, lists of bool and of bytes, and slots with an underscore.
"""

from __future__ import annotations

from struct import calcsize
from typing import TYPE_CHECKING

from rosidl_py_gen.cdr.rclpy_messages.names import slot
from rosidl_py_gen.compiler.codegen.statements import NUMPY_DTYPE, NUMPY_FIXED, plus

if TYPE_CHECKING:
    from rosidl_py_gen.compiler.codegen.naming import Imports

_SUPPORT = "rosidl_py_gen.cdr.support"
_RCLPY = "rosidl_py_gen.cdr.rclpy_messages.arrays"


class Flavour:
    """What a generated encoder or decoder calls in one module; importing what it calls."""

    def __init__(self, imports: Imports) -> None:
        self.imports = imports

    def support(self, name: str) -> str:
        return self.imports.use(_SUPPORT, name, in_class=False)

    def attribute(self, name: str) -> str:
        """What holds the field of this Python name."""
        return name

    def fixed(self, code: str) -> str:
        """The function that makes bytes of a small fixed array."""
        return self.support(NUMPY_FIXED[code])

    def sequence(self, code: str, *, is_array: bool) -> str:
        """The function that makes a buffer of a sequence, or of a large fixed array."""
        return self.support(NUMPY_FIXED[code].removeprefix("fixed_"))

    def listed(self, expression: str) -> str:
        """A list of strings or messages as it is written."""
        return expression

    def numbers(self, code: str, count: str, at: str, *, is_array: bool) -> str:
        """The elements at an offset of `view`."""
        if code == "?":
            return f"{self.support('view_of_bools')}(view, {count}, {at})"
        return f"{self.support('frombuffer')}(view, {self.support(NUMPY_DTYPE[code])}, {count}, {at})"


class RclpyFlavour(Flavour):
    """The same for classes as rclpy has them."""

    def own(self, name: str) -> str:
        return self.imports.use(_RCLPY, name, in_class=False)

    def attribute(self, name: str) -> str:
        return slot(name)

    def fixed(self, code: str) -> str:
        return self.own("fixed_bytes") if code == "c" else super().fixed(code)

    def sequence(self, code: str, *, is_array: bool) -> str:
        if code == "c":
            return self.own("joined_bytes")
        if code == "?" or is_array:
            return super().sequence(code, is_array=is_array)
        return self.own(f"buffer_of_{NUMPY_FIXED[code].removeprefix('fixed_')}")

    def listed(self, expression: str) -> str:
        return f"{self.own('as_list')}({expression})"

    def numbers(self, code: str, count: str, at: str, *, is_array: bool) -> str:
        if code in "c?":
            return f"{self.own('list_of_bytes' if code == 'c' else 'list_of_bools')}(view, {count}, {at})"
        if not is_array:
            return f"{self.own('array_of_' + NUMPY_FIXED[code].removeprefix('fixed_'))}(view, {count}, {at})"
        end = plus(at, calcsize(f"<{code}") * int(count))
        return f"{self.support('ndarray')}({count}, {self.support(NUMPY_DTYPE[code])}, bytearray(view[{at}:{end}]))"
