"""Client that looks transforms up in the buffer of another node, by the action of that node."""

from __future__ import annotations

import warnings
from typing import Any

import builtin_interfaces.msg
from geometry_msgs.msg import TransformStamped
from rclpy.action.client import ActionClient
from rclpy.duration import Duration
from rclpy.impl.pending_requests import wait_until_done
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
    _check_lookup,
)

from tf2_ros.buffer_interface import NO_TIME, BufferInterface

_DEFAULT_TIMEOUT_PADDING = Duration(seconds=2.0)
_MAX_TEXT = 2000
"""Maximum characters of a buffer server's error text that an exception quotes; texts of tf2 have about 200."""
_ERRORS = {
    TF2Error.LOOKUP_ERROR: LookupException,
    TF2Error.CONNECTIVITY_ERROR: ConnectivityException,
    TF2Error.EXTRAPOLATION_ERROR: ExtrapolationException,
    TF2Error.INVALID_ARGUMENT_ERROR: InvalidArgumentException,
    TF2Error.TIMEOUT_ERROR: TimeoutException,
}


class BufferClient(BufferInterface):
    """Client of a buffer server (node with a buffer of transforms); another thread must spin the node during a call.

    Args:
        ns: name of the server's action.
        check_frequency: without effect, because results are not polled.
        timeout_padding: time in addition to `timeout` that a server may take.
    """

    def __init__(
        self, node: Node, ns: str, check_frequency: float = 10.0, timeout_padding: Duration = _DEFAULT_TIMEOUT_PADDING
    ) -> None:
        super().__init__()
        self.node = node
        self.action_client = ActionClient(node, LookupTransform, action_name=ns)
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding

    def lookup_transform(self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_TIME) -> Any:
        """Return the transform from `source_frame` to `target_frame` at a time; time 0 means the latest.

        Raises:
            TimeoutException: there is no server, or it did not reply in time. Others as the server reports.
        """
        if isinstance(time, builtin_interfaces.msg.Time):
            warnings.warn("time: builtin_interfaces.msg.Time is deprecated; use rclpy.time.Time", stacklevel=2)
            time = Time.from_msg(time)
        elif not isinstance(time, Time):
            raise TypeError(f"time: expected a rclpy.time.Time, got {type(time).__name__}")
        goal = LookupTransform.Goal(target_frame=target_frame, source_frame=source_frame, advanced=False)
        goal.source_time, goal.timeout = time.to_msg(), timeout.to_msg()
        return self._rosidl_request(goal, timeout)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
    ) -> Any:
        """Return the transform from `source_frame` at one time to `target_frame` at another time.

        The frame `fixed_frame` is assumed not to move between the times.
        """
        goal = LookupTransform.Goal(target_frame=target_frame, source_frame=source_frame, advanced=True)
        goal.source_time, goal.timeout = source_time.to_msg(), timeout.to_msg()
        goal.target_time, goal.fixed_frame = target_time.to_msg(), fixed_frame
        return self._rosidl_request(goal, timeout)

    def can_transform(self, target_frame: str, source_frame: str, time: Time, timeout: Duration = NO_TIME) -> bool:
        """Return True if `lookup_transform` with the same arguments would succeed."""
        return _check_lookup(lambda: self.lookup_transform(target_frame, source_frame, time, timeout))[0]

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Time,
        source_frame: str,
        source_time: Time,
        fixed_frame: str,
        timeout: Duration = NO_TIME,
    ) -> bool:
        """Return True if `lookup_transform_full` with the same arguments would succeed."""
        arguments = target_frame, target_time, source_frame, source_time, fixed_frame
        return _check_lookup(lambda: self.lookup_transform_full(*arguments, timeout))[0]

    def destroy(self) -> None:
        self.action_client.destroy()

    def _rosidl_request(self, goal: Any, timeout: Duration) -> Any:
        if not self.action_client.server_is_ready():
            raise TimeoutException("The BufferServer is not ready.")
        goal_future = self.action_client.send_goal_async(goal)
        if not wait_until_done(goal_future, (timeout.nanoseconds + self.timeout_padding.nanoseconds) / 1e9):
            raise TimeoutException("the BufferServer did not reply to the goal in time")
        handle: Any = goal_future.result()
        if not handle.accepted:
            raise TimeoutException("the BufferServer did not accept the goal")
        future = handle.get_result_async()
        wait_until_done(future)
        result: Any = future.result().result
        if result.error.error != TF2Error.NO_ERROR:
            raise _ERRORS.get(result.error.error, TransformException)(result.error.error_string[:_MAX_TEXT])
        return result.transform
