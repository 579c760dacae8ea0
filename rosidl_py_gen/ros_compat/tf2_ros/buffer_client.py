"""Asks a buffer of another node for transforms, by the action of its server."""

from __future__ import annotations

import threading
import warnings
from typing import Any

import builtin_interfaces.msg
from geometry_msgs.msg import TransformStamped as TransformStamped
from rclpy.action.client import ActionClient
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error
from tf2_py import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
    _can,
)

from tf2_ros.buffer_interface import NO_TIME, BufferInterface

_PADDING = Duration(seconds=2.0)
_MAX_TEXT = 2000
"""Number of characters that an exception has of a server's text; tf2's texts have some 200."""
_ERRORS = {
    TF2Error.LOOKUP_ERROR: LookupException,
    TF2Error.CONNECTIVITY_ERROR: ConnectivityException,
    TF2Error.EXTRAPOLATION_ERROR: ExtrapolationException,
    TF2Error.INVALID_ARGUMENT_ERROR: InvalidArgumentException,
    TF2Error.TIMEOUT_ERROR: TimeoutException,
}


class BufferClient(BufferInterface):
    """A buffer that a server has; another thread has to spin the node while it is asked.

    Args:
        node: has the action client.
        ns: the name of the server's action.
        check_frequency: counts for nothing here: answers are waited for, not looked for.
        timeout_padding: how much longer than the `timeout` of a question a server may take.
    """

    def __init__(
        self, node: Node, ns: str, check_frequency: float = 10.0, timeout_padding: Duration = _PADDING
    ) -> None:
        super().__init__()
        self.node = node
        self.action_client = ActionClient(node, LookupTransform, action_name=ns)
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding

    def lookup_transform(self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_TIME) -> Any:
        """How coordinates in `source_frame` become coordinates in `target_frame`; time 0 takes the newest.

        Raises:
            TimeoutException: there is no server, or no answer in time. Others as the server says.
        """
        if isinstance(time, builtin_interfaces.msg.Time):
            warnings.warn("a builtin_interfaces.msg.Time is deprecated here; use rclpy.time.Time", stacklevel=2)
            time = Time.from_msg(time)
        elif not isinstance(time, Time):
            raise TypeError(f"time: expected a rclpy.time.Time, got {type(time).__name__}")
        goal = LookupTransform.Goal(target_frame=target_frame, source_frame=source_frame, advanced=False)
        goal.source_time, goal.timeout = time.to_msg(), timeout.to_msg()
        return self._rosidl_asked(goal, timeout)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
    ) -> Any:
        """The same between two times, as `fixed_frame` did not move in between."""
        goal = LookupTransform.Goal(target_frame=target_frame, source_frame=source_frame, advanced=True)
        goal.source_time, goal.timeout = source_time.to_msg(), timeout.to_msg()
        goal.target_time, goal.fixed_frame = target_time.to_msg(), fixed_frame
        return self._rosidl_asked(goal, timeout)

    def can_transform(self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_TIME) -> bool:
        """Whether `lookup_transform` gives something."""
        return _can(lambda: self.lookup_transform(target_frame, source_frame, time, timeout))[0]

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
    ) -> bool:
        """Whether `lookup_transform_full` gives something."""
        asked = target_frame, target_time, source_frame, source_time, fixed_frame
        return _can(lambda: self.lookup_transform_full(*asked, timeout))[0]

    def destroy(self) -> None:
        """Destroy the action client."""
        self.action_client.destroy()

    def _rosidl_asked(self, goal: Any, timeout: Duration) -> Any:
        if not self.action_client.server_is_ready():
            raise TimeoutException("The BufferServer is not ready.")
        sent = self.action_client.send_goal_async(goal)
        if not _done(sent, (timeout.nanoseconds + self.timeout_padding.nanoseconds) / 1e9):
            raise TimeoutException("the BufferServer did not answer the goal in time")
        handle: Any = sent.result()
        if not handle.accepted:
            raise TimeoutException("the BufferServer did not accept the goal")
        answer = handle.get_result_async()
        _done(answer, None)
        found: Any = answer.result().result
        if found.error.error != TF2Error.NO_ERROR:
            raise _ERRORS.get(found.error.error, TransformException)(found.error.error_string[:_MAX_TEXT])
        return found.transform


def _done(future: Future[Any], seconds: float | None) -> bool:
    """Wait in this thread for what another one brings."""
    event = threading.Event()
    future.add_done_callback(lambda _: event.set())
    return event.wait(seconds)
