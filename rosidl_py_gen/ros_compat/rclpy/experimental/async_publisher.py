"""Publishers of asyncio nodes."""

from rclpy.publisher import BasePublisher


class AsyncPublisher(BasePublisher):
    """Publisher of a topic, created by `AsyncNode.create_publisher`."""
