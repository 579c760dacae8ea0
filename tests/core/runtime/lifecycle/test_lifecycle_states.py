"""Lifecycle state machine: every transition of docs/internals/protocol.md 12.2."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from rosidl_py_gen import runtime
from rosidl_py_gen.runtime.lifecycle import (
    LIFECYCLE_TRANSITIONS,
    State,
    TransitionCallbackReturn,
    TransitionError,
    available_transitions,
    finished_transition,
    requested_transition,
    to_callback_return,
)

REQUESTS = {
    (State.UNCONFIGURED, "configure"): (1, State.CONFIGURING),
    (State.INACTIVE, "cleanup"): (2, State.CLEANINGUP),
    (State.INACTIVE, "activate"): (3, State.ACTIVATING),
    (State.ACTIVE, "deactivate"): (4, State.DEACTIVATING),
    (State.UNCONFIGURED, "shutdown"): (5, State.SHUTTINGDOWN),
    (State.INACTIVE, "shutdown"): (6, State.SHUTTINGDOWN),
    (State.ACTIVE, "shutdown"): (7, State.SHUTTINGDOWN),
}
ENDS = {
    State.CONFIGURING: (10, State.INACTIVE, State.UNCONFIGURED, State.ERRORPROCESSING),
    State.CLEANINGUP: (20, State.UNCONFIGURED, State.INACTIVE, State.ERRORPROCESSING),
    State.ACTIVATING: (30, State.ACTIVE, State.INACTIVE, State.ERRORPROCESSING),
    State.DEACTIVATING: (40, State.INACTIVE, State.ACTIVE, State.ERRORPROCESSING),
    State.SHUTTINGDOWN: (50, State.FINALIZED, State.FINALIZED, State.ERRORPROCESSING),
    State.ERRORPROCESSING: (60, State.UNCONFIGURED, State.FINALIZED, State.FINALIZED),
}
LABELS = sorted({label for _, label in REQUESTS})


def test_lifecycle_states_have_the_numbers_and_labels_of_ros() -> None:
    assert [int(state) for state in State] == [0, 1, 2, 3, 4, 10, 11, 12, 13, 14, 15]
    assert State.ERRORPROCESSING.label == "errorprocessing"


def test_requested_transition_covers_every_request_in_every_state() -> None:
    by_id = {(start, row[0]): row[1] for (start, _), row in REQUESTS.items()}
    for state in State:
        for label in LABELS:
            got = requested_transition(state, 255, label)
            assert (None if got is None else (got.id, got.goal)) == REQUESTS.get((state, label)), (state, label)
        for number in range(70):
            got = requested_transition(state, number, "")
            assert (None if got is None else got.goal) == by_id.get((state, number)), (state, number)
    got = requested_transition(State.INACTIVE, 2, "activate")
    assert got is not None and got.id == 3, "a label takes precedence over the id"
    assert requested_transition(State.CONFIGURING, 0, "transition_success") is None


def test_finished_transition_covers_every_outcome_in_every_state() -> None:
    for state, (index, outcome) in itertools.product(State, enumerate(TransitionCallbackReturn)):
        if state in ENDS:
            first, *goals = ENDS[state]
            row = finished_transition(state, outcome)
            assert (row.id, row.goal, row.label) == (first + index, goals[index], outcome.value)
        else:
            with pytest.raises(TransitionError, match="not possible in state"):
                finished_transition(state, outcome)


@pytest.mark.parametrize(
    ("state", "outcome"), [(10, TransitionCallbackReturn.SUCCESS), (State.CONFIGURING, "transition_success")]
)
def test_finished_transition_refuses_values_of_wrong_type(state: Any, outcome: Any) -> None:
    with pytest.raises(TypeError, match="expected a State and a TransitionCallbackReturn, got "):
        finished_transition(state, outcome)


def test_lifecycle_transition_table_is_public() -> None:
    assert runtime.LIFECYCLE_TRANSITIONS is LIFECYCLE_TRANSITIONS
    row = runtime.requested_transition(runtime.State.UNCONFIGURED, label="configure")
    assert row == runtime.Transition(1, "configure", State.UNCONFIGURED, State.CONFIGURING)
    assert row in runtime.available_transitions(State.UNCONFIGURED)
    assert len(LIFECYCLE_TRANSITIONS) == 7 + 18 and len({row.id for row in LIFECYCLE_TRANSITIONS}) == 25
    assert [row.id for row in available_transitions(State.INACTIVE)] == [2, 3, 6]
    assert available_transitions(State.FINALIZED) == ()
    assert runtime.finished_transition(row.goal, TransitionCallbackReturn.SUCCESS).goal is State.INACTIVE


@pytest.mark.parametrize(
    ("outcome", "values"),
    [
        # 97 to 99 are TRANSITION_CALLBACK_SUCCESS, _FAILURE and _ERROR of lifecycle_msgs/Transition
        (TransitionCallbackReturn.SUCCESS, [None, True, np.True_, 1, TransitionCallbackReturn.SUCCESS, 97]),
        (TransitionCallbackReturn.FAILURE, [False, np.False_, 0, "", [], TransitionCallbackReturn.FAILURE, 98]),
        (TransitionCallbackReturn.ERROR, [TransitionCallbackReturn.ERROR, 99]),
    ],
)
def test_callback_return_values_convert_to_transition_callback_return(
    outcome: TransitionCallbackReturn, values: list[object]
) -> None:
    for value in values:
        assert to_callback_return(value) is outcome, value
