"""States of lifecycle nodes, and the table of transitions.

Source: docs/internals/protocol.md 12.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from rosidl_py_gen.errors import RosidlError


class State(IntEnum):
    """Numbers of lifecycle_msgs/State: 1 to 4 are primary states, 10 to 15 transition states."""

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
        """Name in messages."""
        return self.name.lower()


class TransitionCallbackReturn(Enum):
    """Result of a transition callback; the values are labels of transitions."""

    SUCCESS = "transition_success"
    FAILURE = "transition_failure"
    ERROR = "transition_error"


@dataclass(frozen=True, slots=True)
class Transition:
    """Row of `LIFECYCLE_TRANSITIONS`.

    Attributes:
        id: as in lifecycle_msgs/Transition; numbers below 10 can be requested, the others result from callbacks.
        label: such as ``configure`` or ``transition_success``.
        start: state before the transition.
        goal: state after it.
    """

    id: int
    label: str
    start: State
    goal: State


class TransitionError(RosidlError):
    """Raised for a transition that is not possible in the current state."""


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
"""All transitions of a lifecycle node in rcl_lifecycle's order: those to a transition state, then those from it."""
_OUTCOMES = frozenset(outcome.value for outcome in TransitionCallbackReturn)
_CALLBACK_RETURNS = {
    97: TransitionCallbackReturn.SUCCESS,
    98: TransitionCallbackReturn.FAILURE,
    99: TransitionCallbackReturn.ERROR,
}
"""Numbers TRANSITION_CALLBACK_... of lifecycle_msgs/Transition, which rclpy's callbacks return."""


def to_callback_return(value: object) -> TransitionCallbackReturn:
    """Convert the value that a callback returned: None and other true values are a success."""
    if isinstance(value, TransitionCallbackReturn):
        return value
    if isinstance(value, int) and int(value) in _CALLBACK_RETURNS:
        return _CALLBACK_RETURNS[int(value)]
    return TransitionCallbackReturn.SUCCESS if value is None or value else TransitionCallbackReturn.FAILURE


def available_transitions(state: State) -> tuple[Transition, ...]:
    """Return the transitions that start in `state`; those with an id below 10 can be requested."""
    return tuple(row for row in LIFECYCLE_TRANSITIONS if row.start is state)


def requested_transition(state: State, transition_id: int = 0, label: str = "") -> Transition | None:
    """Return the transition of a ChangeState request, or None; a label takes precedence over the id.

    The ``transition_...`` rows cannot be requested.
    """
    for row in available_transitions(state):
        if row.label not in _OUTCOMES and (row.label == label if label else row.id == transition_id):
            return row
    return None


def finished_transition(state: State, outcome: TransitionCallbackReturn) -> Transition:
    """Return the transition that follows a callback of the transition state `state` with the result `outcome`.

    Raises:
        TransitionError: no callback runs in that state.
        TypeError: an argument is not a `State` or not a `TransitionCallbackReturn`.
    """
    if not isinstance(state, State) or not isinstance(outcome, TransitionCallbackReturn):
        raise TypeError(f"expected a State and a TransitionCallbackReturn, got {state!r:.100} and {outcome!r:.100}")
    for row in available_transitions(state):
        if row.label == outcome.value:
            return row
    raise TransitionError(f"{outcome.value} is not possible in state {state.label}")
