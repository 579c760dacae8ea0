"""What time it is for viewers: simulated time where somebody publishes ``/clock``, else the system's."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import stamp_ns
from rosidl_py_gen.runtime.qos import CLOCK

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.foxglove.server import Server
    from rosidl_py_gen.runtime import Node

TOPIC = "/clock"
_TELL_S = 1 / 30
"""Viewers draw no faster; what they are told about time is never dropped, so that it should not be much."""


class ViewerClock:
    """The time of messages; with `follow` simulated time."""

    def __init__(self) -> None:
        self._sim_ns: int | None = None
        self._told_at = 0.0

    def now_ns(self) -> int:
        """Nanoseconds; 0 before the first word of ``/clock``."""
        return time.time_ns() if self._sim_ns is None else self._sim_ns

    def follow(self, node: Node, server: Server) -> None:
        """Take the time from ``/clock`` from now on, and tell viewers."""
        self._sim_ns = 0
        clock: Any = get_message("rosgraph_msgs/msg/Clock")

        def arrived(message: Any) -> None:
            self._sim_ns = max(0, stamp_ns(message.clock))
            now = time.monotonic()
            if now >= self._told_at + _TELL_S:
                self._told_at = now
                server.tell_time(self._sim_ns)

        node.create_subscription(clock, TOPIC, arrived, CLOCK)
