"""Columns of tables: each type of fields has one."""

from __future__ import annotations

from rosidl_py_gen.base.fieldtype import PRIMITIVES
from rosidl_py_gen.tables.arrow_columns import NUMBERS


def test_every_type_of_numbers_has_a_column_type() -> None:
    assert {primitive.code for primitive in PRIMITIVES.values()} == NUMBERS.keys()
    assert {primitive.code: primitive.numpy.rstrip("_") for primitive in PRIMITIVES.values()} == {
        code: str(NUMBERS[code].to_pandas_dtype().__name__).rstrip("_") for code in NUMBERS
    }
