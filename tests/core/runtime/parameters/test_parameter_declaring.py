"""Declaration of a whole dataclass: atomic, with callbacks that set its fields, undeclared fields."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import pytest
from support.parameter_store import StoreWorld, p

from rosidl_py_gen.runtime import ParameterEvent, SetResult
from rosidl_py_gen.runtime.parameters.dataclass_parameters import bind_class
from rosidl_py_gen.runtime.parameters.values import (
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterType,
)


@dataclass
class Drive:
    speed: float = 5.0
    mode: str = "auto"
    gear: int = 1
    limit: float | None = None


@dataclass
class Lamp:
    on: bool = True


def test_post_set_callback_can_correct_declared_values() -> None:
    world = StoreWorld()

    def clamp(parameters: list[Parameter]) -> None:
        for item in parameters:
            if item.name == "speed" and isinstance(item.value.value, float) and item.value.value > 2.0:
                assert world.set(speed=2.0).successful

    world.store.callbacks.add("post-set", clamp)
    drive = bind_class(world.store, Drive)
    assert drive.speed == world.get("speed") == 2.0
    assert [*world.events[0].new, *world.events[-1].changed] == [p("speed", 5.0), p("speed", 2.0)]
    drive.speed = 9.0
    assert drive.speed == world.get("speed") == 2.0


def test_on_set_callback_can_set_an_already_declared_field() -> None:
    world = StoreWorld()

    def slow_down(parameters: list[Parameter]) -> SetResult:
        if parameters[0].name == "mode":
            assert world.set(speed=1.0).successful
        return SetResult(True)

    world.store.callbacks.add("on-set", slow_down)
    drive = bind_class(world.store, Drive)
    assert (drive.speed, drive.mode) == (1.0, "auto") and world.get("speed") == 1.0


def test_values_set_by_callback_during_declaration_are_validated() -> None:
    world = StoreWorld()

    def slow_down(parameters: list[Parameter]) -> SetResult:
        return world.set(speed=-1.0) if parameters[0].name == "mode" else SetResult(True)

    world.store.callbacks.add("on-set", slow_down)
    with pytest.raises(InvalidParameterValueError, match="the parameters of Drive cannot be declared: backwards"):
        bind_class(world.store, Drive, validator=lambda new: "backwards" if new.speed < 0 else None)
    assert world.values() == {} and world.events == [] and world.heard == []


def test_other_changes_during_a_failed_declaration_are_reported() -> None:
    world = StoreWorld()
    world.declare("other", 1)
    world.forget_reports()

    def refuse_gear(parameters: list[Parameter]) -> SetResult:
        if parameters[0].name == "mode":
            world.set(other=2, speed=3.0)
            bind_class(world.store, Lamp)
        return SetResult(parameters[0].name != "gear")

    world.store.callbacks.add("on-set", refuse_gear)
    with pytest.raises(InvalidParameterValueError):
        bind_class(world.store, Drive)
    assert world.events == [ParameterEvent(changed=(p("other", 2),)), ParameterEvent(new=(p("on", True),))]
    assert world.heard == ["other", "on"] and set(world.store.values()) == {"other", "on"}


def test_declaration_events_and_callbacks_keep_order_and_see_all_fields() -> None:
    world = StoreWorld()
    complete: list[bool] = []
    world.store.callbacks.add("post-set", lambda ps: complete.append(world.store.has("limit")))
    bind_class(world.store, Drive)
    assert [[item.name for item in event.new] for event in world.events] == [["speed"], ["mode"], ["gear"], []]
    assert world.heard == ["speed", "mode", "gear", "limit"] and complete == [True] * 4


def test_post_set_callbacks_of_a_declaration_do_not_block_other_threads() -> None:
    world = StoreWorld()
    world.declare("other", 1)
    results: list[SetResult] = []

    def set_elsewhere(parameters: list[Parameter]) -> None:
        if parameters[0].name == "speed":
            thread = threading.Thread(target=lambda: results.append(world.set(other=2)), daemon=True)
            thread.start()
            thread.join(20)

    world.store.callbacks.add("post-set", set_elsewhere)
    bind_class(world.store, Drive)
    assert results == [SetResult(True)] and world.get("other") == 2 and "other" in world.heard


# ---------------------------------------------------------------------------------- undeclared and redeclared fields


def test_redeclared_field_with_same_type_is_bound_again() -> None:
    world = StoreWorld()
    drive = bind_class(world.store, Drive)
    world.store.undeclare("speed")
    assert drive.speed == 5.0
    with pytest.raises(InvalidParameterValueError, match=r"undeclared parameter\(s\): \['speed'\]"):
        drive.speed = 1.0
    world.declare("speed", 3.0)
    assert drive.speed == 3.0
    drive.speed = 4.0
    assert world.get("speed") == 4.0


@pytest.mark.parametrize("dynamic", [False, True])
def test_field_cannot_be_redeclared_with_another_type(dynamic: bool) -> None:
    world = StoreWorld()
    drive = bind_class(world.store, Drive)
    world.store.undeclare("speed")
    text = "'speed' cannot be declared as 'y': it is bound to Drive.speed of type DOUBLE, not STRING"
    with pytest.raises(InvalidParameterValueError, match=text):
        world.declare("speed", "y", ParameterDescriptor(dynamic_typing=dynamic))
    assert drive.speed == 5.0 and not world.store.has("speed")


def test_redeclared_dynamically_typed_field_keeps_its_type() -> None:
    world = StoreWorld()
    drive = bind_class(world.store, Drive)
    world.store.undeclare("speed")
    world.declare("speed", 1.5, ParameterDescriptor(dynamic_typing=True))
    for value, name in (("y", "STRING"), (None, "NOT_SET")):
        refused = SetResult(False, f"it is bound to Drive.speed of type DOUBLE, not {name}")
        assert world.set(speed=value) == refused
    assert drive.speed == 1.5
    world.store.undeclare("limit")
    world.store.declare("limit", descriptor=ParameterDescriptor(type=ParameterType.DOUBLE), optional=True)
    assert drive.limit is None and world.set(limit=2.0).successful and drive.limit == 2.0
