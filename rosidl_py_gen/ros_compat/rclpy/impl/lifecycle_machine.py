"""The state of a lifecycle node, over the table of `rosidl_py_gen.runtime`."""

from __future__ import annotations

from collections.abc import Callable

from rclpy._rclpy_pybind11 import RCLError
from rclpy.logging import get_logger
from rosidl_py_gen import runtime

Described = tuple[int, str, int, str, int, str]
"""Id and label of a transition, of the state it leaves, and of that it leads to."""


class LifecycleStateMachine:
    """Goes from state to state, and tells `told` of each transition."""

    initialized = True

    def __init__(self, told: Callable[[runtime.Transition], object]) -> None:
        self._state: runtime.State = runtime.State.UNCONFIGURED
        self._told = told

    @property
    def current_state(self) -> tuple[int, str]:
        """Id and label."""
        return int(self._state), self._state.label

    @property
    def available_states(self) -> list[tuple[int, str]]:
        """All there are, with id and label."""
        return [(int(state), state.label) for state in runtime.State]

    @property
    def available_transitions(self) -> list[Described]:
        """Those that leave the present state."""
        return [_described(row) for row in runtime.available_transitions(self._state)]

    @property
    def transition_graph(self) -> list[Described]:
        """All there are."""
        return [_described(row) for row in runtime.LIFECYCLE_TRANSITIONS]

    def get_transition_by_label(self, label: str) -> int:
        """The id of that which leaves the present state; RCLError when there is none."""
        return self._only(label, [row for row in runtime.available_transitions(self._state) if row.label == label]).id

    def trigger_transition_by_id(self, transition_id: int) -> None:
        """RCLError when it does not leave the present state; so the next."""
        found = [row for row in runtime.available_transitions(self._state) if row.id == transition_id]
        self._go(self._only(str(transition_id), found))

    def trigger_transition_by_label(self, label: str) -> None:
        """As `transition_success`."""
        self._go(self._only(label, [row for row in runtime.available_transitions(self._state) if row.label == label]))

    def _only(self, name: str, found: list[runtime.Transition]) -> runtime.Transition:
        if not found:
            get_logger("rcl_lifecycle").warning(
                f"No transition matching {name} found for current state {self._state.label}"
            )
            raise RCLError(f"Failed to trigger lifecycle transition: {name} is not possible in {self._state.label}")
        return found[0]

    def _go(self, transition: runtime.Transition) -> None:
        self._state = transition.goal
        self._told(transition)


def _described(row: runtime.Transition) -> Described:
    return row.id, row.label, int(row.start), row.start.label, int(row.goal), row.goal.label
