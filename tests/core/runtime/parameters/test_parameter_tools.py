"""Parameters for tools: groups, services of other programs, events, errors that are raised."""

from __future__ import annotations

import logging
import threading
from typing import Any

import pytest
from support.waiting import take, until
from support.worlds import World, entity

from rosidl_py_gen.msgs.rcl_interfaces.srv import GetParameters, SetParameters
from rosidl_py_gen.runtime import (
    ClosedError,
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterEvent,
    ParameterNotDeclaredError,
    ParameterType,
    SetResult,
    parameter_value,
)

DYNAMIC = ParameterDescriptor(dynamic_typing=True)


def p(name: str, value: object = None) -> Parameter:
    return Parameter(name, parameter_value(value))


def broken(*_: object) -> Any:
    raise KeyError("gone")


def test_parameters_by_prefix_are_returned_with_types(memory: World) -> None:
    node = memory.node("n", time_source=False)
    for name, value in {"arm": 1, "arm.speed": 2.5, "arm.left.tags": ["a"], "army": True}.items():
        node.declare_parameter(name, value)
    node.declare_parameter("arm.unset", None, DYNAMIC)
    below = {"speed": p("arm.speed", 2.5), "left.tags": p("arm.left.tags", ["a"]), "unset": p("arm.unset")}
    assert node.get_parameters_by_prefix("arm") == below
    all_parameters = node.get_parameters_by_prefix()
    assert {"arm", "army", "arm.speed", "start_type_description_service"} <= set(all_parameters) and len(
        all_parameters
    ) == 6
    assert all_parameters["arm"].value.type is ParameterType.INTEGER
    assert node.get_parameters_by_prefix("nope") == {}
    with pytest.raises(TypeError, match="a prefix must be a str"):
        node.get_parameters_by_prefix(5)  # type: ignore[arg-type]


def test_undeclared_names_are_refused_or_raise_with_require_declared(memory: World) -> None:
    node = memory.node("n")
    node.declare_parameter("a", 1)
    node.declare_parameter("b", 1)
    refused = SetResult(False, "Invalid access to undeclared parameter(s): ['x']")
    assert node.set_parameters({"x": 1}) == [refused] and node.set_parameters_atomically({"x": 1}) == refused
    with pytest.raises(ParameterNotDeclaredError, match=r"\['x', 'y'\]"):
        node.set_parameters_atomically({"a": 2, "x": 1, "y": 1}, require_declared=True)
    assert node.get_parameter("a") == 1
    with pytest.raises(ParameterNotDeclaredError, match=r"\['x'\]"):
        node.set_parameters({"a": 2, "x": 1, "b": 2}, require_declared=True)
    assert (node.get_parameter("a"), node.get_parameter("b")) == (2, 1)
    with pytest.raises(ParameterNotDeclaredError, match=r"\['x'\]"):
        node.set_parameter("x", 1)
    with pytest.raises(InvalidParameterValueError, match="Wrong parameter type"):
        node.set_parameter("a", "text")
    free = memory.node("free", allow_undeclared_parameters=True)
    assert free.set_parameters({"x": 1}, require_declared=True) == [SetResult(True)]


@pytest.mark.parametrize("kind", ["pre", "on", "post"])
def test_exception_of_callback_with_raises_reaches_the_setting_caller(memory: World, kind: str) -> None:
    node = memory.node("n")
    node.declare_parameter("a", 1)
    with getattr(node, f"add_{kind}_set_callback")(broken, raises=True):
        for use in (node.set_parameters, node.set_parameters_atomically):
            with pytest.raises(KeyError, match="gone"):
                use({"a": 2})
        with pytest.raises(KeyError, match="gone"):
            node.set_parameter("a", 2)
    assert node.get_parameter("a") == (2 if kind == "post" else 1)


@pytest.mark.every_transport
async def test_remote_set_is_refused_if_a_callback_with_raises_fails(
    world: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = world.node("n")
    node.declare_parameter("a", 1)
    node.add_on_set_callback(broken, raises=True)
    remote = world.node("other").create_parameter_client("/n")
    with caplog.at_level(logging.ERROR):
        assert await remote.set({"a": 2}, 5) == [SetResult(False, "KeyError: 'gone'")]
    assert "setting a parameter for another node failed" in caplog.text and node.get_parameter("a") == 1


def test_event_callbacks_run_in_set_order_without_the_event_topic(memory: World) -> None:
    node = memory.node("n", parameter_events=False)
    events: list[ParameterEvent] = []
    added = node.add_parameter_event_callback(events.append)
    node.declare_parameter("a", 1)
    node.declare_parameter("b", None, DYNAMIC)  # has no value, and so no event
    node.set_parameters_atomically({"a": 2, "b": 1})
    setter = threading.Thread(target=node.set_parameter, args=("b", None))
    setter.start()
    setter.join()
    assert node.count_publishers("/parameter_events") == 0
    assert events == [
        ParameterEvent(new=(p("a", 1),)),
        ParameterEvent(new=(p("b", 1),), changed=(p("a", 2),)),
        ParameterEvent(deleted=(p("b"),)),
    ]
    added.close()
    node.set_parameter("a", 3)
    assert len(events) == 3


def test_raising_event_callback_is_logged_and_other_callbacks_run(
    memory: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = memory.node("n")
    events: list[ParameterEvent] = []
    node.add_parameter_event_callback(broken)
    node.add_parameter_event_callback(events.append)
    node.declare_parameter("a", 1)
    assert len(events) == 1 and "the callback of a parameter event failed" in caplog.text

    async def later(event: ParameterEvent) -> None: ...

    with pytest.raises(TypeError, match="the callback of parameter events 'later' is async"):
        node.add_parameter_event_callback(later)


@pytest.mark.every_transport
async def test_parameter_services_can_be_served_by_another_node(world: World) -> None:
    node, front, asker = world.node("n", start_services=False), world.node("front"), world.node("asker")
    assert not any(name.startswith("/n/set_") for name, _ in node.get_service_names_and_types())
    node.declare_parameter("a", 1, ParameterDescriptor(description="served"))
    node.declare_parameter("fixed", 1, ParameterDescriptor(read_only=True))
    for name, srv_type, handler in node.parameter_services():
        front.create_service(srv_type, f"/n/{name}", handler)
    remote = asker.create_parameter_client("/n")
    events = asker.parameter_events("/n")
    await remote.wait_for_services(10)
    await events.wait_for_publishers(10)
    assert await remote.get("a", 20) == 1 and (await remote.describe("a", 20)).description == "served"
    assert "a" in (await remote.list(timeout_s=20)).names
    publisher = entity(node, "/parameter_events")
    await until(lambda: publisher.has_subscriptions)  # type: ignore[attr-defined]
    assert [one.successful for one in await remote.set({"a": 3, "fixed": 2}, 20)] == [True, False]
    assert node.get_parameter("a") == 3 and (await take(events)).event.changed == (p("a", 3),)


def test_parameter_service_handlers_can_be_called_directly(memory: World) -> None:
    node = memory.node("n", start_services=False)
    node.declare_parameter("a", 1)
    services = {one.name: one for one in node.parameter_services()}
    assert len(services) == 6 and services["get_parameters"].srv_type is GetParameters
    answer = services["get_parameters"].handler(GetParameters.Request(names=["a"]))
    assert isinstance(answer, GetParameters.Response) and answer.values[0].integer_value == 1
    assert services["set_parameters"].srv_type is SetParameters
    node.close()
    with pytest.raises(ClosedError, match="node /n is closed"):
        services["get_parameters"].handler(GetParameters.Request(names=["a"]))
