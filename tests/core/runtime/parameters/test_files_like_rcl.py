"""Parameter files and ``-p`` as rcl reads them: the table of `support/parameter_file_cases.py` against real rclpy.

`golden/rclpy_parameter_files.json` has the results of real rclpy; `ros_compat/test_parameter_files.py` compares it with
an installed one, and our rclpy with both.
"""

from __future__ import annotations

import json
from typing import Any

import pytest
from support.parameter_file_cases import DEVIATIONS, GOLDEN, REFUSED, results

from rosidl_py_gen.runtime.node.settings import parse_arguments
from rosidl_py_gen.runtime.parameters.values import ParameterType, ParameterValue


def read(arguments: list[str], node: str) -> dict[str, Any]:
    parsed = parse_arguments(arguments)
    return {name: as_rclpy(value) for name, value in parsed.overrides_for(node).items()}


def as_rclpy(value: ParameterValue) -> list[Any]:
    """Return type and value; an empty list, which gets the declared type here, is not set in rclpy."""
    if value == (ParameterType.BYTE_ARRAY, b""):
        return ["NOT_SET", None]
    content = [str(bytes([one])) for one in value.value] if isinstance(value.value, bytes) else value.value
    return [value.type.name, list(content) if isinstance(content, (list, tuple)) else content]


@pytest.fixture(scope="module")
def ours() -> dict[str, Any]:
    return results(read)


RECORDED = json.loads(GOLDEN.read_text(encoding="utf-8"))["kilted"]


@pytest.mark.parametrize("name", RECORDED)
def test_parameter_files_and_arguments_are_read_like_rclpy(ours: dict[str, Any], name: str) -> None:
    assert ours[name] == DEVIATIONS.get(name, RECORDED[name])


def test_recorded_deviations_differ_from_rclpy_and_are_refused() -> None:
    assert all(RECORDED[name] != result for name, result in DEVIATIONS.items())
    assert sum(result != REFUSED for result in DEVIATIONS.values()) <= 1
