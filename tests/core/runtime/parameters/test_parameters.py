"""Parameter store, with the semantics of rclpy (docs/internals/protocol.md 9.3 to 9.5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pytest
from support.parameter_store import StoreWorld, p

from rosidl_py_gen.runtime import ParameterEvent, SetResult
from rosidl_py_gen.runtime.parameters.store import ParameterStore, RefusedError
from rosidl_py_gen.runtime.parameters.values import (
    FloatRange,
    IntRange,
    InvalidParameterNameError,
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterNotDeclaredError,
    ParameterType,
    ParameterUninitializedError,
    ParameterValue,
    WrongParameterTypeError,
    parameter_value,
)

DYNAMIC = ParameterDescriptor(dynamic_typing=True)
OK = SetResult(True)


def test_a_parameter_without_default_needs_a_type_or_dynamic_typing() -> None:
    world = StoreWorld()
    with pytest.raises(InvalidParameterValueError, match="has no type; pass a default"):
        world.declare("a")
    world.declare("a", None, ParameterDescriptor(type=ParameterType.DOUBLE))
    with pytest.raises(ParameterUninitializedError):
        world.get("a")
    assert world.events == [ParameterEvent()]
    assert world.set(p("a", "1")).reason == "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.STRING'"
    assert world.set(p("a", 1.0)) == OK
    assert world.events[-1] == ParameterEvent(new=(p("a", 1.0),))
    world.declare("b", None, DYNAMIC)
    assert world.get("b") is None


def test_default_of_another_type_than_the_descriptor_is_refused() -> None:
    with pytest.raises(WrongParameterTypeError, match="is of type INTEGER, expected DOUBLE"):
        StoreWorld().declare("a", 1, ParameterDescriptor(type=ParameterType.DOUBLE))


def test_overrides_replace_defaults_unless_ignored_and_must_match_the_type() -> None:
    world = StoreWorld(a=5, b="text", c=7)
    assert world.declare("a", 1) == 5
    with pytest.raises(WrongParameterTypeError, match="'b' is of type STRING, expected INTEGER"):
        world.declare("b", 1)
    assert not world.store.has("b")
    assert world.store.declare("c", parameter_value(1), ignore_override=True).value == 1
    assert world.store.overrides["a"].value == 5


@pytest.mark.parametrize(
    ("descriptor", "error", "reason"),
    [
        ("a text", TypeError, "'a': the descriptor must be a ParameterDescriptor, got 'a text'"),
        (ParameterDescriptor(type=2), TypeError, "type of the descriptor must be a ParameterType, got 2"),
        (ParameterDescriptor(description=5), TypeError, "description of the descriptor must be a str, got 5"),
        (ParameterDescriptor(integer_range=(0, 5)), TypeError, "integer_range of the descriptor must be a IntRange"),
        (
            ParameterDescriptor(integer_range=IntRange(0, 5, -1)),
            InvalidParameterValueError,
            "a step >= 0",
        ),
        (
            ParameterDescriptor(floating_point_range=FloatRange(-float("inf"), 1.0, 0.5)),
            InvalidParameterValueError,
            "its step and lower end must be finite",
        ),
    ],
)
def test_invalid_descriptor_is_refused_with_reason(descriptor: object, error: type[Exception], reason: str) -> None:
    world = StoreWorld()
    with pytest.raises(error, match=reason):
        world.declare("a", 1, descriptor)  # type: ignore[arg-type]
    assert not world.store.has("a")


def test_parameter_names_that_cannot_be_encoded_are_refused() -> None:
    world = StoreWorld(allow_undeclared=True)
    for name in ("", "\ud800"):
        with pytest.raises(InvalidParameterNameError):
            world.declare(name, 1)
    assert not world.set(p("\ud800", 1)).successful and world.declare("ä", 1) == 1


def test_declaration_out_of_range_or_against_a_callback_declares_no_parameter() -> None:
    world = StoreWorld()
    with pytest.raises(InvalidParameterValueError, match=r"out of range. Min: 0, Max: 2, value: 3"):
        world.declare("a", 3, ParameterDescriptor(integer_range=IntRange(0, 2)))
    world.store.callbacks.add("on-set", lambda parameters: SetResult(False, "no"))
    with pytest.raises(InvalidParameterValueError, match="cannot be declared as 3: no"):
        world.declare("a", 3)
    assert not world.store.has("a") and world.events == []


def test_refusal_reason_lists_all_undeclared_names() -> None:
    """rclpy forgets the first name (docs/internals/protocol.md 9.4); a single one gives an empty list there."""
    world = StoreWorld()
    world.declare("a", 1)
    result = world.set(p("x", 1), p("a", 2), p("y", 3))
    assert result == SetResult(False, "Invalid access to undeclared parameter(s): ['x', 'y']")
    assert world.get("a") == 1


def test_dynamic_typing_accepts_any_type_and_unsetting_undeclares() -> None:
    world = StoreWorld()
    world.declare("a", 1, DYNAMIC)
    assert world.set(p("a", "text")) == OK
    assert world.store.describe("a").type is ParameterType.STRING
    assert world.set(p("a")) == OK
    assert world.events[-1] == ParameterEvent(deleted=(p("a"),))
    assert not world.store.has("a")
    with pytest.raises(ParameterNotDeclaredError):
        world.store.describe("a")


def test_allow_undeclared_declares_with_dynamic_typing() -> None:
    world = StoreWorld(allow_undeclared=True)
    assert world.get("a") is None
    assert world.store.describe("a") == ParameterDescriptor("a")
    assert world.store.get_all(["a"]) == [ParameterValue()]
    assert world.set(p("a", 1)) == OK and world.set(p("a", "x")) == OK
    assert world.store.describe("a").dynamic_typing
    assert world.store.types(["a", "zz"]) == [ParameterType.STRING, ParameterType.NOT_SET]
    assert not world.set(p("", 1)).successful


def test_queries_return_empty_list_if_one_name_is_undeclared() -> None:
    world = StoreWorld()
    world.declare("a", 1)
    world.declare("u", None, ParameterDescriptor(type=ParameterType.BOOL))
    assert world.store.get_all(["a", "a"]) == [parameter_value(1)] * 2
    assert world.store.get_all(["a", "x"]) == [] and world.store.get_all(["a", "u"]) == []
    assert world.store.types(["a", "u"]) == [ParameterType.INTEGER, ParameterType.NOT_SET]
    assert world.store.types(["a", "x"]) == []
    assert [d.name for d in world.store.describe_all(["u", "a"])] == ["u", "a"]
    assert world.store.describe_all(["a", "x"]) == []


def test_undeclaring_publishes_no_event_and_requires_a_declared_name() -> None:
    world = StoreWorld()
    world.declare("a", 1)
    events = len(world.events)
    world.store.undeclare("a")
    assert len(world.events) == events
    with pytest.raises(ParameterNotDeclaredError):
        world.store.undeclare("a")
    assert world.declare("a", "other type now") == "other type now"


def test_set_callbacks_run_in_the_order_of_rclpy() -> None:
    world = StoreWorld()
    world.declare("a", 1)
    seen: list[str] = []

    def on_set(tag: str, result: SetResult = OK) -> object:
        def callback(parameters: list[Parameter]) -> SetResult:
            seen.append(f"on{tag}:{world.get('a')}")
            return result

        return world.store.callbacks.add("on-set", callback)

    on_set("1")
    on_set("2")
    world.store.callbacks.add("post-set", lambda ps: seen.append(f"post1:{world.get('a')}"))
    world.store.callbacks.add("post-set", lambda ps: seen.append(f"post2:{len(world.events)}"))
    assert world.set(p("a", 2)) == OK
    assert seen == ["on2:1", "on1:1", "post2:2", "post1:2"]


def test_first_refusing_on_set_callback_stops_the_others() -> None:
    world = StoreWorld()
    world.declare("a", 1)
    asked: list[int] = []
    world.store.callbacks.add("on-set", lambda ps: asked.append(1) or OK)  # type: ignore[func-returns-value]
    added = world.store.callbacks.add("on-set", lambda ps: SetResult(False, "because"))
    assert world.set(p("a", 2)) == SetResult(False, "because") and asked == [] and world.get("a") == 1
    added.close()
    added.close()
    assert world.set(p("a", 2)) == OK and asked == [1]


def test_pre_set_callbacks_replace_the_parameter_list() -> None:
    world = StoreWorld()
    world.declare("a", 1)
    world.declare("b", 1)
    first = world.store.callbacks.add("pre-set", lambda ps: [*ps, p("b", 7)])
    second = world.store.callbacks.add("pre-set", lambda ps: [])
    assert world.set(p("a", 2)) == OK and world.get("b") == 7
    first.close()
    assert world.set(p("a", 3)) == SetResult(
        False,
        "parameter list cannot be empty, this might be due to pre_set_parameters_callback modifying the original "
        "parameters list.",
    )
    second.close()
    assert world.get("a") == 2
    world.declare("c", 1)


def test_optional_parameter_can_be_unset_and_keeps_its_type() -> None:
    world = StoreWorld()
    world.store.declare("a", parameter_value(1.5), optional=True)
    assert world.set(p("a")) == OK
    assert world.events[-1] == ParameterEvent(deleted=(p("a"),))
    assert world.store.has("a") and world.store.types(["a"]) == [ParameterType.NOT_SET]
    assert world.set(p("a")) == OK and world.events[-1] == ParameterEvent()
    assert world.set(p("a", True)).reason == "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.BOOL'"
    assert world.set(p("a", 2.0)) == OK and world.events[-1] == ParameterEvent(new=(p("a", 2.0),))


def test_override_without_value_declares_a_parameter_without_value() -> None:
    store = ParameterStore({"a": ParameterValue(), "b": parameter_value(1)})
    store.declare_overrides()
    assert store.values() == {"a": ParameterValue(), "b": parameter_value(1)}
    assert store.describe("a").dynamic_typing


def test_empty_list_override_takes_the_declared_type() -> None:
    world = StoreWorld(a=[], b=[])
    assert world.store.declare("a", parameter_value(["x"])) == parameter_value([], ParameterType.STRING_ARRAY)
    with pytest.raises(WrongParameterTypeError):
        world.declare("b", 1)


def test_integers_are_converted_to_declared_doubles_if_exact() -> None:
    world = StoreWorld(**{"a": 2, "as": [1, 2], "any": 3, "big": 2**53 + 1})
    assert repr([world.declare("a", 1.5), world.declare("as", [0.5]), world.declare("any", 1.5, DYNAMIC)]) == (
        "[2.0, (1.0, 2.0), 3]"
    )
    with pytest.raises(WrongParameterTypeError, match="'big' is of type INTEGER, expected DOUBLE"):
        world.declare("big", 1.5)
    asked: list[object] = []
    world.store.callbacks.add("on-set", lambda ps: asked.extend(one.value.value for one in ps) or OK)
    assert world.set(p("a", 5), p("as", [7, -(2**60)])) == OK
    assert repr([world.get("a"), world.get("as"), asked]) == f"[5.0, (7.0, {-(2.0**60)}), [5.0, (7.0, {-(2.0**60)})]]"
    for wrong in (2**53 + 1, True, "1", [1]):
        assert world.set(p("a", wrong)).reason.startswith("Wrong parameter type, expected 'Type.DOUBLE'")
    assert not world.set(p("as", [1, 2**63 - 1])).successful
    world.declare("whole", 1)
    assert world.set(p("whole", 2.0)).reason == "Wrong parameter type, expected 'Type.INTEGER' got 'Type.DOUBLE'"


def test_bound_objects_are_checked_last_and_updated_before_the_event() -> None:
    world = StoreWorld()
    world.declare("a", 1)
    seen: list[object] = []

    def prepare(changes: Mapping[str, ParameterValue]) -> Callable[[], None] | None:
        if changes["a"].value == 5:
            raise RefusedError("not five")
        seen.append(("asked", world.get("a")))
        return lambda: seen.append(("stored", world.get("a"), len(world.events)))

    added = world.store.callbacks.add("bound-object", prepare)
    with world.store.callbacks.add("on-set", lambda ps: SetResult(False, "no")):
        assert not world.set(p("a", 2)).successful and seen == []
    assert world.set(p("a", 5)) == SetResult(False, "not five") and world.get("a") == 1
    assert world.set(p("a", 2)) == OK and seen == [("asked", 1), ("stored", 2, 1)]
    added.close()
    assert world.set(p("a", 3)) == OK and len(seen) == 2
