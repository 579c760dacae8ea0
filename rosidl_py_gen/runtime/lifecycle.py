"""Lifecycle nodes, and their state machine: transitions, callbacks, services, transition events, and publishers.

Peers change the state with the services. During a transition, requests for another transition are refused. A transition
that is cancelled is completed as an error, including error processing, so that the node is never left in a transition
state.
Source: docs/internals/protocol.md 12.2.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, Any, TypeVar, overload

from rosidl_py_gen.base.callbacks import require_signature
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.waiters import blocking
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.errors import RosidlError, printable
from rosidl_py_gen.msgs.lifecycle_msgs import msg, srv
from rosidl_py_gen.runtime.entities.message_types import MessageType, message_type, service_type
from rosidl_py_gen.runtime.entities.services import ServiceServer
from rosidl_py_gen.runtime.entities.topics import Publisher
from rosidl_py_gen.runtime.loop.callbacks import UserCallback
from rosidl_py_gen.runtime.node.node import Node
from rosidl_py_gen.runtime.transport.qos import DEFAULT, SERVICES_DEFAULT, as_profile

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rosidl_py_gen.runtime.clocks import Clock
    from rosidl_py_gen.runtime.entities.endpoint_events import PublisherEventCallbacks
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import DictMessage
    from rosidl_py_gen.runtime.names import NodeNames
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile

_MAX_LABEL_CHARS = 100
"""Maximum length of the requested label that an error quotes; the labels of transitions are shorter."""


class State(IntEnum):
    """State of a lifecycle node, numbered as in lifecycle_msgs/State: 1 to 4 primary, 10 to 15 transition states."""

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
        """Name of the state in messages, such as ``unconfigured``."""
        return self.name.lower()


class TransitionCallbackReturn(Enum):
    """Result of a transition callback (``on_configure`` and so on); the values are labels of transitions."""

    SUCCESS = "transition_success"
    FAILURE = "transition_failure"
    ERROR = "transition_error"


@dataclass(frozen=True, slots=True)
class Transition:
    """Transition of a lifecycle node from one state to another.

    Attributes:
        id: number as in lifecycle_msgs/Transition; numbers below 10 can be requested, the others result from callbacks.
        label: name such as ``configure`` or ``transition_success``.
        start: state before the transition.
        goal: state after the transition.
    """

    id: int
    label: str
    start: State
    goal: State


class TransitionError(RosidlError):
    """Raised for a transition that is not possible in the current state of a lifecycle node."""


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
"""All transitions of a lifecycle node in rcl_lifecycle's order.

The transitions that lead to a transition state precede the transitions that start in it.
"""
_OUTCOMES = frozenset(outcome.value for outcome in TransitionCallbackReturn)
_CALLBACK_RETURNS = {
    97: TransitionCallbackReturn.SUCCESS,
    98: TransitionCallbackReturn.FAILURE,
    99: TransitionCallbackReturn.ERROR,
}
"""Results of transition callbacks by number TRANSITION_CALLBACK_... of lifecycle_msgs/Transition, which rclpy's
callbacks return."""


def to_callback_return(value: object) -> TransitionCallbackReturn:
    """Convert the return value of a transition callback: None and true values are SUCCESS, false values FAILURE.

    Numbers TRANSITION_CALLBACK_... of lifecycle_msgs/Transition are the results that they name.
    """
    if isinstance(value, TransitionCallbackReturn):
        return value
    if isinstance(value, int) and int(value) in _CALLBACK_RETURNS:
        return _CALLBACK_RETURNS[int(value)]
    return TransitionCallbackReturn.SUCCESS if value is None or value else TransitionCallbackReturn.FAILURE


def available_transitions(state: State) -> tuple[Transition, ...]:
    """Return the transitions that start in a state; the transitions with an id below 10 can be requested."""
    return tuple(row for row in LIFECYCLE_TRANSITIONS if row.start is state)


def requested_transition(state: State, transition_id: int = 0, label: str = "") -> Transition | None:
    """Return the transition that a ChangeState request selects by label, or else by id; None if it is not possible.

    Transitions whose label starts with ``transition_`` cannot be requested.
    """
    for row in available_transitions(state):
        if row.label not in _OUTCOMES and (row.label == label if label else row.id == transition_id):
            return row
    return None


def finished_transition(state: State, outcome: TransitionCallbackReturn) -> Transition:
    """Return the transition that follows when the callback of a transition state has returned `outcome`.

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


