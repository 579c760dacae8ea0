"""Lifecycle node: a `Node` with the state machine of `state_machine.py`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar, overload

from rosidl_py_gen.base.waiters import blocking
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.runtime.entities.message_types import message_type
from rosidl_py_gen.runtime.lifecycle.state_machine import (
    LifecycleMachine,
    LifecyclePublisher,
    State,
    TransitionCallbackReturn,
)
from rosidl_py_gen.runtime.node.node import Node
from rosidl_py_gen.runtime.transport.qos import as_profile

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.message_types import DictMessage
    from rosidl_py_gen.runtime.graph.endpoint_events import PublisherEventCallbacks
    from rosidl_py_gen.runtime.transport.qos import QoSLike

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
