"""Validation of node names."""

from typing import Literal

from rclpy.exceptions import InvalidNodeNameException
from rclpy.impl.names import require_valid


def validate_node_name(node_name: str) -> Literal[True]:
    """Return True for a valid node name without namespace; raise InvalidNodeNameException for others."""
    return require_valid("node name", node_name, InvalidNodeNameException)
