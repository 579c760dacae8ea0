"""Lifecycle nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable, Dict, NamedTuple, Optional, Set

import lifecycle_msgs.msg
import lifecycle_msgs.srv

from rclpy._rclpy_pybind11 import RCLError, TransitionCallbackReturnType
from rclpy.callback_groups import CallbackGroup
from rclpy.lifecycle.managed_entity import ManagedEntity
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.type_support import check_is_valid_srv_type
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Iterable

TransitionCallbackReturn = TransitionCallbackReturnType
_Transition = lifecycle_msgs.msg.Transition
_CALLBACKS = {
    "configuring": "on_configure",
    "cleaningup": "on_cleanup",
    "shuttingdown": "on_shutdown",
    "activating": "on_activate",
    "deactivating": "on_deactivate",
    "errorprocessing": "on_error",
}
"""Names of the node's methods by the transition state in which they run."""
_TransitionTuple = tuple[int, str, int, str, int, str]
"""Transition as a tuple: id and label of the transition, of its start state and of its goal state."""


class LifecycleStateMachine:
    """State machine of a lifecycle node, which calls `on_transition` with each transition."""

    initialized = True

    def __init__(self, on_transition: Callable[[runtime.Transition], object]) -> None:
        self._state: runtime.State = runtime.State.UNCONFIGURED
        self._on_transition = on_transition

    @property
    def current_state(self) -> tuple[int, str]:
        """Id and label of the current state."""
        return int(self._state), self._state.label

    @property
    def available_states(self) -> list[tuple[int, str]]:
        return [(int(state), state.label) for state in runtime.State]

    @property
    def available_transitions(self) -> list[_TransitionTuple]:
        """Transitions that start in the current state."""
        return [_as_tuple(transition) for transition in runtime.available_transitions(self._state)]

    @property
    def transition_graph(self) -> list[_TransitionTuple]:
        return [_as_tuple(transition) for transition in runtime.LIFECYCLE_TRANSITIONS]

    def get_transition_by_label(self, label: str) -> int:
        """Return the id of the transition from the current state with a label; raise RCLError if there is none."""
        return self._find_transition(label, "label").id

    def trigger_transition_by_id(self, transition_id: int) -> None:
        """Change the state by the transition with an id; raise RCLError if it does not start in the current state."""
        self._apply(self._find_transition(transition_id, "id"))

    def trigger_transition_by_label(self, label: str) -> None:
        """Change the state by the transition with a label; raise RCLError if it does not start in the current state."""
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


def _as_tuple(transition: runtime.Transition) -> _TransitionTuple:
    start, goal = transition.start, transition.goal
    return transition.id, transition.label, int(start), start.label, int(goal), goal.label


class LifecycleState(NamedTuple):
    """State of a lifecycle node; callbacks get the previous state."""

    label: str
    state_id: int


