"""Table of the IDL type names for the types of .msg files."""

MSG_TYPE_TO_IDL = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    **{name: name for bits in (8, 16, 32, 64) for name in (f"int{bits}", f"uint{bits}")},
    "float32": "float",
    "float64": "double",
    "string": "string",
    "wstring": "wstring",
}
