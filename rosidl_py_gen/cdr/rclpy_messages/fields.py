"""Fields of messages that behave like rclpy's: names, IDL types, slots, defaults, and conversion of assigned values."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr.arrays import DTYPES, FieldValueError, short_repr
from rosidl_py_gen.cdr.rclpy_messages.arrays import BYTES, as_list, joined_bytes, to_array
from rosidl_py_gen.cdr.rclpy_messages.checks import check

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType
    from rosidl_py_gen.cdr.message import Field

CHECK = os.environ.get("ROS_PYTHON_CHECK_FIELDS") == "1"
_ZERO: dict[str, Any] = {"bool": False, "int": 0, "float": 0.0}
_RESERVED = {"encode", "decode", "write", "read", "native", "assign", "check_fields", "fields_and_field_types"}
"""Names of fields whose storage attribute, the name with an underscore, would replace a method of the message classes.
"""

IDL_NAMES = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
    "idl_char": "char",
}
"""Names of primitives in IDL that differ from those in .msg files."""


def slot_name(name: str) -> str:
    """Return the name of the attribute that stores a field in a message class of rclpy's API, given the field's Python
    name.
    """
    return f"_{name}_" if name in _RESERVED else f"_{name}"


def idl_text(kind: FieldType) -> str:
    """Return the type of a field in the form that `get_fields_and_field_types` returns, such as
    ``sequence<std_msgs/Header, 3>``.
    """
    if kind.is_message:
        package, _, name = kind.base.split("/")
        text = f"{package}/{name}"
    else:
        text = IDL_NAMES.get(kind.base, kind.base) + (f"<{kind.string_bound}>" if kind.string_bound else "")
    match kind.arity:
        case Arity.ARRAY:
            return f"{text}[{kind.capacity}]"
        case Arity.BOUNDED:
            return f"sequence<{text}, {kind.capacity}>"
        case Arity.UNBOUNDED:
            return f"sequence<{text}>"
        case _:
            return text


class FieldSlot(NamedTuple):
    """Field of a message class of rclpy's API, with the functions that read and assign it.

    Attributes:
        get, put: descriptor functions of the slot, without conversion.
        default: function that returns the value in a new message.
        convert: function that converts an assigned value; None stores it unchanged.
        array_code: type code of a sequence of numbers that constructors convert before they assign it.
    """

    field: Field
    get: Callable[[Any], Any]
    put: Callable[[Any, Any], None]
    default: Callable[[], Any]
    convert: Callable[[Any], Any] | None
    array_code: str


def field_slot(cls: type, field: Field, default: Any) -> FieldSlot:
    """Return the functions that read and assign a field of a message class of rclpy's API.

    `default` is the default value in the definition, or None.
    """
    member = cls.__dict__[slot_name(field.py_name)]
    kind = field.type
    code = kind.primitive.code if kind.primitive is not None and kind.base not in ("bool", "byte") else ""
    convert: Callable[[Any], Any] | None = None
    is_sequence = kind.arity in (Arity.BOUNDED, Arity.UNBOUNDED)
    if code and kind.arity is not Arity.SCALAR:
        convert = (lambda value: to_array(value, code)) if is_sequence else lambda value: np.array(value, DTYPES[code])
    array_code = code if is_sequence and default is None else ""
    return FieldSlot(field, member.__get__, member.__set__, _default(field, default, convert), convert, array_code)


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
        count, code = kind.capacity, kind.primitive.code if kind.primitive is not None else ""
        return lambda: np.zeros(count, DTYPES[code])
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


def property_of(slot: FieldSlot) -> property:
    """Return the property through which programs read and assign a field, with rclpy's checks and conversion."""
    field, put, convert = slot.field, slot.put, slot.convert

    def assign(self: Any, value: Any) -> None:
        try:
            checked = self._CHECK
        except AttributeError:  # a received message
            checked = CHECK
        if (checked and check(field, value)) or convert is None:
            put(self, value)
        else:
            put(self, convert(value))

    return property(slot.get, assign, doc=f"Message field '{field.py_name}'.")


# --- conversion between values of rclpy's messages and ours -----------------------------------------------------------


def to_plain(slot: FieldSlot, value: Any) -> Any:
    """Convert a field's value in a message of rclpy's API to the form of native classes: integers for bytes, lists for
    collections.

    Raises `FieldValueError` for a wrong element of type byte.
    """
    kind = slot.field.type
    if kind.base == "byte":
        if kind.arity is not Arity.SCALAR:
            return joined_bytes(value)
        if not isinstance(value, bytes) or len(value) != 1:
            raise FieldValueError(f"expected bytes of length 1, found {short_repr(value)}")
        return value[0]
    return value if kind.arity is Arity.SCALAR or kind.primitive is not None else as_list(value)


def from_plain(slot: FieldSlot, value: Any) -> Any:
    """Convert a field's value from the form of native classes to the form of rclpy's API.

    A value that does not fit stays unchanged; encoding the message then fails.
    """
    kind = slot.field.type
    if kind.base == "byte":
        if kind.arity is Arity.SCALAR:
            return BYTES[value] if isinstance(value, int) and 0 <= value < 256 else value
        return [BYTES[number] for number in value] if isinstance(value, np.ndarray) else value
    if kind.base == "bool" and isinstance(value, np.ndarray):
        return value.tolist()
    return value if slot.convert is None else slot.convert(value)
