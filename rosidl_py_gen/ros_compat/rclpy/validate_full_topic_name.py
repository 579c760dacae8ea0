"""Whether a fully qualified name of a topic or service is allowed."""

from __future__ import annotations

from typing import Literal

from rclpy.exceptions import InvalidServiceNameException, InvalidTopicNameException
from rclpy.impl.names import full_topic_name_error


def validate_full_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """True for an allowed name; InvalidTopicNameException, or InvalidServiceNameException, otherwise."""
    fault = full_topic_name_error(name)
    if fault is not None:
        raise (InvalidServiceNameException if is_service else InvalidTopicNameException)(name, *fault)
    return True
