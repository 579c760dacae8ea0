"""Goals of an action server."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy._rclpy_pybind11 import RCLError
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from rclpy.action.server import ActionServer

GoalEvent = runtime.GoalEvent


class ServerGoalHandle:
    """Accepted goal. `succeed`, `abort` and `canceled` end it; its result is what the execute callback returns."""

    def __init__(self, action_server: ActionServer, goal_info: Any, goal_request: Any) -> None:
        self._action_server = action_server
        self._goal_info = goal_info
        self._goal_request = goal_request
        self._rosidl_status: runtime.GoalStatus = runtime.GoalStatus.ACCEPTED
        self._rosidl_is_destroyed = False
        self._lock = threading.RLock()

    def __eq__(self, other: object) -> bool:
        return bool(self.goal_id == other.goal_id) if isinstance(other, ServerGoalHandle) else NotImplemented

    def __ne__(self, other: object) -> bool:
        return not self == other

    @property
    def request(self) -> Any:
        """Goal that the client sent."""
        return self._goal_request

    @property
    def goal_id(self) -> Any:
        """Id, a unique_identifier_msgs/UUID."""
        return self._goal_info.goal_id

    @property
    def is_active(self) -> bool:
        """True if the goal has not ended."""
        with self._lock:
            return not self._rosidl_is_destroyed and self._rosidl_status.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """True if the goal is to be canceled; then the execute callback calls `canceled`."""
        return self.status == runtime.GoalStatus.CANCELING

    @property
    def status(self) -> int:
        """Number of action_msgs/GoalStatus; STATUS_UNKNOWN after `destroy`."""
        with self._lock:
            return int(runtime.GoalStatus.UNKNOWN if self._rosidl_is_destroyed else self._rosidl_status)

    def _update_state(self, event: runtime.GoalEvent) -> None:
        with self._lock:
            if self._rosidl_is_destroyed:
                return
            try:
                self._rosidl_status = runtime.next_goal_status(self._rosidl_status, event)
            except runtime.GoalTransitionError as error:
                raise RCLError(f"Failed to update goal state: {error}") from error
            has_ended = not self._rosidl_status.is_active
        self._action_server._rosidl_publish_status()
        if has_ended:
            self._action_server.notify_goal_done()

    def execute(self, execute_callback: Callable[[ServerGoalHandle], Any] | None = None) -> None:
        """Schedule the execution, by this callback or that of the server."""
        if not self.is_cancel_requested:
            self._update_state(GoalEvent.EXECUTE)
        self._action_server.notify_execute(self, execute_callback)

    def publish_feedback(self, feedback: Any) -> None:
        """Publish feedback; raise TypeError for another class."""
        expected = self._action_server.action_type.Feedback
        if not isinstance(feedback, expected):
            raise TypeError(f"Expected type {expected.__name__} but received {type(feedback)}")
        if not self._rosidl_is_destroyed:
            self._action_server._rosidl_publish_feedback(self.goal_id, feedback)

    def succeed(self) -> None:
        """End the goal as succeeded; raise RCLError if that is not possible, as the next two methods."""
        self._update_state(GoalEvent.SUCCEED)

    def abort(self) -> None:
        """End the goal as aborted."""
        self._update_state(GoalEvent.ABORT)

    def canceled(self) -> None:
        """End the goal as canceled, after a client requested that."""
        self._update_state(GoalEvent.CANCELED)

    def destroy(self) -> None:
        """Invalidate the goal."""
        with self._lock:
            self._rosidl_is_destroyed = True
