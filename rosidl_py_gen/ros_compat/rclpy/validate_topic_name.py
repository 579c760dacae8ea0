"""Whether a name of a topic or service may be written so."""

from __future__ import annotations

from typing import Literal

from rclpy.exceptions import InvalidServiceNameException, InvalidTopicNameException
from rclpy.impl.names import topic_name_error

TOPIC_SEPARATOR_STRING = "/"


def validate_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """True for a name as written, with ``~`` and substitutions; InvalidTopicNameException, or -Service-, otherwise."""
    fault = topic_name_error(name)
    if fault is not None:
        raise (InvalidServiceNameException if is_service else InvalidTopicNameException)(name, *fault)
    return True
