"""Callbacks and validators that raise or return wrong types."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Annotated, Any

import pytest
from support.parameter_store import StoreWorld, p

from rosidl_py_gen.runtime import CallbackAnswerError, SetResult
from rosidl_py_gen.runtime.parameters.dataclass_binding import bind_class, update_parameters
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
def test_a_callback_that_raises_refuses_with_a_reason(kind: str) -> None:
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


def test_a_callback_that_raises_refuses_a_declaration() -> None:
    world = StoreWorld()
    world.store.callbacks.add("on-set", broken)
    with pytest.raises(
        InvalidParameterValueError, match="cannot be declared as 1: the on-set callback 'broken' raised Key"
    ):
        world.declare("a", 1)
    assert not world.store.has("a") and world.events == []


def test_a_post_set_callback_that_raises_changes_nothing_and_the_others_still_hear() -> None:
    world = declared("a")
    world.store.callbacks.add("post-set", broken)
    assert world.set(a=2) == OK
    assert world.values() == {"a": 2} and world.heard == ["a"]
    world.declare("b", 1)
    assert world.store.has("b") and world.heard == ["a", "b"]
    assert world.failures == [("the post-set callback 'broken'", KeyError)] * 2


def test_what_a_callback_raises_goes_on_to_whoever_declares() -> None:
    world = StoreWorld()
    with world.store.callbacks.add("on-set", broken, raises=True), pytest.raises(KeyError, match="gone"):
        world.declare("a", 1)
    assert not world.store.has("a") and world.events == world.failures == []


def test_what_a_post_set_callback_raises_comes_when_all_have_heard() -> None:
    world = declared("a")
    world.store.callbacks.add("post-set", lambda ps: 1 / 0, raises=True)
    world.store.callbacks.add("post-set", broken, raises=True)
    with pytest.raises(KeyError, match="gone"):
        world.set(a=2)
    assert world.values() == {"a": 2} and world.heard == ["a"] and len(world.events) == 1
    assert world.failures == [("the post-set callback '<lambda>'", ZeroDivisionError)]  # only one of two can be raised


def test_of_declarations_that_are_made_together_all_are_heard_of() -> None:
    world = StoreWorld()
    world.store.callbacks.add("post-set", broken, raises=True)
    with pytest.raises(KeyError, match="gone"), world.store.declare_batch() as declared:
        for name in ("a", "b"):
            world.store.declare(name, parameter_value(1))
            declared.append(name)
    assert world.heard == ["a", "b"] and set(world.values()) == {"a", "b"}


def test_an_event_that_cannot_be_published_changes_nothing() -> None:
    failures: list[str] = []
    store = ParameterStore(on_event=broken, on_failure=failures.append)
    store.declare("a", parameter_value(1))
    assert store.set_atomically([p("a", 2)]) == OK and store.get("a").value == 2
    assert failures == ["publishing a parameter event"] * 2


@pytest.mark.parametrize(
    "answer",
    [None, True, "no", 5, SetResult(False, None), SetResult(True, b"x")],  # type: ignore[arg-type]
)
def test_an_on_set_callback_must_answer_a_result(answer: Any) -> None:
    world = declared("a")
    world.store.callbacks.add("on-set", lambda ps: answer)
    with pytest.raises(CallbackAnswerError, match=r"'<lambda>' returned .*, expected a SetResult with a str"):
        world.set(a=2)
    with pytest.raises(TypeError):
        world.declare("b", 2)
    assert world.values() == {"a": 1} and world.events == []


def test_what_looks_like_a_result_is_one() -> None:
    world = declared("a")
    added = world.store.callbacks.add("on-set", lambda ps: SimpleNamespace(successful=0, reason="as in rclpy"))  # type: ignore[arg-type,return-value]
    assert world.set(a=2) == SetResult(False, "as in rclpy")
    added.close()
    world.store.callbacks.add("on-set", lambda ps: SetResult(1))  # type: ignore[arg-type]
    result = world.set(a=2)
    assert result == OK and result.successful is True


@pytest.mark.parametrize("answer", [None, "text", 5, [1], {"a": 1}, p("a", 2)])
def test_a_pre_set_callback_must_answer_parameters(answer: Any) -> None:
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
def test_only_plain_functions_can_be_callbacks(kind: str, callback: Any) -> None:
    store = ParameterStore()
    with pytest.raises(TypeError, match=f"the {kind}-set callback .*(is async, but a set cannot wait|must be a func)"):
        store.callbacks.add(f"{kind}-set", callback)


def test_an_async_function_in_disguise_is_refused_without_a_warning(recwarn: pytest.WarningsRecorder) -> None:
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


def test_a_validator_that_raises_refuses_its_own_field_only() -> None:
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


def test_post_init_refuses_with_its_text_or_is_named_when_it_fails() -> None:
    world = StoreWorld()
    bind_class(world.store, Checked)
    assert world.set(t=-1) == SetResult(False, "t must not be negative")
    assert world.failures == []
    refused = world.set(t=11)
    assert refused.reason.startswith("Checked(...) raised AttributeError: ") and world.failures == [
        ("Checked(...)", AttributeError)
    ]


@pytest.mark.parametrize("answer", [True, False, 5, b"no"])
def test_a_validator_must_answer_none_or_a_text(answer: Any) -> None:
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


def test_a_validator_cannot_change_what_is_stored() -> None:
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
