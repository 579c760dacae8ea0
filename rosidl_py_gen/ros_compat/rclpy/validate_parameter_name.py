"""Validation of parameter names."""

from typing import Literal

from rclpy.exceptions import InvalidParameterException


def validate_parameter_name(name: str) -> Literal[True]:
    """Return True for a name that is not empty; raise InvalidParameterException for an empty one."""
    if not name:
        raise InvalidParameterException(name)
    return True
