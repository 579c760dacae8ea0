"""The fields of a class of rclpy's flavour: what holds them, what they begin with, what setters make of a value."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr.arrays import DTYPES, FieldValueError, short_repr
from rosidl_py_gen.cdr.rclpy_messages.arrays import BYTES, as_list, joined_bytes, to_array
from rosidl_py_gen.cdr.rclpy_messages.checks import check
from rosidl_py_gen.cdr.rclpy_messages.names import slot

if TYPE_CHECKING:
    from rosidl_py_gen.cdr.message import Field

CHECK = os.environ.get("ROS_PYTHON_CHECK_FIELDS") == "1"
_ZERO: dict[str, Any] = {"bool": False, "int": 0, "float": 0.0}


class FieldSlot(NamedTuple):
    """One field as its class holds it.

    Attributes:
        get, put: of the slot, without conversion.
        default: makes the value that a new message has.
        convert: makes what is stored of what is assigned; None stores it as it is.
        array_code: of a sequence of numbers whose argument constructors convert first.
    """

    field: Field
    get: Callable[[Any], Any]
    put: Callable[[Any, Any], None]
    default: Callable[[], Any]
    convert: Callable[[Any], Any] | None
    array_code: str


def field_slot(cls: type, field: Field, default: Any) -> FieldSlot:
    """`default` is what the definition says, a list for an array; None when it says nothing."""
    member = cls.__dict__[slot(field.py_name)]
    kind = field.type
    code = kind.primitive.code if kind.primitive is not None and kind.base not in ("bool", "byte") else ""
    convert: Callable[[Any], Any] | None = None
    is_sequence = kind.arity in (Arity.BOUNDED, Arity.UNBOUNDED)
    if code and kind.arity is not Arity.SCALAR:
        convert = (lambda value: to_array(value, code)) if is_sequence else lambda value: np.array(value, DTYPES[code])
    first = code if is_sequence and default is None else ""
    return FieldSlot(field, member.__get__, member.__set__, _default(field, default, convert), convert, first)


def _default(field: Field, default: Any, convert: Callable[[Any], Any] | None) -> Callable[[], Any]:
    kind = field.type
    if kind.arity is Arity.SCALAR:
        if field.cls is not None:
            return field.cls
        value = default
        if default is None:
            value = b"\0" if kind.base == "byte" else _ZERO[kind.primitive.python] if kind.primitive else ""
        return lambda: value
    if convert is not None and kind.arity is Arity.ARRAY and default is None:
        dtype = DTYPES[kind.primitive.code] if kind.primitive is not None else None
        return lambda: np.zeros(kind.capacity, dtype)
    if convert is not None:
        return lambda: convert(default or ())
    if default is not None:
        return lambda: list(default)
    if kind.arity is not Arity.ARRAY:
        return list
    if field.cls is not None:
        cls = field.cls
        return lambda: [cls() for _ in range(kind.capacity)]
    value = b"\0" if kind.base == "byte" else False if kind.primitive is not None else ""
    return lambda: [value] * kind.capacity


def property_of(one: FieldSlot) -> property:
    """The attribute that programs use."""
    field, put, convert = one.field, one.put, one.convert

    def assign(self: Any, value: Any) -> None:
        try:
            checked = self._CHECK
        except AttributeError:  # it was received
            checked = CHECK
        if (checked and check(field, value)) or convert is None:
            put(self, value)
        else:
            put(self, convert(value))

    return property(one.get, assign, doc=f"Message field '{field.py_name}'.")


# --- between what rclpy's messages hold and what ours do --------------------------------------------------------------


def to_plain(one: FieldSlot, value: Any) -> Any:
    """The value of a field as our own classes hold it: bytes as integers, collections as lists.

    Raises:
        FieldValueError: something else than bytes.
    """
    kind = one.field.type
    if kind.base == "byte":
        if kind.arity is not Arity.SCALAR:
            return joined_bytes(value)
        if not isinstance(value, bytes) or len(value) != 1:
            raise FieldValueError(f"expected bytes of length 1, found {short_repr(value)}")
        return value[0]
    return value if kind.arity is Arity.SCALAR or kind.primitive is not None else as_list(value)


def from_plain(one: FieldSlot, value: Any) -> Any:
    """The inverse; what does not fit stays as it is, for encoding to complain about."""
    kind = one.field.type
    if kind.base == "byte":
        if kind.arity is Arity.SCALAR:
            return BYTES[value] if isinstance(value, int) and 0 <= value < 256 else value
        return [BYTES[number] for number in value] if isinstance(value, np.ndarray) else value
    if kind.base == "bool" and isinstance(value, np.ndarray):
        return value.tolist()
    return value if one.convert is None else one.convert(value)
