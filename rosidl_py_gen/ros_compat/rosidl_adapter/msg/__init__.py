"""Table of the IDL type names for the types of .msg files."""

from rosidl_py_gen.base.fieldtype import MSG_PRIMITIVES, PRIMITIVES

MSG_TYPE_TO_IDL = {
    **{name: PRIMITIVES[name].idl for name in MSG_PRIMITIVES},
    "string": "string",
    "wstring": "wstring",
}
