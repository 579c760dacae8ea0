"""Clock of viewers: simulated time if ``/clock`` is published, else system time."""

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
_MIN_INTERVAL_S = 1 / 30
"""Minimum interval of time updates. Viewers draw at most 30 times a second, and time updates are never dropped."""


class ViewerClock:
    """Time of messages; simulated time after `follow`."""

    def __init__(self) -> None:
        self._sim_ns: int | None = None
        self._sent_at = 0.0

    def now_ns(self) -> int:
        """Return the time in nanoseconds; 0 before the first message of ``/clock``."""
        return time.time_ns() if self._sim_ns is None else self._sim_ns

    def follow(self, node: Node, server: Server) -> None:
        """Use the time of ``/clock`` from now on, and send it to viewers."""
        self._sim_ns = 0
        clock: Any = get_message("rosgraph_msgs/msg/Clock")

        def on_message(message: Any) -> None:
            self._sim_ns = max(0, stamp_ns(message.clock))
            now = time.monotonic()
            if now >= self._sent_at + _MIN_INTERVAL_S:
                self._sent_at = now
                server.send_time(self._sim_ns)

        node.create_subscription(clock, TOPIC, on_message, CLOCK)
