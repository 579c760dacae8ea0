"""Lifecycle state machine: the whole table of docs/internals/protocol.md 12.2."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from support.example_counts import examples

from rosidl_py_gen import runtime
from rosidl_py_gen.runtime.lifecycle.state_machine import (
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


def test_state_numbers_and_labels() -> None:
    assert [int(state) for state in State] == [0, 1, 2, 3, 4, 10, 11, 12, 13, 14, 15]
    assert State.ERRORPROCESSING.label == "errorprocessing"


def test_every_request_in_every_state() -> None:
    by_id = {(start, row[0]): row[1] for (start, _), row in REQUESTS.items()}
    for state in State:
        for label in LABELS:
            got = requested_transition(state, 255, label)
            assert (None if got is None else (got.id, got.goal)) == REQUESTS.get((state, label)), (state, label)
        for number in range(70):
            got = requested_transition(state, number, "")
            assert (None if got is None else got.goal) == by_id.get((state, number)), (state, number)


def test_a_label_wins_over_the_id_and_outcomes_cannot_be_requested() -> None:
    got = requested_transition(State.INACTIVE, 3, "cleanup")
    assert got is not None and got.id == 2
    assert requested_transition(State.CONFIGURING, 0, "transition_success") is None


def test_every_outcome_in_every_state() -> None:
    for state, (index, outcome) in itertools.product(State, enumerate(TransitionCallbackReturn)):
        if state in ENDS:
            first, *goals = ENDS[state]
            row = finished_transition(state, outcome)
            assert (row.id, row.goal, row.label) == (first + index, goals[index], outcome.value)
        else:
            with pytest.raises(TransitionError, match="not possible in state"):
                finished_transition(state, outcome)


class Walk(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.state = State.UNCONFIGURED

    @rule(label=st.sampled_from(LABELS), by_id=st.booleans())
    def request(self, label: str, by_id: bool) -> None:
        expected = REQUESTS.get((self.state, label))
        number = expected[0] if expected else 255
        row = requested_transition(self.state, number, "" if by_id else label)
        assert (row and (row.id, row.goal)) == expected
        self.state = row.goal if row else self.state

    @precondition(lambda self: self.state in ENDS)
    @rule(outcome=st.sampled_from(TransitionCallbackReturn))
    def finish(self, outcome: TransitionCallbackReturn) -> None:
        expected = ENDS[self.state][1 + list(TransitionCallbackReturn).index(outcome)]
        self.state = finished_transition(self.state, outcome).goal
        assert self.state is expected

    @invariant()
    def the_available_transitions_leave_the_state(self) -> None:
        rows = available_transitions(self.state)
        assert {row.start for row in rows} <= {self.state}
        assert [row.id for row in rows if row.id < 10] == sorted(
            number for (start, _), (number, _) in REQUESTS.items() if start is self.state
        )


TestWalk = Walk.TestCase
TestWalk.settings = settings(max_examples=examples(50), stateful_step_count=30, deadline=None)


@pytest.mark.parametrize(
    ("state", "outcome"), [(10, TransitionCallbackReturn.SUCCESS), (State.CONFIGURING, "transition_success")]
)
def test_numbers_and_texts_are_no_state_and_no_outcome(state: Any, outcome: Any) -> None:
    with pytest.raises(TypeError, match="expected a State and a TransitionCallbackReturn, got "):
        finished_transition(state, outcome)


def test_the_table_is_public() -> None:
    assert runtime.LIFECYCLE_TRANSITIONS is LIFECYCLE_TRANSITIONS
    row = runtime.requested_transition(runtime.State.UNCONFIGURED, label="configure")
    assert row == runtime.Transition(1, "configure", State.UNCONFIGURED, State.CONFIGURING)
    assert row in runtime.available_transitions(State.UNCONFIGURED)
    assert runtime.finished_transition(row.goal, TransitionCallbackReturn.SUCCESS).goal is State.INACTIVE


def test_the_table_has_25_rows_and_available_ones_leave_the_state() -> None:
    assert len(LIFECYCLE_TRANSITIONS) == 7 + 18 and len({row.id for row in LIFECYCLE_TRANSITIONS}) == 25
    assert [row.id for row in available_transitions(State.INACTIVE)] == [2, 3, 6]
    assert available_transitions(State.FINALIZED) == ()


@pytest.mark.parametrize(
    ("answer", "outcome"),
    [
        (None, TransitionCallbackReturn.SUCCESS),
        (True, TransitionCallbackReturn.SUCCESS),
        (np.bool_(True), TransitionCallbackReturn.SUCCESS),
        (1, TransitionCallbackReturn.SUCCESS),
        (TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.SUCCESS),
        (False, TransitionCallbackReturn.FAILURE),
        (np.bool_(False), TransitionCallbackReturn.FAILURE),
        (0, TransitionCallbackReturn.FAILURE),
        ("", TransitionCallbackReturn.FAILURE),
        ([], TransitionCallbackReturn.FAILURE),
        (TransitionCallbackReturn.FAILURE, TransitionCallbackReturn.FAILURE),
        (TransitionCallbackReturn.ERROR, TransitionCallbackReturn.ERROR),
        # lifecycle_msgs/Transition TRANSITION_CALLBACK_SUCCESS, _FAILURE, _ERROR
        (97, TransitionCallbackReturn.SUCCESS),
        (98, TransitionCallbackReturn.FAILURE),
        (99, TransitionCallbackReturn.ERROR),
    ],
)
def test_what_the_answer_of_a_callback_means(answer: object, outcome: TransitionCallbackReturn) -> None:
    assert to_callback_return(answer) is outcome
