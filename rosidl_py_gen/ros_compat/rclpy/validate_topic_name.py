"""Validation of topic and service names before expansion (relative, absolute, ``~``, ``{…}``)."""

from typing import Literal

from rclpy.exceptions import InvalidServiceNameException, InvalidTopicNameException
from rclpy.impl.names import require_valid

TOPIC_SEPARATOR_STRING = "/"


def validate_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return True for a valid topic or service name before expansion, which may contain ``~`` and substitutions.

    Raises:
        InvalidTopicNameException, InvalidServiceNameException: the name is invalid.
    """
    error = InvalidServiceNameException if is_service else InvalidTopicNameException
    return require_valid("topic name", name, error)
