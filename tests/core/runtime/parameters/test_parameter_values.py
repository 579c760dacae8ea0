"""Conversion of Python values to parameter values (docs/internals/protocol.md 9.2)."""

from __future__ import annotations

from array import array
from enum import Enum
from typing import Any

import numpy as np
import pytest

from rosidl_py_gen.runtime.parameters.values import (
    INT64_MAX,
    INT64_MIN,
    InvalidParameterValueError,
    Parameter,
    ParameterType,
    ParameterValue,
    as_parameters,
    parameter_value,
)

T = ParameterType


class Color(str, Enum):
    RED = "red"


class Plain(Enum):
    A = 1


class Metres(float):
    pass


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
        (np.float64(0.5), T.DOUBLE, 0.5),
        (np.bool_(True), T.BOOL, True),
        (np.array(3), T.INTEGER, 3),
        (Metres(1.5), T.DOUBLE, 1.5),
        ("ü", T.STRING, "ü"),
        ([np.int64(7)], T.INTEGER_ARRAY, (7,)),
        (ParameterValue(T.STRING_ARRAY, ()), T.STRING_ARRAY, ()),
    ],
)
def test_parameter_type_is_inferred_from_python_value(value: object, kind: ParameterType, stored: object) -> None:
    got = parameter_value(value)
    assert got == ParameterValue(kind, stored)  # type: ignore[arg-type]
    assert type(got.value) is type(stored)


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ([1, 2.0], "all items of an array must have one type, got DOUBLE, INTEGER"),
        ([True, 1], "BOOL, INTEGER"),
        ([b"ab"], "one byte in each item"),
        ([[1]], "not a parameter value"),
        ({"a": 1}, "not a parameter value"),
        (2**63, "does not fit an int64"),
        ([INT64_MAX + 1], "does not fit an int64"),
        (object(), "not a parameter value"),
        (np.zeros((2, 2)), "not a parameter value"),
        ([None], "not a parameter value"),
        (np.float64, "not a parameter value"),
        (Plain.A, "not a parameter value"),
        ("\ud800", "cannot be encoded as UTF-8: surrogates not allowed at character 0"),
        (["a", "b\udfff"], "cannot be encoded as UTF-8: surrogates not allowed at character 1"),
    ],
)
def test_unsupported_parameter_values_are_refused(value: object, reason: str) -> None:
    with pytest.raises(InvalidParameterValueError, match=reason):
        parameter_value(value)


def test_explicit_type_applies_to_empty_lists_and_is_checked() -> None:
    assert parameter_value([], T.STRING_ARRAY) == ParameterValue(T.STRING_ARRAY, ())
    assert parameter_value((), T.BYTE_ARRAY) == ParameterValue(T.BYTE_ARRAY, b"")
    with pytest.raises(InvalidParameterValueError, match="1 is of type INTEGER, expected DOUBLE"):
        parameter_value(1, T.DOUBLE)


def test_as_parameters_accepts_dict_or_parameter_objects() -> None:
    one = Parameter("a", parameter_value(1))
    assert as_parameters({"a": 1}) == as_parameters([one]) == as_parameters(iter([one])) == [one]
    assert as_parameters({}) == []


@pytest.mark.parametrize(
    ("values", "error", "reason"),
    [
        (5, TypeError, "expected a dict of names and values, or a list of Parameter objects, got 5"),
        ("text", TypeError, "expected a dict of names and values"),
        (Parameter("a"), TypeError, "expected a dict of names and values"),
        (["a"], TypeError, "expected Parameter objects or a dict of names and values, got 'a'"),
        ([("a", 1)], TypeError, "expected Parameter objects"),
        ({5: 1}, TypeError, "the name of a parameter must be a str, got 5 of type int"),
        ([Parameter("a", 5)], TypeError, "the value of a Parameter must be a ParameterValue"),  # type: ignore[arg-type]
        ([Parameter(5)], TypeError, "the name of a parameter must be a str"),  # type: ignore[arg-type]
        ({"a": object()}, InvalidParameterValueError, "parameter 'a': <object .* not a parameter value"),
        (
            [Parameter("a", ParameterValue(T.INTEGER, "x"))],
            InvalidParameterValueError,
            "parameter 'a': 'x' is of type STRING",
        ),
    ],
)
def test_as_parameters_refuses_other_arguments(values: Any, error: type[Exception], reason: str) -> None:
    with pytest.raises(error, match=reason):
        as_parameters(values)
