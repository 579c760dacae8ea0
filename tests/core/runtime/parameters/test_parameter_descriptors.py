"""Replacing the descriptor of a parameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest
from support.worlds import World

from rosidl_py_gen.runtime import (
    FloatRange,
    IntRange,
    InvalidParameterValueError,
    Node,
    ParameterDescriptor,
    ParameterEvent,
    ParameterImmutableError,
    ParameterNotDeclaredError,
    ParameterType,
    SetResult,
)

SMALL = ParameterDescriptor(integer_range=IntRange(0, 10))


@pytest.fixture
def node(memory: World) -> Node:
    made = memory.node("n", time_source=False)
    made.declare_parameter("a", 5, ParameterDescriptor(description="before"))
    return made


def test_set_descriptor_keeps_a_fitting_value_without_event(node: Node) -> None:
    events: list[ParameterEvent] = []
    node.add_parameter_event_callback(events.append)
    assert node.set_descriptor("a", ParameterDescriptor("other name", integer_range=IntRange(0, 10)), 3) == 5
    assert node.describe_parameter("a") == ParameterDescriptor(
        "a", ParameterType.INTEGER, integer_range=IntRange(0, 10)
    )
    assert events == []
    with pytest.raises(InvalidParameterValueError, match=r"out of range\. Min: 0, Max: 10, value: 11"):
        node.set_parameter("a", 11)


def test_set_descriptor_sets_the_alternative_if_the_value_does_not_fit(node: Node) -> None:
    events: list[ParameterEvent] = []
    node.add_parameter_event_callback(events.append)
    post_set_names: list[str] = []
    node.add_post_set_callback(lambda parameters: post_set_names.extend(one.name for one in parameters))
    described = ParameterDescriptor(type=ParameterType.DOUBLE, floating_point_range=FloatRange(0.0, 4.0))
    assert node.set_descriptor("a", described, 2) == 2.0  # a whole number is a double where one is declared
    assert node.get_parameter("a") == 2.0 and node.describe_parameter("a").type is ParameterType.DOUBLE
    assert [one.value.value for event in events for one in event.changed] == [2.0] and post_set_names == ["a"]


@pytest.mark.parametrize(
    ("descriptor", "alternative", "reason"),
    [
        (ParameterDescriptor(integer_range=IntRange(6, 9)), None, "with the value 5: .*out of range. Min: 6"),
        (ParameterDescriptor(integer_range=IntRange(6, 9)), 10, "with the value 10: .*out of range. Min: 6"),
        (ParameterDescriptor(type=ParameterType.STRING), None, "expected 'Type.STRING' got 'Type.INTEGER'"),
        (ParameterDescriptor(type=ParameterType.STRING), 2.5, "expected 'Type.STRING' got 'Type.DOUBLE'"),
        (ParameterDescriptor(integer_range=IntRange(0, 9, -1)), None, "a step >= 0"),
        (SMALL, object(), "not a parameter value"),
    ],
)
def test_set_descriptor_refuses_descriptor_that_fits_neither_value(
    node: Node, descriptor: ParameterDescriptor, alternative: object, reason: str
) -> None:
    with pytest.raises(InvalidParameterValueError, match=reason):
        node.set_descriptor("a", descriptor, alternative)
    assert node.get_parameter("a") == 5 and node.describe_parameter("a").description == "before"


def test_on_set_callback_can_refuse_the_alternative_value(node: Node) -> None:
    with node.add_on_set_callback(lambda parameters: SetResult(False, "not now")):
        with pytest.raises(
            InvalidParameterValueError, match="'a' cannot have this descriptor with the value 7: not now"
        ):
            node.set_descriptor("a", ParameterDescriptor(integer_range=IntRange(6, 9)), 7)
        assert node.set_descriptor("a", SMALL) == 5  # nothing is set


def test_set_descriptor_cannot_change_type_of_a_bound_field(memory: World) -> None:
    @dataclass
    class Drive:
        speed: float = 1.5

    node = memory.node("n")
    drive = node.declare_parameters(Drive)
    with pytest.raises(InvalidParameterValueError, match=r"Drive\.speed of type DOUBLE, not STRING"):
        node.set_descriptor("speed", ParameterDescriptor(type=ParameterType.STRING), "fast")
    node.set_descriptor("speed", ParameterDescriptor(floating_point_range=FloatRange(0.0, 1.0)), 0.5)
    assert drive.speed == 0.5


def test_set_descriptor_can_switch_dynamic_typing_on_and_off(node: Node) -> None:
    assert node.set_descriptor("a", ParameterDescriptor(dynamic_typing=True)) == 5
    node.set_parameter("a", "text")
    assert node.describe_parameter("a").type is ParameterType.STRING
    assert node.set_descriptor("a", ParameterDescriptor()) == "text"
    with pytest.raises(InvalidParameterValueError, match=r"expected 'Type\.STRING' got 'Type\.INTEGER'"):
        node.set_parameter("a", 5)


def test_empty_list_takes_the_type_of_the_new_descriptor(node: Node) -> None:
    node.declare_parameter("l", [], ParameterDescriptor(type=ParameterType.STRING_ARRAY))
    assert node.set_descriptor("l", ParameterDescriptor(type=ParameterType.INTEGER_ARRAY)) == ()
    assert node.get_parameters_by_prefix()["l"].value.type is ParameterType.INTEGER_ARRAY


def test_set_descriptor_refuses_read_only_and_undeclared_parameters(node: Node, memory: World) -> None:
    node.set_descriptor("a", ParameterDescriptor(read_only=True))
    with pytest.raises(ParameterImmutableError, match="'a' is read-only; its descriptor cannot be changed"):
        node.set_descriptor("a", ParameterDescriptor())
    with pytest.raises(ParameterNotDeclaredError):
        node.set_descriptor("nope", ParameterDescriptor())
    assert (
        memory.node("free", allow_undeclared_parameters=True).set_descriptor("nope", ParameterDescriptor(), 3) is None
    )


@pytest.mark.parametrize("descriptor", [None, {}, ParameterDescriptor(read_only=1)])  # type: ignore[arg-type]
def test_set_descriptor_refuses_values_that_are_not_descriptors(node: Node, descriptor: Any) -> None:
    with pytest.raises(TypeError, match="parameter 'a': "):
        node.set_descriptor("a", descriptor)
    assert node.describe_parameter("a").description == "before"
