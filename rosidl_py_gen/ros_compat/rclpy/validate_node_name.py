"""Validation of node names."""

from typing import Literal

from rclpy.exceptions import InvalidNodeNameException
from rclpy.impl.names import node_name_error


def validate_node_name(node_name: str) -> Literal[True]:
    """Return True for a valid name without namespace; raise InvalidNodeNameException for others."""
    fault = node_name_error(node_name)
    if fault is not None:
        raise InvalidNodeNameException(node_name, *fault)
    return True
