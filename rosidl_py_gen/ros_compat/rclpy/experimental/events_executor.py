"""Module with the name of rclpy's events executor.

Here all executors react to events, and this one runs callbacks in one thread.
"""

import faulthandler
import typing

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor


def EventsExecutor(*, context: Context | None = None) -> Executor:
    """Return an executor that runs callbacks in the spinning thread."""
    return SingleThreadedExecutor(context=context)
