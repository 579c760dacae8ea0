"""Messages with very many fields: members that come from a table, and a codec that walks it.

CPython takes kilobytes and microseconds to compile each line of generated code, which for thousands of fields is a
multiple of the memory of their definition. The class of such a message therefore contains one string literal, a table
in JSON, of which `add_table_members` makes fields and constants. `TableCodedMessage` encodes and decodes field by
field.
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import MISSING, dataclass, field
from struct import Struct
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.descriptions import default_text
from rosidl_py_gen.base.fieldtype import PRIMITIVES, Arity, FieldType
from rosidl_py_gen.base.names import py_name
from rosidl_py_gen.cdr import support
from rosidl_py_gen.cdr.arrays import BOOL_BYTE, DTYPES, coerce
from rosidl_py_gen.cdr.field_walk import decode_slow, encode_slow, read_message
from rosidl_py_gen.cdr.layout import COUNT_BYTES, COUNT_CODE, EMPTY_MESSAGE, HEADER, NUL, PADDING, WSTRING_UNIT_BYTES
from rosidl_py_gen.cdr.message import Field, Message, TypeInfo

if TYPE_CHECKING:
    from collections.abc import Callable

    from typing_extensions import Self

    from rosidl_py_gen.cdr.arrays import Buffer
    from rosidl_py_gen.cdr.support import Append, Readable

M = TypeVar("M", bound=Message)
_ZERO: dict[str, Any] = {"bool": False, "int": 0, "float": 0.0}
_PYTHON = {"bool": bool, "int": int, "float": float}
_NESTED = re.compile(r"(\d+)(.*)\Z", re.ASCII)
_PACK = {primitive.code: Struct(f"<{primitive.code}").pack for primitive in PRIMITIVES.values()}


class TableTypeInfo(TypeInfo):
    """Type information made of a table.

    Args:
        table: JSON with `fields`, rows of name, type and, if there is one, default value; and `constants`, rows of
            name, type and value. The type of a nested message is its position in `classes` and the array suffix.
        classes: the classes of nested messages.
    """

    __slots__ = ("constants", "values")

    def __init__(self, name: str, hash: str, table: str, *classes: type[Message]) -> None:
        content = json.loads(table)
        fields = content["fields"]
        self.values = {row[0]: tuple(row[2]) if type(row[2]) is list else row[2] for row in fields if row[2:]}
        self.constants: list[tuple[str, str, Any]] = [tuple(row) for row in content["constants"]]
        rows = tuple(_row(row[0], row[1], classes) for row in fields)
        super().__init__(name, hash, rows, {key: default_text(value) for key, value in self.values.items()})


def _row(name: str, text: str, classes: tuple[type[Message], ...]) -> Any:
    nested = _NESTED.match(text)
    if nested is None:
        return sys.intern(name), sys.intern(text)
    cls, array = classes[int(nested[1])], sys.intern(nested[2])
    return (sys.intern(name), array, cls) if array else (sys.intern(name), cls)


def add_table_members(cls: type[M]) -> type[M]:
    """Return the dataclass with the fields and constants of the class's table; `cls` must not be used afterwards."""
    info: Any = cls._TYPE
    annotations = cls.__annotations__
    for name, base, value in info.constants:
        setattr(cls, py_name(name), value)
        annotations[py_name(name)] = ClassVar[_PYTHON[PRIMITIVES[base].python] if base in PRIMITIVES else str]
    for item in info.fields:
        setattr(cls, item.py_name, _default(item, info.values.get(item.ros_name)))
        annotations[item.py_name] = Any
    cls.__init__ = _init  # type: ignore[method-assign]  # that of a dataclass takes quadratic time to compile
    return dataclass(slots=True, eq=False, repr=False, init=False)(cls)


def _init(self: Any, *args: Any, **kwargs: Any) -> None:
    """Set the fields as the constructor of a dataclass does."""
    fields, names, cls = self.__dataclass_fields__, self.__match_args__, type(self).__name__
    if len(args) > len(names):
        raise TypeError(f"{cls} takes {len(names)} values, found {len(args)}")
    values = dict(zip(names, args, strict=False))
    for name in kwargs:
        if name in values or name not in fields:
            problem = "two values for" if name in values else "an unexpected keyword argument"
            raise TypeError(f"{cls} got {problem} '{name}'")
    values |= kwargs
    for name in names:
        field = fields[name]
        if name not in values:
            values[name] = field.default if field.default is not MISSING else field.default_factory()
        setattr(self, name, values[name])


