"""Callbacks and validators that raise or return wrong types."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Annotated, Any

import pytest
from support.parameter_store import StoreWorld, p

from rosidl_py_gen.runtime import CallbackAnswerError, SetResult
from rosidl_py_gen.runtime.parameters.dataclass_parameters import bind_class, update_parameters
from rosidl_py_gen.runtime.parameters.store import ParameterStore
from rosidl_py_gen.runtime.parameters.values import InvalidParameterValueError, Parameter, parameter_value

OK = SetResult(True)


def broken(*_: object) -> Any:
    raise KeyError("gone")


async def later(*_: object) -> Any:
    return OK


def declared(*names: str) -> StoreWorld:
    world = StoreWorld()
    for name in names:
        world.declare(name, 1)
    world.forget_reports()
    return world


@pytest.mark.parametrize("kind", ["pre-set", "on-set"])
def test_raising_set_callback_refuses_the_values_with_reason(kind: str) -> None:
    world = declared("a", "b")
    added = world.store.callbacks.add(kind, broken)
    what = f"the {kind} callback 'broken'"
    refused = SetResult(False, f"{what} raised KeyError: 'gone'")
    assert world.set(a=2) == refused
    assert world.store.set_individually([p("a", 2), p("b", 2)]) == [refused, refused]
    assert world.values() == {"a": 1, "b": 1} and world.events == []
    assert world.failures == [(what, KeyError)] * 3  # the error of the callback is logged
    added.close()
    assert world.set(a=2) == OK


def test_raising_on_set_callback_refuses_a_declaration() -> None:
    world = StoreWorld()
    world.store.callbacks.add("on-set", broken)
    with pytest.raises(
        InvalidParameterValueError, match="cannot be declared as 1: the on-set callback 'broken' raised Key"
    ):
        world.declare("a", 1)
    assert not world.store.has("a") and world.events == []


def test_raising_post_set_callback_is_logged_and_other_callbacks_run() -> None:
    world = declared("a")
    world.store.callbacks.add("post-set", broken)
    assert world.set(a=2) == OK
    assert world.values() == {"a": 2} and world.heard == ["a"]
    world.declare("b", 1)
    assert world.store.has("b") and world.heard == ["a", "b"]
    assert world.failures == [("the post-set callback 'broken'", KeyError)] * 2


def test_exception_of_callback_with_raises_reaches_the_declaring_caller() -> None:
    world = StoreWorld()
    with world.store.callbacks.add("on-set", broken, raises=True), pytest.raises(KeyError, match="gone"):
        world.declare("a", 1)
    assert not world.store.has("a") and world.events == world.failures == []


def test_exception_of_post_set_callback_is_raised_after_all_callbacks_ran() -> None:
    world = declared("a")
    world.store.callbacks.add("post-set", lambda ps: 1 / 0, raises=True)
    world.store.callbacks.add("post-set", broken, raises=True)
    with pytest.raises(KeyError, match="gone"):
        world.set(a=2)
    assert world.values() == {"a": 2} and world.heard == ["a"] and len(world.events) == 1
    assert world.failures == [("the post-set callback '<lambda>'", ZeroDivisionError)]  # only one of two can be raised


def test_post_set_callbacks_run_for_every_declaration_of_a_batch() -> None:
    world = StoreWorld()
    world.store.callbacks.add("post-set", broken, raises=True)
    with pytest.raises(KeyError, match="gone"), world.store.declare_batch() as declared:
        for name in ("a", "b"):
            world.store.declare(name, parameter_value(1))
            declared.append(name)
    assert world.heard == ["a", "b"] and set(world.values()) == {"a", "b"}


def test_failed_parameter_event_is_reported_and_values_are_set() -> None:
    failures: list[str] = []
    store = ParameterStore(on_event=broken, on_failure=failures.append)
    store.declare("a", parameter_value(1))
    assert store.set_atomically([p("a", 2)]) == OK and store.get("a").value == 2
    assert failures == ["publishing a parameter event"] * 2


@pytest.mark.parametrize(
    "answer",
    [None, True, "no", 5, SetResult(False, None), SetResult(True, b"x")],  # type: ignore[arg-type]
)
def test_on_set_callback_must_return_a_set_result(answer: Any) -> None:
    world = declared("a")
    world.store.callbacks.add("on-set", lambda ps: answer)
    with pytest.raises(CallbackAnswerError, match=r"'<lambda>' returned .*, expected a SetResult with a str"):
        world.set(a=2)
    with pytest.raises(TypeError):
        world.declare("b", 2)
    assert world.values() == {"a": 1} and world.events == []


def test_on_set_callback_may_return_any_object_with_result_attributes() -> None:
    world = declared("a")
    added = world.store.callbacks.add("on-set", lambda ps: SimpleNamespace(successful=0, reason="as in rclpy"))  # type: ignore[arg-type,return-value]
    assert world.set(a=2) == SetResult(False, "as in rclpy")
    added.close()
    world.store.callbacks.add("on-set", lambda ps: SetResult(1))  # type: ignore[arg-type]
    result = world.set(a=2)
    assert result == OK and result.successful is True


@pytest.mark.parametrize("answer", [None, "text", 5, [1], {"a": 1}, p("a", 2)])
def test_pre_set_callback_must_return_parameters(answer: Any) -> None:
    world = declared("a")
    world.store.callbacks.add("pre-set", lambda ps: answer)
    with pytest.raises(CallbackAnswerError, match=r"returned .*, expected a list of Parameter objects"):
        world.set(a=2)
    assert world.values() == {"a": 1}


class Later:
    async def __call__(self, parameters: list[Parameter]) -> SetResult:
        return OK


@pytest.mark.parametrize("callback", [later, Later(), functools.partial(later, 1), None, 5])
@pytest.mark.parametrize("kind", ["pre", "on", "post"])
def test_parameter_callbacks_must_be_plain_functions(kind: str, callback: Any) -> None:
    store = ParameterStore()
    with pytest.raises(TypeError, match=f"the {kind}-set callback .*(is async, but a set cannot wait|must be a func)"):
        store.callbacks.add(f"{kind}-set", callback)


def test_coroutine_returned_by_callback_is_refused_without_warning(recwarn: pytest.WarningsRecorder) -> None:
    world = declared("a")
    world.store.callbacks.add("on-set", lambda ps: later())  # type: ignore[arg-type,return-value]
    with pytest.raises(CallbackAnswerError, match="returned <coroutine"):
        world.set(a=2)
    assert not recwarn.list


# ------------------------------------------------------------------------------------------------------- validators


def reciprocal(value: int) -> str | None:
    return None if 1 / value < 10 else "too small"


def truth(value: int) -> Any:
    return value > 0


@dataclass
class Checked:
    v: Annotated[int, reciprocal] = 1
    t: int = 1
    items: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.t < 0:
            raise ValueError("t must not be negative")
        if self.t > 10:
            self.missing  # type: ignore[attr-defined]  # noqa: B018


def test_raising_validator_refuses_only_its_own_field() -> None:
    world = StoreWorld()
    checked = bind_class(world.store, Checked)
    world.events.clear()
    reason = "the validator of 'v' raised ZeroDivisionError: division by zero"
    assert world.store.set_individually([p("t", 2), p("v", 0), p("v", 5)]) == [OK, SetResult(False, reason), OK]
    assert world.failures == [("the validator of 'v'", ZeroDivisionError)] and len(world.events) == 2
    with pytest.raises(InvalidParameterValueError, match=reason):
        checked.v = 0
    with pytest.raises(InvalidParameterValueError, match=reason):
        update_parameters(checked, v=0, t=7)
    assert (checked.v, checked.t) == (5, 2) and world.values() == {"v": 5, "t": 2, "items": ()}


def test_post_init_value_error_is_the_reason_and_other_errors_are_logged() -> None:
    world = StoreWorld()
    bind_class(world.store, Checked)
    assert world.set(t=-1) == SetResult(False, "t must not be negative")
    assert world.failures == []
    refused = world.set(t=11)
    assert refused.reason.startswith("Checked(...) raised AttributeError: ") and world.failures == [
        ("Checked(...)", AttributeError)
    ]


@pytest.mark.parametrize("answer", [True, False, 5, b"no"])
def test_class_validator_must_return_none_or_a_string(answer: Any) -> None:
    world = StoreWorld()
    answers: list[Any] = [None]
    checked = bind_class(world.store, Checked, validator=lambda new: answers[0])
    answers[0] = answer
    with pytest.raises(CallbackAnswerError, match=f"the validator of Checked returned {answer!r}, expected None or"):
        checked.t = 2
    assert checked.t == 1 and world.get("t") == 1


def test_validators_cannot_set_parameters() -> None:
    world = declared("other")

    def check(new: Checked) -> str | None:
        if new.t == 5:
            return world.set(other=2).reason
        if new.t == 6:
            world.declare("another", 1)
        return None

    checked = bind_class(world.store, Checked, validator=check)
    for value in (5, 6):
        with pytest.raises(InvalidParameterValueError, match="cannot be set or declared by a validator"):
            checked.t = value
    assert world.get("other") == 1 and not world.store.has("another") and checked.t == 1


def test_validator_and_post_init_cannot_change_stored_values() -> None:
    @dataclass
    class Lists:
        names: tuple[str, ...] = ("b", "a")
        n: int = 1

        def __post_init__(self) -> None:
            self.n = self.n * 2

    world = StoreWorld()

    def spoil(new: Lists) -> None:
        new.names = ()

    lists = bind_class(world.store, Lists, validator=spoil)
    assert (lists.names, lists.n) == (("b", "a"), 2)
    assert world.set(n=5) == OK
    assert (lists.n, world.get("n"), lists.names) == (5, 5, ("b", "a"))
