"""Rules around use_sim_time: protocol.md 9.6."""

from __future__ import annotations

import pytest

from rosidl_py_gen.runtime.node.sim_time import SimTimeRule, SimTimeStep, check_use_sim_time
from rosidl_py_gen.runtime.parameters.values import Parameter, parameter_value


def p(value: object, name: str = "use_sim_time") -> Parameter:
    return Parameter(name, parameter_value(value))


@pytest.mark.parametrize("value", [1, "true", 1.0, [True], None])
def test_only_a_bool_is_accepted(value: object) -> None:
    result = check_use_sim_time([p(5, "other"), p(value)])
    assert (result.successful, result.reason) == (False, "use_sim_time parameter set to something besides a bool")


def test_bools_and_other_parameters_pass() -> None:
    assert check_use_sim_time([p(True), p(False), p(5, "other")]).successful


def test_steps_happen_on_changes_only() -> None:
    rule = SimTimeRule()
    steps = [rule.after_set([p(value)]) for value in (False, True, True, False, False)]
    assert steps == [
        SimTimeStep.NOTHING,
        SimTimeStep.START,
        SimTimeStep.NOTHING,
        SimTimeStep.STOP,
        SimTimeStep.NOTHING,
    ]
    assert rule.after_set([p(True, "other")]) is SimTimeStep.NOTHING
