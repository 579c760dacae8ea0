"""Whether a name of a parameter is allowed."""

from __future__ import annotations

from typing import Literal

from rclpy.exceptions import InvalidParameterException


def validate_parameter_name(name: str) -> Literal[True]:
    """True for any name that is not empty; InvalidParameterException otherwise."""
    if not name:
        raise InvalidParameterException(name)
    return True
