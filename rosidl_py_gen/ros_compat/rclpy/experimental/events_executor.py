"""Name of the events executor; here all executors react to events, and one thread runs the callbacks."""

import faulthandler
import typing

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor


def EventsExecutor(*, context: Context | None = None) -> Executor:
    """Create an executor of one thread."""
    return SingleThreadedExecutor(context=context)
