"""Failing callbacks and validators do not leave a remote node without response."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Annotated, Any

import pytest
from support.node_fixtures import World, run

from rosidl_py_gen.runtime import SetResult
from rosidl_py_gen.runtime.parameters.values import InvalidParameterValueError


def reciprocal(value: int) -> str | None:
    return None if 1 / value < 10 else "too small"


@dataclass
class Checked:
    v: Annotated[int, reciprocal] = 1
    t: int = 1

    def __post_init__(self) -> None:
        if self.t > 10:
            raise LookupError("t")


OK = SetResult(True)
DIVIDED = SetResult(False, "the validator of 'v' raised ZeroDivisionError: division by zero")


def test_a_validator_that_raises_is_answered(world: World, caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        node = world.node("n")
        checked = node.declare_parameters(Checked)
        remote = world.node("other").create_parameter_client("/n")
        assert await remote.set({"t": 2, "v": 0}, timeout_s=5) == [OK, DIVIDED]
        assert await remote.set_atomically({"t": 3, "v": 0}, timeout_s=5) == DIVIDED
        refused = SetResult(False, "Checked(...) raised LookupError: t")
        assert await remote.set({"t": 11}, timeout_s=5) == [refused]
        assert (checked.t, checked.v) == (2, 1)
        assert node.set_parameters({"v": 0, "t": 4}) == [DIVIDED, OK] and checked.t == 4
        with pytest.raises(InvalidParameterValueError, match="raised ZeroDivisionError"):
            node.set_parameter("v", 0)

    with caplog.at_level(logging.ERROR):
        run(main)
    assert "the validator of 'v' failed" in caplog.text and "1 / value < 10" in caplog.text


def broken(*_: object) -> Any:
    raise KeyError("gone")


@pytest.mark.parametrize(
    ("kind", "callback", "reason"),
    [
        ("pre", broken, "the pre-set callback 'broken' raised KeyError: 'gone'"),
        ("on", broken, "the on-set callback 'broken' raised KeyError: 'gone'"),
        ("pre", lambda ps: None, "'<lambda>' returned None, expected a list of Parameter objects"),
        ("on", lambda ps: None, "the on-set callback '<lambda>' returned None, expected a SetResult"),
        ("on", lambda ps: True, "returned True, expected a SetResult"),
        ("on", lambda ps: "no", "returned 'no', expected a SetResult"),
        ("on", lambda ps: SetResult(False, "caf\udce9 \U0001f916"), "caf? \U0001f916"),
    ],
)
async def test_callbacks_that_fail_are_answered(world: World, kind: str, callback: Any, reason: str) -> None:
    node = world.node("n")
    node.declare_parameter("a", 1)
    getattr(node, f"add_{kind}_set_callback")(callback)
    remote = world.node("other").create_parameter_client("/n")
    (first,) = await remote.set({"a": 2}, timeout_s=5)
    second = await remote.set_atomically({"a": 2}, timeout_s=5)
    assert first == second and not first.successful and reason in first.reason
    assert node.get_parameter("a", int) == 1
