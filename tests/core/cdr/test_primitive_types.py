"""Each row of `PRIMITIVES` has its converters, its form in definitions, and values that are encoded and decoded.

A new type of fields fails here for each place that does not have it yet, and in tests/slow/tables/test_column_types.py.
"""

from __future__ import annotations

import numpy as np
import pytest

from rosidl_py_gen import compile_definition
from rosidl_py_gen.base.fieldtype import PRIMITIVES
from rosidl_py_gen.cdr import support
from rosidl_py_gen.cdr.rclpy_messages import arrays

ONLY_IN_IDL = {"idl_char": "char", "wchar": "wchar"}
"""Name in .idl files of each type that .msg files do not have."""
LINE = "=" * 80


@pytest.mark.parametrize("name", PRIMITIVES)
def test_generated_code_finds_the_converters_of_a_type(name: str) -> None:
    numpy_name = PRIMITIVES[name].numpy.rstrip("_") + "s"
    for prefix in ("", "fixed_"):
        assert callable(getattr(support, prefix + numpy_name))
    assert callable(getattr(arrays, f"buffer_of_{numpy_name}"))


@pytest.mark.parametrize("name", PRIMITIVES)
def test_fields_of_a_type_are_encoded_and_decoded(name: str) -> None:
    primitive = PRIMITIVES[name]
    value = {"bool": True, "int": 100, "float": 0.5}[primitive.python]
    text = f"{name} one\n{name}[] many\n"
    if name in ONLY_IN_IDL:
        idl = ONLY_IN_IDL[name]
        struct = f"struct B {{ {idl} one; sequence<{idl}> many; }};"
        text = f"{LINE}\nIDL: a/msg/B\nmodule a {{ module msg {{ {struct} }}; }};\n"
    message_type = compile_definition("a/msg/B", text)
    decoded = message_type.decode(message_type(one=value, many=[value, value]).encode())
    assert decoded.one == value and list(decoded.many) == [value, value]
    assert decoded.many.dtype == np.dtype(primitive.numpy.rstrip("_"))
