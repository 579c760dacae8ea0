"""Name of the events executor; here all executors react to events, and one thread runs the callbacks."""

import faulthandler  # noqa: F401
import typing  # noqa: F401

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor


def EventsExecutor(*, context: Context | None = None) -> Executor:
    """Create an executor of one thread."""
    return SingleThreadedExecutor(context=context)
