"""Whether a name of a node is allowed."""

from __future__ import annotations

from typing import Literal

from rclpy.exceptions import InvalidNodeNameException
from rclpy.impl.names import node_name_error


def validate_node_name(node_name: str) -> Literal[True]:
    """True for an allowed name without namespace; InvalidNodeNameException otherwise."""
    fault = node_name_error(node_name)
    if fault is not None:
        raise InvalidNodeNameException(node_name, *fault)
    return True
