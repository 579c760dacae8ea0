"""Lifecycle nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable, Dict, NamedTuple, Optional, Set  # noqa: F401, UP035

import lifecycle_msgs.msg
import lifecycle_msgs.srv

from rclpy._rclpy_pybind11 import RCLError, TransitionCallbackReturnType
from rclpy.callback_groups import CallbackGroup as CallbackGroup
from rclpy.impl.lifecycle_machine import Described, LifecycleStateMachine
from rclpy.lifecycle.managed_entity import ManagedEntity
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.node import Node
from rclpy.qos import QoSProfile as QoSProfile
from rclpy.service import Service as Service
from rclpy.type_support import check_is_valid_srv_type as check_is_valid_srv_type

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen import runtime

TransitionCallbackReturn = TransitionCallbackReturnType
_ids = lifecycle_msgs.msg.Transition
_CALLBACKS = {
    "configuring": "on_configure",
    "cleaningup": "on_cleanup",
    "shuttingdown": "on_shutdown",
    "activating": "on_activate",
    "deactivating": "on_deactivate",
    "errorprocessing": "on_error",
}
"""State that is passed through -> method that runs in it."""


class LifecycleState(NamedTuple):
    """A state, as callbacks are given the one before."""

    label: str
    state_id: int


class LifecycleNodeMixin(ManagedEntity):
    """What makes a lifecycle node of a `Node` that a class derives from, too.

    Args:
        enable_communication_interface: serve the five services by which others see and change the state.
        callback_group: of these; None means that of the node.
    """

    def __init__(
        self, *, enable_communication_interface: bool = True, callback_group: CallbackGroup | None = None
    ) -> None:
        node = self._rosidl_as_node()
        # Programs know some attributes of rclpy, and use their names for their own things, too: ours are beside them.
        self._rosidl_callbacks = {state: getattr(self, method) for state, method in _CALLBACKS.items()}
        self._rosidl_entities: set[ManagedEntity] = set()
        self._rosidl_machine = LifecycleStateMachine(self._rosidl_tell)
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
                made = node.create_service(srv_type, f"~/{name}", callback, callback_group=callback_group)
                setattr(self, f"_service_{name}", made)

    def _rosidl_as_node(self) -> Node:
        assert isinstance(self, Node)
        return self

    def _rosidl_tell(self, transition: runtime.Transition) -> None:
        message = lifecycle_msgs.msg.TransitionEvent()
        message.start_state.id, message.start_state.label = int(transition.start), transition.start.label
        message.goal_state.id, message.goal_state.label = int(transition.goal), transition.goal.label
        self._rosidl_transition_events.publish(message)

    # ------------------------------------------------------------------------------------------------- transitions

    def trigger_configure(self) -> TransitionCallbackReturn:
        """From unconfigured to inactive, as `on_configure` decides; RCLError in other states, as all of these."""
        return self._rosidl_change_state(_ids.TRANSITION_CONFIGURE)

    def trigger_cleanup(self) -> TransitionCallbackReturn:
        """From inactive to unconfigured."""
        return self._rosidl_change_state(_ids.TRANSITION_CLEANUP)

    def trigger_shutdown(self) -> TransitionCallbackReturn:
        """To finalized, from unconfigured, inactive or active."""
        known = {
            "unconfigured": _ids.TRANSITION_UNCONFIGURED_SHUTDOWN,
            "inactive": _ids.TRANSITION_INACTIVE_SHUTDOWN,
            "active": _ids.TRANSITION_ACTIVE_SHUTDOWN,
        }
        transition_id = known.get(self._rosidl_machine.current_state[1])
        if transition_id is None:
            raise RCLError("Shutdown transtion not possible")
        return self._rosidl_change_state(transition_id)

    def trigger_activate(self) -> TransitionCallbackReturn:
        """From inactive to active."""
        return self._rosidl_change_state(_ids.TRANSITION_ACTIVATE)

    def trigger_deactivate(self) -> TransitionCallbackReturn:
        """From active to inactive."""
        return self._rosidl_change_state(_ids.TRANSITION_DEACTIVATE)

    def _rosidl_change_state(self, transition_id: int) -> TransitionCallbackReturn:
        machine = self._rosidl_machine
        state_id, label = machine.current_state
        before = LifecycleState(label, state_id)
        machine.trigger_transition_by_id(transition_id)
        found = self._rosidl_run_callback(before)
        machine.trigger_transition_by_label(found.to_label())
        if found == TransitionCallbackReturn.ERROR:
            machine.trigger_transition_by_label(self._rosidl_run_callback(before).to_label())
        return found

    def _rosidl_run_callback(self, before: LifecycleState) -> TransitionCallbackReturn:
        name = self._rosidl_machine.current_state[1]
        try:
            found: TransitionCallbackReturn = self._rosidl_callbacks[name](before)
        except Exception as error:  # rclpy says nothing of it
            self._rosidl_as_node().get_logger().error(f"{_CALLBACKS[name]} raised {type(error).__name__}: {error}")
            return TransitionCallbackReturn.ERROR
        return found

    # --------------------------------------------------------------------------------------------------- callbacks

    def _rosidl_ask_entities(self, callback: str, state: LifecycleState) -> TransitionCallbackReturn:
        for entity in self._rosidl_entities:
            found = getattr(entity, callback)(state)
            if not isinstance(found, TransitionCallbackReturn):
                raise TypeError(
                    f"{callback}() return value of class {type(entity)} should be `TransitionCallbackReturn`.\n"
                    f"Instance of the class that caused the failure: {entity}"
                )
            if found != TransitionCallbackReturn.SUCCESS:
                return found
        return TransitionCallbackReturn.SUCCESS

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Ask the managed entities, up to the first that does not succeed; overridden ones call it, as the others."""
        return self._rosidl_ask_entities("on_configure", state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._rosidl_ask_entities("on_cleanup", state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._rosidl_ask_entities("on_shutdown", state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._rosidl_ask_entities("on_activate", state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._rosidl_ask_entities("on_deactivate", state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._rosidl_ask_entities("on_error", state)

    # ---------------------------------------------------------------------------------------------------- entities

    def add_managed_entity(self, entity: ManagedEntity) -> None:
        """Have it go through the transitions; TypeError for what is none."""
        if not isinstance(entity, ManagedEntity):
            raise TypeError("Expected a rclpy.lifecycle.ManagedEntity instance.")
        self._rosidl_entities.add(entity)

    def create_lifecycle_publisher(self, *args: Any, **kwargs: Any) -> LifecyclePublisher:
        """As `Node.create_publisher`; it publishes while the node is active."""
        if "publisher_class" in kwargs:
            raise TypeError("create_publisher() got an unexpected keyword argument 'publisher_class'")
        made = self._rosidl_as_node().create_publisher(*args, **kwargs, publisher_class=LifecyclePublisher)
        assert isinstance(made, LifecyclePublisher)
        self._rosidl_entities.add(made)
        return made

    def destroy_lifecycle_publisher(self, publisher: LifecyclePublisher) -> bool:
        """As `Node.destroy_publisher`."""
        self._rosidl_entities.discard(publisher)
        return self._rosidl_as_node().destroy_publisher(publisher)

    # ---------------------------------------------------------------------------------------------------- services

    def _rosidl_on_change_state(self, request: Any, response: Any) -> Any:
        """A transition that is not possible is refused; in rclpy one given by its id ends the spinning."""
        try:
            label = request.transition.label
            wanted = self._rosidl_machine.get_transition_by_label(label) if label else request.transition.id
            response.success = self._rosidl_change_state(wanted) == TransitionCallbackReturn.SUCCESS
        except RCLError:
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
        response.available_transitions = _messages(self._rosidl_machine.available_transitions)
        return response

    def _rosidl_on_get_transition_graph(self, request: Any, response: Any) -> Any:
        response.available_transitions = _messages(self._rosidl_machine.transition_graph)
        return response


def _messages(transitions: Iterable[Described]) -> list[Any]:
    found = []
    for one in transitions:
        message = lifecycle_msgs.msg.TransitionDescription()
        message.transition.id, message.transition.label = one[:2]
        message.start_state.id, message.start_state.label = one[2:4]
        message.goal_state.id, message.goal_state.label = one[4:]
        found.append(message)
    return found


class LifecycleNode(LifecycleNodeMixin, Node):
    """A node that is configured and activated before it works; see `LifecycleNodeMixin` and `rclpy.node.Node`."""

    def __init__(self, node_name: str, *, enable_communication_interface: bool = True, **kwargs: Any) -> None:
        Node.__init__(self, node_name, **kwargs)
        LifecycleNodeMixin.__init__(self, enable_communication_interface=enable_communication_interface)
