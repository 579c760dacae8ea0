"""Validation of fully qualified topic and service names."""

from typing import Literal

from rclpy.exceptions import InvalidServiceNameException, InvalidTopicNameException
from rclpy.impl.names import require_valid


def validate_full_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return True for a valid full name; raise InvalidTopicNameException or InvalidServiceNameException for others."""
    error = InvalidServiceNameException if is_service else InvalidTopicNameException
    return require_valid("full topic name", name, error)
