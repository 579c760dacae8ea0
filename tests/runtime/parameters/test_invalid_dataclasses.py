"""Dataclasses that cannot be parameters: the error names the field."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Annotated, Literal

import pytest

from rosidl_py_gen.runtime.parameters.dataclass_fields import Int8, ParameterClassError, Range, parameter_fields_of


async def later(value: int) -> str | None:
    return None


@dataclass
class Plain:
    a: int = 1


@pytest.mark.parametrize(
    ("annotation", "reason"),
    [
        (dict[str, int], "cannot be a parameter"),
        (list[list[int]], "cannot be a parameter"),
        (int | str, "cannot be a parameter"),
        (list[bytes], "cannot be a parameter"),
        (Literal["a", 1], "choices must be all str, all int or all bool"),
        (Annotated[str, Range(0, 1)], "a range is for numbers only"),
        (Annotated[int, Range(0, 1.5)], "must have integer ends"),
        (Annotated[Int8, Range(0, 200)], "does not fit Width"),
        (Annotated[int, Range(float("-inf"), 10)], "must have integer ends"),
        (Annotated[int, Range(float("nan"), 10)], "must have integer ends"),
        (Annotated[int, Range(0, 10, -1)], "a step >= 0"),
        (Annotated[int, Range(0, 2**64)], "must have 64-bit integers"),
        (Annotated[float, Range(float("-inf"), 10, 0.5)], "its step and lower end must be finite"),
        (Annotated[float, Range(0, 1, float("inf"))], "lower end must be finite"),
        (Annotated[float, Range(float("nan"), 1)], "must have numbers as its ends"),
        (Annotated[float, Range("a", 1)], "must have numbers as its ends"),  # type: ignore[arg-type]
        (Annotated[float, Range(0, 10**400)], "must have numbers as its ends"),
        (Annotated[int, later], "the validator 'later' is async"),
    ],
)
def test_what_cannot_be_a_parameter_is_said_with_class_and_field(annotation: object, reason: str) -> None:
    made = dataclasses.make_dataclass("Bad", [("x", annotation, None)])
    with pytest.raises(ParameterClassError, match=f"Bad.x: .*{reason}"):
        parameter_fields_of(made)


def test_an_annotation_that_cannot_be_resolved_is_explained() -> None:
    @dataclass
    class Local:
        pwm: int = 0

    @dataclass
    class Holder:
        motor: Local = field(default_factory=Local)

    with pytest.raises(ParameterClassError, match="Holder: name 'Local' is not defined"):
        parameter_fields_of(Holder)


def test_only_dataclasses() -> None:
    with pytest.raises(ParameterClassError, match="is an object; pass its class"):
        parameter_fields_of(Plain())  # type: ignore[arg-type]
    with pytest.raises(ParameterClassError, match="is not a dataclass"):
        parameter_fields_of(int)
