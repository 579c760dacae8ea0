"""Table of the IDL type names for the types of .msg files."""

from rosidl_py_gen.base.fieldtype import PRIMITIVES, FieldType

MSG_TYPE_TO_IDL = {name: PRIMITIVES[name].idl if name in PRIMITIVES else name for name in FieldType.MSG_BASES}
