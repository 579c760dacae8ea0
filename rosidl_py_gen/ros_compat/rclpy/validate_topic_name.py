"""Validation of topic and service names before expansion (relative, absolute, ``~``, ``{…}``)."""

from typing import Literal

from rclpy.exceptions import InvalidServiceNameException, InvalidTopicNameException
from rclpy.impl.names import topic_name_error

TOPIC_SEPARATOR_STRING = "/"


def validate_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return True for a valid name before expansion, which may have ``~`` and substitutions.

    Raises:
        InvalidTopicNameException, InvalidServiceNameException: the name is invalid.
    """
    fault = topic_name_error(name)
    if fault is not None:
        raise (InvalidServiceNameException if is_service else InvalidTopicNameException)(name, *fault)
    return True
