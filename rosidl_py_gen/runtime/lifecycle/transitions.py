"""The states of lifecycle nodes and the transitions between them, as a table.

Decides which transition a request means and which state follows (docs/internals/protocol.md 12.2). Running callbacks
and serving the five services is `machine.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from rosidl_py_gen.errors import RosidlError


class State(IntEnum):
    """Numbers of lifecycle_msgs/State; 1 to 4 are primary, 10 to 15 are passed through."""

    UNKNOWN = 0
    UNCONFIGURED = 1
    INACTIVE = 2
    ACTIVE = 3
    FINALIZED = 4
    CONFIGURING = 10
    CLEANINGUP = 11
    SHUTTINGDOWN = 12
    ACTIVATING = 13
    DEACTIVATING = 14
    ERRORPROCESSING = 15

    @property
    def label(self) -> str:
        """The name on the wire."""
        return self.name.lower()


class TransitionCallbackReturn(Enum):
    """What a callback says about its transition; the values are the transition labels."""

    SUCCESS = "transition_success"
    FAILURE = "transition_failure"
    ERROR = "transition_error"


@dataclass(frozen=True, slots=True)
class Transition:
    """One row of `LIFECYCLE_TRANSITIONS`.

    Attributes:
        id: as in lifecycle_msgs/Transition; below 10 it can be requested, the others are what callbacks answer.
        label: ``configure``, or ``transition_success`` and its like.
        start: the state it leaves.
        goal: the state it leads to.
    """

    id: int
    label: str
    start: State
    goal: State


class TransitionError(RosidlError):
    """The caller asked for a transition that does not leave the present state."""


def _rows() -> tuple[Transition, ...]:
    requests = [
        (1, "configure", State.UNCONFIGURED, State.CONFIGURING),
        (2, "cleanup", State.INACTIVE, State.CLEANINGUP),
        (3, "activate", State.INACTIVE, State.ACTIVATING),
        (4, "deactivate", State.ACTIVE, State.DEACTIVATING),
        (5, "shutdown", State.UNCONFIGURED, State.SHUTTINGDOWN),
        (6, "shutdown", State.INACTIVE, State.SHUTTINGDOWN),
        (7, "shutdown", State.ACTIVE, State.SHUTTINGDOWN),
    ]
    ends = [
        (10, State.CONFIGURING, State.INACTIVE, State.UNCONFIGURED, State.ERRORPROCESSING),
        (20, State.CLEANINGUP, State.UNCONFIGURED, State.INACTIVE, State.ERRORPROCESSING),
        (30, State.ACTIVATING, State.ACTIVE, State.INACTIVE, State.ERRORPROCESSING),
        (40, State.DEACTIVATING, State.INACTIVE, State.ACTIVE, State.ERRORPROCESSING),
        (50, State.SHUTTINGDOWN, State.FINALIZED, State.FINALIZED, State.ERRORPROCESSING),
        (60, State.ERRORPROCESSING, State.UNCONFIGURED, State.FINALIZED, State.FINALIZED),
    ]
    rows: list[Transition] = []
    for first_id, start, *goals in ends:
        rows += [Transition(*request) for request in requests if request[-1] is start]
        for offset, (outcome, goal) in enumerate(zip(TransitionCallbackReturn, goals, strict=True)):
            rows.append(Transition(first_id + offset, outcome.value, start, goal))
    return tuple(rows)


LIFECYCLE_TRANSITIONS: tuple[Transition, ...] = _rows()
"""All transitions of a lifecycle node, in rcl_lifecycle's order: what leads to a passing state, then what leaves it;
source: docs/internals/protocol.md 12.2."""
_OUTCOMES = frozenset(outcome.value for outcome in TransitionCallbackReturn)
_CALLBACK_RETURNS = {
    97: TransitionCallbackReturn.SUCCESS,
    98: TransitionCallbackReturn.FAILURE,
    99: TransitionCallbackReturn.ERROR,
}
"""TRANSITION_CALLBACK_... of lifecycle_msgs/Transition, which are what rclpy's callbacks return."""


def outcome_of(answer: object) -> TransitionCallbackReturn:
    """What the answer of a callback means: None is a success, and so is what Python takes for true."""
    if isinstance(answer, TransitionCallbackReturn):
        return answer
    if isinstance(answer, int) and int(answer) in _CALLBACK_RETURNS:
        return _CALLBACK_RETURNS[int(answer)]
    return TransitionCallbackReturn.SUCCESS if answer is None or answer else TransitionCallbackReturn.FAILURE


def available_transitions(state: State) -> tuple[Transition, ...]:
    """The transitions that leave `state`; those with an id below 10 can be requested."""
    return tuple(row for row in LIFECYCLE_TRANSITIONS if row.start is state)


def requested_transition(state: State, transition_id: int = 0, label: str = "") -> Transition | None:
    """The transition a ChangeState request means; a label that is not empty takes precedence over the id.

    None when no such transition leaves `state`. The ``transition_...`` rows cannot be requested, only callbacks cause
    them.
    """
    for row in available_transitions(state):
        if row.label not in _OUTCOMES and (row.label == label if label else row.id == transition_id):
            return row
    return None


def finished_transition(state: State, outcome: TransitionCallbackReturn) -> Transition:
    """The transition that follows when the callback of a passing `state` ends with `outcome`.

    Raises:
        TransitionError: no callback runs in that state. TypeError: they are no state and no outcome.
    """
    if not isinstance(state, State) or not isinstance(outcome, TransitionCallbackReturn):
        raise TypeError(f"expected a State and an Outcome, got {state!r:.100} and {outcome!r:.100}")
    for row in available_transitions(state):
        if row.label == outcome.value:
            return row
    raise TransitionError(f"{outcome.value} is not possible in state {state.label}")
