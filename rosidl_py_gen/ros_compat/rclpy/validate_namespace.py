"""Validation of namespaces."""

from typing import Literal

from rclpy.exceptions import InvalidNamespaceException
from rclpy.impl.names import require_valid


def validate_namespace(namespace: str) -> Literal[True]:
    """Return True for a valid namespace such as ``/`` or ``/a/b``; raise InvalidNamespaceException for others."""
    return require_valid("namespace", namespace, InvalidNamespaceException)
