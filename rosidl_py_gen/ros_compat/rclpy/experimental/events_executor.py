"""The executor that does not wait for sets of things, but is told: here all are, and one thread runs callbacks."""

from __future__ import annotations

import faulthandler  # noqa: F401
import typing  # noqa: F401

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor


def EventsExecutor(*, context: Context | None = None) -> Executor:
    """An executor of one thread."""
    return SingleThreadedExecutor(context=context)
