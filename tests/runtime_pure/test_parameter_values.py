"""Which Python value is which parameter type: protocol.md 9.2."""

from __future__ import annotations

from array import array
from enum import Enum

import numpy as np
import pytest

from rosidl_py_gen.runtime.parameter_values import (
    INT64_MAX,
    INT64_MIN,
    InvalidParameterValue,
    ParameterNotDeclared,
    ParameterType,
    ParameterValue,
    WrongParameterType,
    parameter_value,
)

T = ParameterType


class Color(str, Enum):
    RED = "red"


@pytest.mark.parametrize(
    ("value", "kind", "stored"),
    [
        (None, T.NOT_SET, None),
        (True, T.BOOL, True),
        (3, T.INTEGER, 3),
        (INT64_MIN, T.INTEGER, INT64_MIN),
        (1.5, T.DOUBLE, 1.5),
        ("x", T.STRING, "x"),
        (Color.RED, T.STRING, "red"),
        (b"\x01\x02", T.BYTE_ARRAY, b"\x01\x02"),
        (bytearray(b"a"), T.BYTE_ARRAY, b"a"),
        ([b"a", b"b"], T.BYTE_ARRAY, b"ab"),
        ([], T.BYTE_ARRAY, b""),
        ([True, False], T.BOOL_ARRAY, (True, False)),
        ((1, 2), T.INTEGER_ARRAY, (1, 2)),
        ([1.0], T.DOUBLE_ARRAY, (1.0,)),
        (["a", "b"], T.STRING_ARRAY, ("a", "b")),
        (array("l", [1, 2]), T.INTEGER_ARRAY, (1, 2)),
        (array("d", [1, 2]), T.DOUBLE_ARRAY, (1.0, 2.0)),
        (np.array([1, 2], np.uint8), T.INTEGER_ARRAY, (1, 2)),
        (np.array([True]), T.BOOL_ARRAY, (True,)),
        (np.float32(0.5), T.DOUBLE, 0.5),
        ([np.int64(7)], T.INTEGER_ARRAY, (7,)),
    ],
)
def test_inference(value: object, kind: ParameterType, stored: object) -> None:
    got = parameter_value(value)
    assert got == ParameterValue(kind, stored)  # type: ignore[arg-type]
    assert type(got.value) is type(stored)


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ([1, 2.0], "all items of an array must have one type, got DOUBLE, INTEGER"),
        ([True, 1], "BOOL, INTEGER"),
        ([b"ab"], "one byte per item"),
        ([[1]], "no parameter value"),
        ({"a": 1}, "no parameter value"),
        (2**63, "does not fit an int64"),
        ([INT64_MAX + 1], "does not fit an int64"),
        (object(), "no parameter value"),
        (np.zeros((2, 2)), "no parameter value"),
        ([None], "no parameter value"),
    ],
)
def test_what_is_no_parameter_value(value: object, reason: str) -> None:
    with pytest.raises(InvalidParameterValue, match=reason):
        parameter_value(value)


def test_a_stated_type_decides_for_empty_lists_and_is_checked() -> None:
    assert parameter_value([], T.STRING_ARRAY) == ParameterValue(T.STRING_ARRAY, ())
    assert parameter_value((), T.BYTE_ARRAY) == ParameterValue(T.BYTE_ARRAY, b"")
    with pytest.raises(InvalidParameterValue, match="1 is of type INTEGER, expected DOUBLE"):
        parameter_value(1, T.DOUBLE)


def test_errors_name_what_is_wrong() -> None:
    assert str(ParameterNotDeclared(["a", "b"])) == "Invalid access to undeclared parameter(s): ['a', 'b']"
    assert str(WrongParameterType("a", "DOUBLE", "STRING")) == "parameter 'a' is of type STRING, expected DOUBLE"
