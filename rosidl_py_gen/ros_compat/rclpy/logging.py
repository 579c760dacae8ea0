"""Loggers by name, and their levels."""

from __future__ import annotations

from pathlib import Path
from typing import Union  # noqa: F401

from rclpy._rclpy_pybind11 import rclpy_logging_severity_level_from_string
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.impl.rcutils_logger import RcutilsLogger, as_severity, set_level
from rosidl_py_gen import runtime

_root_logger = RcutilsLogger()


def get_logger(name: str) -> RcutilsLogger:
    """The logger of that name; it needs no node. ValueError for an empty name."""
    if not name:
        raise ValueError("Logger name must not be empty.")
    return _root_logger.get_child(name)


def initialize() -> None:
    """Without effect: logging is always ready."""


def shutdown() -> None:
    """Forget all levels that were set."""
    runtime.set_logger_level("", "unset")
    for name in list(runtime.get_logger("").manager.loggerDict):
        runtime.set_logger_level(name, "unset")


def clear_config() -> None:
    """Forget all levels that were set."""
    shutdown()
    initialize()


def set_logger_level(name: str, level: int | LoggingSeverity, detailed_error: bool = False) -> None:
    """Set the level of a logger, and of those below it that have none; ValueError for an unknown level."""
    set_level(name, level)


def get_logger_effective_level(name: str) -> LoggingSeverity:
    """From which severity on a logger logs."""
    return as_severity(runtime.get_logger(name).getEffectiveLevel())


def get_logger_level(name: str) -> LoggingSeverity:
    """The level that was set; UNSET when none was."""
    return as_severity(runtime.get_logger_level(name))


def get_logging_severity_from_string(log_severity: str) -> LoggingSeverity:
    """``INFO`` or ``info`` as a severity; RuntimeError for an unknown one."""
    return LoggingSeverity(rclpy_logging_severity_level_from_string(log_severity))


def get_logging_directory() -> Path:
    """Where log files are written, as ``ROS_LOG_DIR`` and ``ROS_HOME`` say."""
    return runtime.get_logging_directory()
