"""Validation of fully qualified topic and service names."""

from typing import Literal

from rclpy.exceptions import InvalidServiceNameException, InvalidTopicNameException
from rclpy.impl.names import full_topic_name_error


def validate_full_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return True for a valid name; raise InvalidTopicNameException or InvalidServiceNameException."""
    fault = full_topic_name_error(name)
    if fault is not None:
        raise (InvalidServiceNameException if is_service else InvalidTopicNameException)(name, *fault)
    return True
