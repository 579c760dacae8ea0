"""State machine of a lifecycle node, with the transitions of `rosidl_py_gen.runtime`."""

from __future__ import annotations

from collections.abc import Callable

from rclpy._rclpy_pybind11 import RCLError
from rclpy.logging import get_logger
from rosidl_py_gen import runtime

TransitionTuple = tuple[int, str, int, str, int, str]
"""Id and label of a transition, of its start state and of its goal state."""


class LifecycleStateMachine:
    """State of a lifecycle node, which passes each transition to `on_transition`."""

    initialized = True

    def __init__(self, on_transition: Callable[[runtime.Transition], object]) -> None:
        self._state: runtime.State = runtime.State.UNCONFIGURED
        self._on_transition = on_transition

    @property
    def current_state(self) -> tuple[int, str]:
        """Id and label of the state."""
        return int(self._state), self._state.label

    @property
    def available_states(self) -> list[tuple[int, str]]:
        """Ids and labels of all states."""
        return [(int(state), state.label) for state in runtime.State]

    @property
    def available_transitions(self) -> list[TransitionTuple]:
        """Transitions that start in the current state."""
        return [_as_tuple(transition) for transition in runtime.available_transitions(self._state)]

    @property
    def transition_graph(self) -> list[TransitionTuple]:
        """All transitions."""
        return [_as_tuple(transition) for transition in runtime.LIFECYCLE_TRANSITIONS]

    def get_transition_by_label(self, label: str) -> int:
        """Return the id of a transition from the current state; raise RCLError if there is none."""
        return self._find_transition(label, "label").id

    def trigger_transition_by_id(self, transition_id: int) -> None:
        """Change the state; raise RCLError if the transition does not start in the current one."""
        self._apply(self._find_transition(transition_id, "id"))

    def trigger_transition_by_label(self, label: str) -> None:
        """Change the state; raise RCLError if the transition does not start in the current one."""
        self._apply(self._find_transition(label, "label"))

    def _find_transition(self, key: str | int, attribute: str) -> runtime.Transition:
        for transition in runtime.available_transitions(self._state):
            if getattr(transition, attribute) == key:
                return transition
        get_logger("rcl_lifecycle").warning(f"No transition matching {key} found for current state {self._state.label}")
        raise RCLError(f"Failed to trigger lifecycle transition: {key} is not possible in {self._state.label}")

    def _apply(self, transition: runtime.Transition) -> None:
        self._state = transition.goal
        self._on_transition(transition)


def _as_tuple(transition: runtime.Transition) -> TransitionTuple:
    start, goal = transition.start, transition.goal
    return transition.id, transition.label, int(start), start.label, int(goal), goal.label