def _default(item: Field, value: Any) -> Any:
    """Return the default of a dataclass field, `value` if the definition has one."""
    kind, cls = item.type, item.cls
    primitive = kind.primitive
    if kind.arity is Arity.SCALAR:
        if cls is not None:
            return field(default_factory=cls)
        return value if value is not None else _ZERO[primitive.python] if primitive is not None else ""
    count = kind.capacity if kind.arity is Arity.ARRAY else 0
    make: Callable[[], Any] = list
    if primitive is not None:
        dtype = DTYPES[primitive.code]
        make = (lambda: np.array(value, dtype)) if value else lambda: np.zeros(count, dtype)
    elif value:
        make = lambda: [*value]  # noqa: E731
    elif cls is not None and count:
        element = cls
        make = lambda: [element() for _ in range(count)]  # noqa: E731
    elif count:
        make = lambda: [""] * count  # noqa: E731
    return field(default_factory=make)


class TableCodedMessage(Message):
    """Base of messages with so many fields that generated code for each would be out of proportion."""

    __slots__ = ()

    def _encode(self) -> bytes:
        try:
            parts: list[bytes] = [HEADER]
            _write_message(self, parts.append, 0)
            return b"".join(parts)
        except support.FastPathError as error:
            return encode_slow(self, error)

    def _write(self, append: Append, pos: int) -> int:
        return _write_message(self, append, pos)

    @classmethod
    def _decode(cls, data: Readable, copy: bool = False, arrays: bool = False) -> Self:
        return decode_slow(cls, data, copy, None, arrays)

    @classmethod
    def _read(cls, raw: bytes | bytearray, view: Buffer, pos: int, arrays: bool = False) -> tuple[Self, int]:
        return read_message(cls, raw, view, pos, arrays)


def _write_message(message: Message, append: Append, pos: int) -> int:
    """Append the fields of a message; returns the position after them (docs/internals/protocol.md 2.2)."""
    fields = message._TYPE.fields
    if not fields:
        append(EMPTY_MESSAGE)
        return pos + len(EMPTY_MESSAGE)
    for item in fields:
        value, kind = message._get_plain(item), item.type
        if kind.arity is Arity.SCALAR:
            pos = _write_element(value, kind, item.cls, append, pos)
            continue
        if kind.primitive is not None:
            value = coerce(value, kind.primitive.code)
        elif item.cls is not None:
            value = support.list_or_records(value)
        else:
            support.coerce_message_list(value)
        if kind.arity is Arity.ARRAY:
            support.check_length(len(value), kind.capacity)
        else:
            if kind.arity is Arity.BOUNDED:
                support.check_max_length(len(value), kind.capacity)
            pos = _write_number(len(value), COUNT_CODE, COUNT_BYTES, append, pos)
        pos = _write_elements(value, kind, item.cls, append, pos)
    return pos


def _write_number(value: Any, code: str, size: int, append: Append, pos: int) -> int:
    pad = PADDING[size][pos & size - 1]
    append(pad + _PACK[code](BOOL_BYTE[value] if code == "?" else value))
    return pos + len(pad) + size


def _write_elements(value: Any, kind: FieldType, cls: type[Message] | None, append: Append, pos: int) -> int:
    if kind.primitive is not None:
        if len(value):
            pad = PADDING[kind.primitive.size][pos & kind.primitive.size - 1]
            append(pad + value.tobytes())
            pos += len(pad) + value.nbytes
        return pos
    if cls is not None and type(value) is support.ndarray:
        return support.write_records(cls, value, append, pos)
    element = kind.element
    for item in value:
        pos = _write_element(item, element, cls, append, pos)
    return pos


def _write_element(value: Any, kind: FieldType, cls: type[Message] | None, append: Append, pos: int) -> int:
    if cls is not None:
        return _write_message(support.coerce_message(value, cls), append, pos)
    if kind.primitive is not None:
        return _write_number(value, kind.primitive.code, kind.primitive.size, append, pos)
    if kind.string_bound:
        support.check_max_length(len(value), kind.string_bound)
    if kind.base == "wstring":
        text = support.utf16(value)
        pos = _write_number(len(text) // WSTRING_UNIT_BYTES, COUNT_CODE, COUNT_BYTES, append, pos)
    else:
        text = support.utf8(value) + NUL
        pos = _write_number(len(text), COUNT_CODE, COUNT_BYTES, append, pos)
    append(text)
    return pos + len(text)