class LifecycleNodeMixin(ManagedEntity):
    """Base class that makes a `Node` a lifecycle node.

    Args:
        enable_communication_interface: serve the five services that read and change the state.
        callback_group: group of the five services. [default: the node's default group]
    """

    def __init__(
        self, *, enable_communication_interface: bool = True, callback_group: CallbackGroup | None = None
    ) -> None:
        node = self._rosidl_as_node()
        # Some programs read private attributes of rclpy, others replace them: the code here uses `_rosidl_…` only.
        self._rosidl_callbacks = {state: getattr(self, method) for state, method in _CALLBACKS.items()}
        self._rosidl_entities: set[ManagedEntity] = set()
        self._rosidl_machine = LifecycleStateMachine(self._rosidl_publish_transition)
        self._callbacks, self._managed_entities = self._rosidl_callbacks, self._rosidl_entities
        self._state_machine = self._rosidl_machine
        self._rosidl_transition_events = node.create_publisher(
            lifecycle_msgs.msg.TransitionEvent, "~/transition_event", 10
        )
        srv = lifecycle_msgs.srv
        for srv_type, name, callback in (
            (srv.ChangeState, "change_state", self._rosidl_on_change_state),
            (srv.GetState, "get_state", self._rosidl_on_get_state),
            (srv.GetAvailableStates, "get_available_states", self._rosidl_on_get_available_states),
            (srv.GetAvailableTransitions, "get_available_transitions", self._rosidl_on_get_available_transitions),
            (srv.GetAvailableTransitions, "get_transition_graph", self._rosidl_on_get_transition_graph),
        ):
            if enable_communication_interface:
                service = node.create_service(srv_type, f"~/{name}", callback, callback_group=callback_group)
                setattr(self, f"_service_{name}", service)

    def _rosidl_as_node(self) -> Node:
        assert isinstance(self, Node)
        return self

    def _rosidl_publish_transition(self, transition: runtime.Transition) -> None:
        message = lifecycle_msgs.msg.TransitionEvent()
        message.start_state.id, message.start_state.label = int(transition.start), transition.start.label
        message.goal_state.id, message.goal_state.label = int(transition.goal), transition.goal.label
        if hasattr(message, "stamp"):  # since Lyrical; earlier distributions leave both empty
            message.stamp = self._rosidl_as_node().get_clock().now().to_msg()
            message.transition.id, message.transition.label = transition.id, transition.label
        self._rosidl_transition_events.publish(message)

    def trigger_configure(self) -> TransitionCallbackReturn:
        """Change from unconfigured to inactive, if `on_configure` returns SUCCESS; raise RCLError in other states."""
        return self._rosidl_change_state(_Transition.TRANSITION_CONFIGURE)

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """Change from inactive to unconfigured, if `on_cleanup` returns SUCCESS; raise RCLError in other states."""
        return self._rosidl_change_state(_Transition.TRANSITION_CLEANUP)

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """Change from unconfigured, inactive or active to finalized; raise RCLError in other states."""
        name = f"TRANSITION_{self._rosidl_machine.current_state[1].upper()}_SHUTDOWN"
        if not hasattr(_Transition, name):
            raise RCLError("Shutdown transtion not possible")  # spelled as in rclpy
        return self._rosidl_change_state(getattr(_Transition, name))

    def trigger_activate(self) -> TransitionCallbackReturn:
        """Change from inactive to active, if `on_activate` returns SUCCESS; raise RCLError in other states."""
        return self._rosidl_change_state(_Transition.TRANSITION_ACTIVATE)

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """Change from active to inactive, if `on_deactivate` returns SUCCESS; raise RCLError in other states."""
        return self._rosidl_change_state(_Transition.TRANSITION_DEACTIVATE)

    def _rosidl_change_state(self, transition_id: int) -> TransitionCallbackReturn:
        machine = self._rosidl_machine
        state_id, label = machine.current_state
        previous_state = LifecycleState(label, state_id)
        machine.trigger_transition_by_id(transition_id)
        result = self._rosidl_run_callback(previous_state)
        machine.trigger_transition_by_label(result.to_label())
        if result == TransitionCallbackReturn.ERROR:
            machine.trigger_transition_by_label(self._rosidl_run_callback(previous_state).to_label())
        return result

    def _rosidl_run_callback(self, previous_state: LifecycleState) -> TransitionCallbackReturn:
        name = self._rosidl_machine.current_state[1]
        try:
            result: TransitionCallbackReturn = self._rosidl_callbacks[name](previous_state)
        except Exception as error:  # rclpy does not log it
            self._rosidl_as_node().get_logger().error(f"{_CALLBACKS[name]} raised {type(error).__name__}: {error}")
            return TransitionCallbackReturn.ERROR
        return result

    def _rosidl_call_entities(self, callback: str, state: LifecycleState) -> TransitionCallbackReturn:
        for entity in self._rosidl_entities:
            result = getattr(entity, callback)(state)
            if not isinstance(result, TransitionCallbackReturn):
                raise TypeError(
                    f"{callback}() return value of class {type(entity)} should be `TransitionCallbackReturn`.\n"
                    f"Instance of the class that caused the failure: {entity}"
                )
            if result != TransitionCallbackReturn.SUCCESS:
                return result
        return TransitionCallbackReturn.SUCCESS

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Call `on_configure` of the managed entities, up to the first that does not succeed, and return its result.

        Overrides of this and the other ``on_...`` methods should call the base method.
        """
        return self._rosidl_call_entities("on_configure", state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._rosidl_call_entities("on_cleanup", state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._rosidl_call_entities("on_shutdown", state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._rosidl_call_entities("on_activate", state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._rosidl_call_entities("on_deactivate", state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._rosidl_call_entities("on_error", state)

    def add_managed_entity(self, entity: ManagedEntity) -> None:
        """Make an entity follow the transitions of the node; raise TypeError unless it is a ManagedEntity."""
        if not isinstance(entity, ManagedEntity):
            raise TypeError("Expected a rclpy.lifecycle.ManagedEntity instance.")
        self._rosidl_entities.add(entity)

    def create_lifecycle_publisher(self, *args: Any, **kwargs: Any) -> LifecyclePublisher:
        """Create a publisher that sends only while the node is active; arguments as for `Node.create_publisher`."""
        if "publisher_class" in kwargs:
            raise TypeError("create_publisher() got an unexpected keyword argument 'publisher_class'")
        publisher = self._rosidl_as_node().create_publisher(*args, **kwargs, publisher_class=LifecyclePublisher)
        assert isinstance(publisher, LifecyclePublisher)
        self._rosidl_entities.add(publisher)
        return publisher

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher) -> bool:
        """Destroy a publisher of `create_lifecycle_publisher`; return False if it does not belong to this node."""
        self._rosidl_entities.discard(publisher)
        return self._rosidl_as_node().destroy_publisher(publisher)

    def _rosidl_on_change_state(self, request: Any, response: Any) -> Any:
        try:
            label = request.transition.label
            transition_id = self._rosidl_machine.get_transition_by_label(label) if label else request.transition.id
            response.success = self._rosidl_change_state(transition_id) == TransitionCallbackReturn.SUCCESS
        except RCLError:  # the transition is not possible; in rclpy an unknown id ends the spinning
            response.success = False
        return response

    def _rosidl_on_get_state(self, request: Any, response: Any) -> Any:
        response.current_state.id, response.current_state.label = self._rosidl_machine.current_state
        return response

    def _rosidl_on_get_available_states(self, request: Any, response: Any) -> Any:
        states = self._rosidl_machine.available_states
        response.available_states = [lifecycle_msgs.msg.State(id=number, label=label) for number, label in states]
        return response

    def _rosidl_on_get_available_transitions(self, request: Any, response: Any) -> Any:
        response.available_transitions = _transition_messages(self._rosidl_machine.available_transitions)
        return response

    def _rosidl_on_get_transition_graph(self, request: Any, response: Any) -> Any:
        response.available_transitions = _transition_messages(self._rosidl_machine.transition_graph)
        return response


def _transition_messages(transitions: Iterable[_TransitionTuple]) -> list[Any]:
    messages = []
    for transition in transitions:
        message = lifecycle_msgs.msg.TransitionDescription()
        message.transition.id, message.transition.label = transition[:2]
        message.start_state.id, message.start_state.label = transition[2:4]
        message.goal_state.id, message.goal_state.label = transition[4:]
        messages.append(message)
    return messages


class LifecycleNode(LifecycleNodeMixin, Node):
    """Node that is configured and activated before it works; see `LifecycleNodeMixin` and `rclpy.node.Node`."""

    def __init__(self, node_name: str, *, enable_communication_interface: bool = True, **kwargs: Any) -> None:
        Node.__init__(self, node_name, **kwargs)
        LifecycleNodeMixin.__init__(self, enable_communication_interface=enable_communication_interface)
