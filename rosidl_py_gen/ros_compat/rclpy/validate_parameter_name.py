"""Validation of parameter names."""

from typing import Literal

from rclpy.exceptions import InvalidParameterException


def validate_parameter_name(name: str) -> Literal[True]:
    """Return True for a valid parameter name; raise InvalidParameterException for an empty name."""
    if not name:
        raise InvalidParameterException(name)
    return True
