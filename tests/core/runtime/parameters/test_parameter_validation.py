"""Ranges, steps and listings, with rclpy's reasons (docs/internals/protocol.md 9.3, 9.4)."""

from __future__ import annotations

import math

import pytest

from rosidl_py_gen.runtime.parameters.values import (
    FloatRange,
    IntRange,
    Parameter,
    ParameterDescriptor,
    ParameterType,
    float_range_reason,
    integer_range_reason,
    list_names,
    parameter_value,
    range_reason,
    refusal_reason,
)


@pytest.mark.parametrize(
    ("value", "allowed", "reason"),
    [
        (0, IntRange(0, 10), ""),
        (10, IntRange(0, 10, 3), ""),  # an end is always allowed, on a step or not
        (9, IntRange(0, 10, 3), ""),
        (5, IntRange(10, 0), ""),  # ends may be swapped
        (-1, IntRange(0, 10), "Parameter p out of range. Min: 0, Max: 10, value: -1"),
        (11, IntRange(10, 0), "Parameter p out of range. Min: 0, Max: 10, value: 11"),
        (4, IntRange(0, 10, 3), "The parameter value for p is not a valid step. Min: 0, max: 10, value: 4, step: 3"),
        (3, IntRange(-2, 10, 5), ""),
    ],
)
def test_integer_range_violations_have_rclpy_reasons(value: int, allowed: IntRange, reason: str) -> None:
    assert integer_range_reason("p", value, allowed) == reason


@pytest.mark.parametrize(
    ("value", "allowed", "reason"),
    [
        (0.0, FloatRange(0.0, 2.5), ""),
        (2.5 + 1e-9, FloatRange(0.0, 2.5), ""),
        (2.6, FloatRange(0.0, 2.5), "Parameter p out of range Min: 0.0, Max: 2.5, value: 2.6"),
        (float("nan"), FloatRange(0.0, 2.5), "Parameter p out of range Min: 0.0, Max: 2.5, value: nan"),
        (0.3, FloatRange(0.0, 1.0, 0.1), ""),
        (2.5, FloatRange(0.0, 2.5, 2.0), ""),
        (1.0, FloatRange(-math.inf, 10.0, 0.5), ""),  # steps have no finite start; declaring refuses such a range
        (1.0, FloatRange(0.0, 10.0, 5e-324), ""),
        (11.0, FloatRange(-math.inf, 10.0, 0.5), "Parameter p out of range Min: -inf, Max: 10.0, value: 11.0"),
        (
            0.35,
            FloatRange(0.0, 1.0, 0.1),
            "The parameter value for p is not close enough to a valid step. Min: 0.0, max: 1.0, value: 0.35, step: 0.1",
        ),
    ],
)
def test_float_range_violations_have_rclpy_reasons(value: float, allowed: FloatRange, reason: str) -> None:
    assert float_range_reason("p", value, allowed) == reason


@pytest.mark.parametrize(
    ("allowed", "is_valid"),
    [
        (IntRange(-(2**63), 2**63 - 1, 0), True),
        (IntRange(-(2**63) - 1, 0), False),
        (IntRange(0, 2**63), False),
        (IntRange(0, 1, -1), False),
        (FloatRange(-1.0, 1.0, 0.0), True),
    ],
)
def test_only_ranges_that_fit_a_message_are_valid(allowed: IntRange | FloatRange, is_valid: bool) -> None:
    assert (range_reason(allowed) == "") is is_valid


INT = ParameterDescriptor("p", ParameterType.INTEGER)


@pytest.mark.parametrize(
    ("value", "descriptor", "reason"),
    [
        (1, ParameterDescriptor("p", ParameterType.INTEGER, read_only=True), "Trying to set a read-only parameter: p."),
        (None, INT, "Static parameter cannot be undeclared"),
        ("x", INT, "Wrong parameter type, expected 'Type.INTEGER' got 'Type.STRING'"),
        (1, INT, ""),
        (1.0, INT, "Wrong parameter type, expected 'Type.INTEGER' got 'Type.DOUBLE'"),
        ("x", ParameterDescriptor("p", ParameterType.INTEGER, dynamic_typing=True), ""),
        (None, ParameterDescriptor("p", ParameterType.INTEGER, dynamic_typing=True), ""),
        (
            1,
            ParameterDescriptor("p", ParameterType.INTEGER, integer_range=IntRange(2, 3)),
            "Parameter p out of range. Min: 2, Max: 3, value: 1",
        ),
        (
            1.0,
            ParameterDescriptor("p", dynamic_typing=True, floating_point_range=FloatRange(2, 3)),
            "Parameter p out of range Min: 2, Max: 3, value: 1.0",
        ),
        # A range of the other number type does not apply.
        (1, ParameterDescriptor("p", ParameterType.INTEGER, floating_point_range=FloatRange(2, 3)), ""),
        # Ranges do not apply to arrays.
        ([1], ParameterDescriptor("p", ParameterType.INTEGER_ARRAY, integer_range=IntRange(2, 3)), ""),
    ],
)
def test_descriptor_violations_have_rclpy_reasons(value: object, descriptor: ParameterDescriptor, reason: str) -> None:
    assert refusal_reason(Parameter("p", parameter_value(value)), descriptor) == reason


NAMES = ["a", "g.x", "g.s.y", "g.s.z", "gg.x", "h.x.y.z"]


@pytest.mark.parametrize(
    ("prefixes", "depth", "names"),
    [
        ([], 0, NAMES),
        ([], 1, ["a"]),
        ([], 2, ["a", "g.x", "gg.x"]),
        (["g"], 0, ["g.x", "g.s.y", "g.s.z"]),
        (["g"], 1, ["g.x"]),
        (["g.s"], 1, ["g.s.y", "g.s.z"]),
        (["a"], 1, ["a"]),
        (["a", "gg"], 0, ["a", "gg.x"]),
        (["g."], 0, []),
        (["nothing"], 0, []),
    ],
)
def test_parameter_names_are_listed_by_prefix_and_depth(prefixes: list[str], depth: int, names: list[str]) -> None:
    assert list(list_names(NAMES, prefixes, depth).names) == names


def test_listed_prefixes_are_unique_group_names() -> None:
    assert list_names(NAMES, [], 0).prefixes == ("g", "g.s", "gg", "h.x.y")