T = TypeVar("T")

_CALLBACKS = {
    State.CONFIGURING: "on_configure",
    State.CLEANINGUP: "on_cleanup",
    State.ACTIVATING: "on_activate",
    State.DEACTIVATING: "on_deactivate",
    State.SHUTTINGDOWN: "on_shutdown",
    State.ERRORPROCESSING: "on_error",
}


class LifecyclePublisher(Publisher[T]):
    """Publisher of a lifecycle node, which sends while the node is active, and otherwise drops and counts messages."""

    def __init__(
        self,
        scope: EntityScope,
        message_type: MessageType[T],
        topic: str,
        qos: QoSProfile,
        is_active: Callable[[], bool],
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> None:
        self._is_active = is_active
        self.silenced: int = 0
        """Number of messages that were dropped because the node was not active."""
        super().__init__(scope, message_type, topic, qos, event_callbacks=event_callbacks)

    def publish(self, message: T) -> None:
        """Publish a message if the node is active, else drop it."""
        if self._may_publish():
            super().publish(message)

    def publish_raw(self, data: bytes) -> None:
        """Publish serialized bytes if the node is active, else drop them."""
        if self._may_publish():
            super().publish_raw(data)

    def _may_publish(self) -> bool:
        if self._is_active():
            return True
        self.silenced += 1
        if self.silenced == 1:
            self._scope.logger.warning(f"messages on {self.topic} are dropped while the node is not active")
        return False


class LifecycleMachine:
    """State machine of one lifecycle node with its services and transition event, which calls the node's ``on_...``
    methods.
    """

    def __init__(self, scope: EntityScope, names: NodeNames, node: object, clock: Clock) -> None:
        self.state = State.UNCONFIGURED
        self._scope = scope
        self._node = node
        self._clock = clock
        self._event_class = _transition_event_class()
        self._event: Publisher[Any] = Publisher(
            scope, message_type(self._event_class), names.resolve_topic("~/transition_event"), DEFAULT
        )
        table: list[tuple[str, Any, Callable[[Any], Any]]] = [
            ("change_state", srv.ChangeState, self._on_change_state),
            ("get_state", srv.GetState, lambda request: srv.GetState.Response(current_state=_state(self.state))),
            ("get_available_states", srv.GetAvailableStates, self._on_states),
            (
                "get_available_transitions",
                srv.GetAvailableTransitions,
                lambda r: _transitions(available_transitions(self.state)),
            ),
            ("get_transition_graph", srv.GetAvailableTransitions, lambda r: _transitions(LIFECYCLE_TRANSITIONS)),
        ]
        for callback in _CALLBACKS.values():
            require_signature(getattr(node, callback), f"{callback} of a lifecycle node", "the previous state")
        for name, cls, handler in table:
            ServiceServer(scope, service_type(cls), names.resolve_service(f"~/{name}"), handler, SERVICES_DEFAULT)

    async def change(self, transition_id: int = 0, label: str = "") -> TransitionCallbackReturn:
        """Run a transition, and error processing if it fails; return the result of the transition's own callback.

        Raises:
            TransitionError: the transition is not possible in the current state.
            CancelledError: the caller was cancelled; the transition has ended as an error.
        """
        self._scope.require_open(False, "the lifecycle")
        row = requested_transition(self.state, transition_id, label)
        if row is None:
            possible = ", ".join(item.label for item in available_transitions(self.state) if item.id < 10) or "nothing"
            found = printable(label, _MAX_LABEL_CHARS) or transition_id
            raise TransitionError(f"{found!r} is not possible in state {self.state.label}; possible: {possible}")
        previous = self.state
        self._enter(row)
        outcome, cancelled = await self._run(previous)
        self._enter(finished_transition(self.state, outcome))
        if self.state is State.ERRORPROCESSING:
            recovered, cancelled_again = await self._run(previous)
            self._enter(finished_transition(self.state, recovered))
            cancelled = cancelled or cancelled_again
        if cancelled:
            raise asyncio.CancelledError
        return outcome

    async def _run(self, previous: State) -> tuple[TransitionCallbackReturn, bool]:
        """Call the callback of the current transition state.

        Returns:
            result of the callback, and True if the calling task was cancelled while the callback ran.
        """
        name = _CALLBACKS[self.state]
        if self._scope.closed:  # by the previous callback
            return TransitionCallbackReturn.ERROR, False
        callback = UserCallback(self._scope, getattr(self._node, name), f"{name} of a lifecycle node")
        outcomes = [TransitionCallbackReturn.ERROR]  # remains the last one if the callback raises or is cancelled
        task = callback.call(previous, on_result=lambda value: outcomes.append(to_callback_return(value)))
        cancelled = task is not None and await _await_uncancelled(task)
        return outcomes[-1], cancelled

    def _enter(self, row: Transition) -> None:
        self.state = row.goal
        if self._scope.closed:
            return
        event = self._event_class(start_state=_state(row.start), goal_state=_state(row.goal))
        if self._event_class is not msg.TransitionEvent:  # earlier distributions leave both empty
            event.stamp = self._clock.now().to_msg()
            event.transition = msg.Transition(id=row.id, label=row.label)
        self._event.publish(event)

    async def _on_change_state(self, request: srv.ChangeState.Request) -> srv.ChangeState.Response:
        try:
            outcome = await self.change(request.transition.id, request.transition.label)
        except TransitionError as error:
            self._scope.logger.warning(f"refused a change of state: {error}", throttle_s=1.0)
            return srv.ChangeState.Response(success=False)
        return srv.ChangeState.Response(success=outcome is TransitionCallbackReturn.SUCCESS)

    def _on_states(self, request: object) -> srv.GetAvailableStates.Response:
        return srv.GetAvailableStates.Response(available_states=[_state(state) for state in State])


def _transition_event_class() -> type[Any]:
    """Return the class of lifecycle_msgs/TransitionEvent in the selected distribution; Lyrical's has a ``stamp``."""
    distro = Distribution.selected().name
    if distro != Distribution.DEFAULT:
        from rosidl_py_gen.type_loading import distribution_definitions

        for definition in distribution_definitions(msg.TransitionEvent._TYPE.name):
            if distro in definition.distributions and definition.type_hash != msg.TransitionEvent._TYPE.hash:
                return definition.load()
    return msg.TransitionEvent


async def _await_uncancelled(task: asyncio.Future[Any]) -> bool:
    """Wait for the end of a task; return True if the calling task was cancelled while it waited.

    In this case, the awaited task is cancelled, too.
    """
    cancelled = False
    while not task.done():
        try:
            await asyncio.wait((task,))
        except asyncio.CancelledError:
            cancelled = True
            task.cancel()
    return cancelled


def _state(state: State) -> msg.State:
    return msg.State(id=int(state), label=state.label)


def _transitions(rows: Iterable[Transition]) -> srv.GetAvailableTransitions.Response:
    return srv.GetAvailableTransitions.Response(
        available_transitions=[
            msg.TransitionDescription(
                transition=msg.Transition(id=row.id, label=row.label),
                start_state=_state(row.start),
                goal_state=_state(row.goal),
            )
            for row in rows
        ]
    )


# ---------------------------------------------------------------------------------------------------------------- nodes

MessageT = TypeVar("MessageT", bound=Message)


class LifecycleNode(Node):
    """Lifecycle node, which peers configure, activate and shut down; arguments as for `Node`.

    Override `on_configure`, `on_activate` and so on; create endpoints in `on_configure`. Each ``on_...`` may be plain
    or async, gets the previous state, and returns a `TransitionCallbackReturn` or a number TRANSITION_CALLBACK_... .
    None and other true values mean SUCCESS, false values FAILURE, an exception ERROR. Without its own `on_error` a
    failed node is finalized.

    A transition whose caller is cancelled ends as an error: `on_error` runs and decides about the state, then the
    caller gets its CancelledError. A callback that suppresses the cancellation decides by its return value.
    """

    _machine: LifecycleMachine

    def _finish_open(self) -> None:
        self._machine = LifecycleMachine(self._scope, self._names, self, self.clock)

    def _may_declare_more(self) -> bool:
        return self.state is State.UNCONFIGURED

    def on_configure(self, state: State) -> Any:
        """Prepare the node (override this method); on success the node becomes inactive."""

    def on_cleanup(self, state: State) -> Any:
        """Undo `on_configure` (override this method); on success the node becomes unconfigured."""

    def on_activate(self, state: State) -> Any:
        """Start working (override this method); on success the node becomes active."""

    def on_deactivate(self, state: State) -> Any:
        """Stop working (override this method); on success the node becomes inactive."""

    def on_shutdown(self, state: State) -> Any:
        """Release all resources (override this method); the node becomes finalized."""

    def on_error(self, state: State) -> Any:
        """Recover from an error (override this method): SUCCESS makes the node unconfigured, all else finalized."""
        return TransitionCallbackReturn.FAILURE

    @property
    def state(self) -> State:
        """Current lifecycle state of the node."""
        return self._machine.state

    async def configure(self) -> TransitionCallbackReturn:
        """Change from unconfigured to inactive if `on_configure` succeeds, and return its result.

        Raises:
            TransitionError: the node is not unconfigured.
        """
        return await self._machine.change(label="configure")

    configure_sync = blocking(configure)

    async def cleanup(self) -> TransitionCallbackReturn:
        """Change from inactive to unconfigured if `on_cleanup` succeeds, and return its result.

        Raises:
            TransitionError: the node is not inactive.
        """
        return await self._machine.change(label="cleanup")

    cleanup_sync = blocking(cleanup)

    async def activate(self) -> TransitionCallbackReturn:
        """Change from inactive to active if `on_activate` succeeds, and return its result.

        Raises:
            TransitionError: the node is not inactive.
        """
        return await self._machine.change(label="activate")

    activate_sync = blocking(activate)

    async def deactivate(self) -> TransitionCallbackReturn:
        """Change from active to inactive if `on_deactivate` succeeds, and return its result.

        Raises:
            TransitionError: the node is not active.
        """
        return await self._machine.change(label="deactivate")

    deactivate_sync = blocking(deactivate)

    async def shutdown(self) -> TransitionCallbackReturn:
        """Change to finalized, and return the result of `on_shutdown`.

        Raises:
            TransitionError: the node is finalized, or in a transition.
        """
        return await self._machine.change(label="shutdown")

    shutdown_sync = blocking(shutdown)

    @overload
    def create_lifecycle_publisher(
        self, msg_type: type[MessageT], topic: str, qos: QoSLike = 10, *,
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> LifecyclePublisher[MessageT]: ...  # fmt: skip
    @overload
    def create_lifecycle_publisher(
        self, msg_type: str, topic: str, qos: QoSLike = 10, *, event_callbacks: PublisherEventCallbacks | None = None
    ) -> LifecyclePublisher[DictMessage]: ...
    def create_lifecycle_publisher(
        self,
        msg_type: type[Message] | str,
        topic: str,
        qos: QoSLike = 10,
        *,
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> LifecyclePublisher[Any]:
        """Create a publisher that sends only while the node is active; arguments and errors as `create_publisher`."""
        self._scope.require_open(False, "the node")
        return LifecyclePublisher(
            self._scope,
            message_type(msg_type),
            self._names.resolve_topic(topic),
            as_profile(qos),
            lambda: self.state is State.ACTIVE,
            event_callbacks,
        )
