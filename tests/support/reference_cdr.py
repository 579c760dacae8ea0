"""A slow, obvious reader and writer of plain CDR, driven by the definitions themselves. Only an oracle for tests.

Written from the layout table of docs/internals/protocol.md 2.2 and nothing else: one value at a time, one function for
each row of the table. Values are plain: dicts with ROS names, lists, bool, int, float, str.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from rosidl_py_gen import type_name
from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import py_name
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.compiler.frontend.model import MessageDef
from support.inner_state import type_fields

# type -> struct letter and size; the size is also the alignment
NUMBERS = {
    "bool": ("?", 1),
    "byte": ("B", 1),
    "char": ("B", 1),
    "int8": ("b", 1),
    "uint8": ("B", 1),
    "int16": ("h", 2),
    "uint16": ("H", 2),
    "int32": ("i", 4),
    "uint32": ("I", 4),
    "float32": ("f", 4),
    "int64": ("q", 8),
    "uint64": ("Q", 8),
    "float64": ("d", 8),
}


class ReferenceError(Exception):
    """The bytes are not a message of this type."""


class Reference:
    """Encode and decode by definition.

    Args:
        lookup: the definition of a message by full name.
    """

    def __init__(self, lookup: Callable[[str], MessageDef | None]) -> None:
        self.lookup = lookup

    def definition(self, name: str) -> MessageDef:
        found = self.lookup(name)
        assert found is not None, name
        return found

    def encode(
        self, name: str, value: dict[str, Any], *, big_endian: bool = False, pad: Callable[[int], bytes] = bytes
    ) -> bytes:
        """`pad` returns the content of padding for a length; zeros by default."""
        writer = _Writer(self, ">" if big_endian else "<", pad)
        writer.message(name, value)
        return (b"\0\0\0\0" if big_endian else b"\0\1\0\0") + bytes(writer.out)

    def decode(self, name: str, data: bytes) -> dict[str, Any]:
        """Trailing bytes and the content of padding do not matter.

        Raises:
            ReferenceError: the data end early or break a rule.
        """
        if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
            raise ReferenceError("encapsulation")
        return _Reader(self, bytes(data[4:]), "<" if data[1] else ">").message(name)

    # --- between plain values and generated classes -------------------------------------------------------------------

    def build(self, cls: type[Message], value: dict[str, Any]) -> Message:
        """An instance by assignment, one field at a time; arrays stay lists."""
        message = cls()
        nested = {field.ros_name: field.cls for field in type_fields(cls)}
        for item in self.definition(type_name(cls)).fields:
            given, inner = value[item.name], nested[item.name]
            if inner is not None and item.type.arity is Arity.SCALAR:
                given = self.build(inner, given)
            elif inner is not None:
                given = [self.build(inner, element) for element in given]
            setattr(message, py_name(item.name), given)
        return message

    def plain(self, message: Message) -> dict[str, Any]:
        """The plain value of an instance."""
        result = {}
        for item in self.definition(type_name(message)).fields:
            value = getattr(message, py_name(item.name))
            if item.type.arity is Arity.SCALAR:
                result[item.name] = self._plain(value)
            else:
                result[item.name] = [self._plain(element) for element in value]
        return result

    def _plain(self, value: Any) -> Any:
        if isinstance(value, Message):
            return self.plain(value)
        if isinstance(value, np.void | np.ndarray):  # an element of a structured array, or an array inside of one
            if value.ndim:
                return [self._plain(element) for element in value]
            return {name: self._plain(value[name]) for name in value.dtype.names or ()}
        return value.item() if hasattr(value, "dtype") else value


def same(left: Any, right: Any) -> bool:
    """Equality of plain values that takes NaN for equal to NaN, 0.0 for other than -0.0 and 1 for other than True."""
    if type(left) is not type(right):
        return False
    if isinstance(left, dict):
        return list(left) == list(right) and all(same(left[key], right[key]) for key in left)
    if isinstance(left, list):
        return len(left) == len(right) and all(same(a, b) for a, b in zip(left, right, strict=True))
    if isinstance(left, float):
        if math.isnan(left) or math.isnan(right):
            return math.isnan(left) and math.isnan(right)
        return left == right and math.copysign(1, left) == math.copysign(1, right)
    return bool(left == right)


class _Writer:
    def __init__(self, reference: Reference, order: str, pad: Callable[[int], bytes]) -> None:
        self.reference = reference
        self.order = order
        self.pad = pad
        self.out = bytearray()  # the alignment origin is its first byte

    def align(self, size: int) -> None:
        missing = (size - len(self.out) % size) % size
        self.out += self.pad(missing)

    def number(self, kind: str, value: Any) -> None:
        letter, size = NUMBERS[kind]
        self.align(size)
        self.out += struct.pack(self.order + letter, value)

    def text(self, kind: str, value: str) -> None:
        if kind == "wstring":
            units = value.encode("utf-16-be")
            self.number("uint32", len(units) // 2)
            for index in range(0, len(units), 2):
                self.number("uint32", units[index] * 256 + units[index + 1])
        else:
            raw = value.encode("utf-8") + b"\0"
            self.number("uint32", len(raw))
            self.out += raw

    def element(self, kind: FieldType, value: Any) -> None:
        if kind.base in NUMBERS:
            self.number(kind.base, value)
        elif kind.base in ("string", "wstring"):
            self.text(kind.base, value)
        else:
            self.message(kind.base, value)

    def message(self, name: str, value: dict[str, Any]) -> None:
        fields = self.reference.definition(name).fields
        if not fields:
            self.number("uint8", 0)
        for item in fields:
            if item.type.arity is Arity.SCALAR:
                self.element(item.type, value[item.name])
                continue
            if item.type.arity is not Arity.ARRAY:
                self.number("uint32", len(value[item.name]))
            for element in value[item.name]:
                self.element(item.type, element)


class _Reader:
    def __init__(self, reference: Reference, data: bytes, order: str) -> None:
        self.reference = reference
        self.data = data
        self.order = order
        self.at = 0

    def take(self, size: int) -> bytes:
        if self.at + size > len(self.data):
            raise ReferenceError("the data end early")
        self.at += size
        return self.data[self.at - size : self.at]

    def number(self, kind: str) -> Any:
        letter, size = NUMBERS[kind]
        while self.at % size:
            self.at += 1
        raw = self.take(size)
        return raw != b"\0" if kind == "bool" else struct.unpack(self.order + letter, raw)[0]

    def text(self, kind: str) -> str:
        count = self.number("uint32")
        try:
            if kind == "wstring":
                if 4 * count > len(self.data) - self.at:
                    raise ReferenceError("the data end early")
                units = [self.number("uint32") for _ in range(count)]
                return b"".join(struct.pack("<H", unit) for unit in units).decode("utf-16-le")
            if count == 0:
                return ""
            raw = self.take(count)
            if raw[-1]:
                raise ReferenceError("no NUL")
            return raw[:-1].decode("utf-8")
        except (UnicodeDecodeError, struct.error) as error:
            raise ReferenceError(str(error)) from error

    def element(self, kind: FieldType) -> Any:
        if kind.base in NUMBERS:
            return self.number(kind.base)
        if kind.base in ("string", "wstring"):
            return self.text(kind.base)
        return self.message(kind.base)

    def message(self, name: str) -> dict[str, Any]:
        fields = self.reference.definition(name).fields
        if not fields:
            self.number("uint8")
        return {item.name: self.field(item.type) for item in fields}

    def field(self, kind: FieldType) -> Any:
        if kind.arity is Arity.SCALAR:
            return self.element(kind)
        count = kind.capacity if kind.arity is Arity.ARRAY else self.number("uint32")
        if kind.arity is Arity.BOUNDED and count > kind.capacity:
            raise ReferenceError("too many elements")
        if count > len(self.data) - self.at:  # no element takes less than a byte
            raise ReferenceError("the data end early")
        return [self.element(kind) for _ in range(count)]
