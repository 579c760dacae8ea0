"""Peers that send invalid messages, closed nodes and iterators, and empty responses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from support.inner_state import parts_of
from support.waiting import take
from support.worlds import World

from rosidl_py_gen.msgs.rcl_interfaces.msg import Parameter as ParameterMessage
from rosidl_py_gen.msgs.rcl_interfaces.msg import ParameterValue as ValueMessage
from rosidl_py_gen.msgs.rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rosidl_py_gen.runtime import (
    CallbackAnswerError,
    ClosedError,
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterNotDeclaredError,
    ParameterType,
    ParameterValue,
)

DYNAMIC = ParameterDescriptor(dynamic_typing=True)


@pytest.mark.parametrize("number", [10, 77, 255])
async def test_unknown_parameter_type_in_request_is_refused_without_undeclaring(world: World, number: int) -> None:
    """rclpy and rclcpp raise an error and send no response; the type must not undeclare as NOT_SET does."""
    node, other = world.node("n"), world.node("other")
    node.declare_parameter("d", 1, DYNAMIC)
    node.declare_parameter("e", 1)
    strange = ParameterMessage(name="d", value=ValueMessage(type=number))
    fine = ParameterMessage(name="e", value=ValueMessage(type=2, integer_value=5))
    reason = f"parameter 'd' cannot be set: {number} is not a parameter type"
    change = other.create_client(SetParametersAtomically, "/n/set_parameters_atomically")
    answer = await change.call(SetParametersAtomically.Request(parameters=[fine, strange]), 5)
    assert (answer.result.successful, answer.result.reason) == (False, reason)
    assert node.get_parameters(["d", "e"]) == [1, 1]
    each = other.create_client(SetParameters, "/n/set_parameters")
    results = (await each.call(SetParameters.Request(parameters=[strange, fine]), 5)).results
    assert [(item.successful, item.reason) for item in results] == [(False, reason), (True, "")]
    assert node.get_parameters(["d", "e"]) == [1, 5]


async def test_empty_response_raises_error_that_lists_all_requested_names(world: World) -> None:
    node = world.node("n", "/ns")
    node.declare_parameter("a", 1)
    node.declare_parameter("unset", None, ParameterDescriptor(type=ParameterType.BOOL))
    remote = world.node("other").create_parameter_client("/ns/n")
    text = r"^at least one of \['a', 'unset'\] is undeclared or has no value on /ns/n$"
    with pytest.raises(ParameterNotDeclaredError, match=text) as caught:
        await remote.get(["a", "unset"], 5)
    assert caught.value.names == ("a", "unset")
    text = r"^at least one of \['a', 'nope'\] is undeclared or has no value on /ns/n$"
    for method in (remote.get_types, remote.describe):
        with pytest.raises(ParameterNotDeclaredError, match=text):
            await method(["a", "nope"], 5)


async def test_closed_event_streams_are_not_retained(world: World) -> None:
    remote = world.node("other").create_parameter_client("/n")
    kept = remote.events()
    owned = parts_of(remote)
    for _ in range(3):
        remote.events().close()
    assert kept in owned and parts_of(remote) == owned
    remote.close()
    with pytest.raises(StopAsyncIteration):
        await take(kept)
    with pytest.raises(ClosedError, match="the parameter client of /n of node /other is closed"):
        remote.events()


@pytest.mark.parametrize(
    "call",
    [
        lambda node: node.set_parameter("a", 2),
        lambda node: node.set_parameters({"a": 2}),
        lambda node: node.set_parameters_atomically({"a": 2}),
        lambda node: node.undeclare_parameter("a"),
    ],
)
def test_closed_node_refuses_parameter_sets(world: World, call: Callable[[Any], object]) -> None:
    node = world.node("n")
    node.declare_parameter("a", 1)
    node.close()
    with pytest.raises(ClosedError, match="node /n is closed"):
        call(node)
    assert node.get_parameter("a") == 1


ODD = [
    (ParameterValue(ParameterType.INTEGER, "text"), "'text' is of type STRING, expected INTEGER"),
    (ParameterValue(ParameterType.NOT_SET, 5), "5 is of type INTEGER, expected NOT_SET"),
    (ParameterValue(ParameterType.INTEGER, 2**63), "does not fit an int64"),
    (ParameterValue(2, 5), "must be a Parameter(Type|Value)"),  # type: ignore[arg-type]
]


@pytest.mark.parametrize(("odd", "reason"), ODD)
def test_parameter_values_that_contradict_their_type_are_refused_everywhere(
    world: World, odd: ParameterValue, reason: str
) -> None:
    node = world.node("n")
    node.declare_parameter("d", 1, DYNAMIC)
    calls: list[Callable[[], object]] = [
        lambda: node.set_parameter("d", odd),
        lambda: node.set_parameters([Parameter("d", odd)]),
        lambda: node.declare_parameter("new", odd, DYNAMIC),
        lambda: world.node("late", parameter_overrides={"d": odd}),
    ]
    for call in calls:
        with pytest.raises((InvalidParameterValueError, TypeError), match=reason):
            call()
    added = node.add_pre_set_callback(lambda parameters: [Parameter("d", odd)])
    with pytest.raises(CallbackAnswerError, match=reason):
        node.set_parameter("d", 2)
    added.close()
    assert node.get_parameter("d") == 1 and not node.has_parameter("new")
