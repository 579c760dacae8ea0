"""Experimental parts of rclpy; the asyncio node needs Python 3.11 or later, for `asyncio.TaskGroup`."""

import sys

from rclpy.experimental.events_executor import EventsExecutor

if sys.version_info >= (3, 11):
    from rclpy.experimental.async_client import AsyncClient
    from rclpy.experimental.async_clock import AsyncClock
    from rclpy.experimental.async_node import AsyncNode
    from rclpy.experimental.async_publisher import AsyncPublisher
    from rclpy.experimental.async_service import AsyncService
    from rclpy.experimental.async_subscription import AsyncSubscription
    from rclpy.experimental.async_timer import AsyncTimer
