"""Names of the attributes of rclpy's messages, and IDL names of their types."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.fieldtype import Arity

if TYPE_CHECKING:
    from rosidl_py_gen.base.fieldtype import FieldType

_RESERVED = {"encode", "decode", "write", "read", "native", "assign", "check_fields", "fields_and_field_types"}
"""Fields whose attribute with an underscore would hide a method of ours."""

IDL_NAMES = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
    "idl_char": "char",
}
"""Names of primitives in IDL that differ from those in .msg files."""


def slot(name: str) -> str:
    """Return the attribute that stores a field, by the field's Python name."""
    return f"_{name}_" if name in _RESERVED else f"_{name}"


def idl_text(kind: FieldType) -> str:
    """Return the type of a field as `get_fields_and_field_types` has it, such as ``sequence<std_msgs/Header, 3>``."""
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
