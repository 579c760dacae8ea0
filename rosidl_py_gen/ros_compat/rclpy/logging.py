"""Loggers by name, and their levels."""

from __future__ import annotations

from pathlib import Path
from typing import Union

from rclpy._rclpy_pybind11 import (
    rclpy_logging_get_logger_effective_level,
    rclpy_logging_get_logger_level,
    rclpy_logging_set_logger_level,
    rclpy_logging_severity_level_from_string,
)
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.impl.rcutils_logger import RcutilsLogger
from rosidl_py_gen import runtime

_root_logger = RcutilsLogger()


def get_logger(name: str) -> RcutilsLogger:
    """Return the logger with a name, for use without a node; raise ValueError for an empty name."""
    if not name:
        raise ValueError("Logger name must not be empty.")
    return _root_logger.get_child(name)


def initialize() -> None:
    """Do nothing: logging is always initialized."""


def shutdown() -> None:
    """Reset the level of every logger, as `clear_config` does."""
    runtime.set_logger_level("", "unset")
    for name in list(runtime.get_logger("").manager.loggerDict):
        runtime.set_logger_level(name, "unset")


def clear_config() -> None:
    """Reset the level of every logger."""
    shutdown()
    initialize()


def set_logger_level(name: str, level: int | LoggingSeverity, detailed_error: bool = False) -> None:
    """Set the level of a logger, and of its children without a level; raise ValueError for an unknown level."""
    rclpy_logging_set_logger_level(name, LoggingSeverity(level))


def get_logger_effective_level(name: str) -> LoggingSeverity:
    """Return the lowest severity that a logger logs."""
    return LoggingSeverity(rclpy_logging_get_logger_effective_level(name))


def get_logger_level(name: str) -> LoggingSeverity:
    """Return the level that was set for a logger, UNSET if none was set."""
    return LoggingSeverity(rclpy_logging_get_logger_level(name))


def get_logging_severity_from_string(log_severity: str) -> LoggingSeverity:
    """Return the severity with a name in upper or lower case; raise RuntimeError for an unknown name."""
    return LoggingSeverity(rclpy_logging_severity_level_from_string(log_severity))


def get_logging_directory() -> Path:
    """Return the folder of log files, from ``ROS_LOG_DIR`` or ``ROS_HOME``."""
    return runtime.get_logging_directory()
