"""Validation of namespaces."""

from typing import Literal

from rclpy.exceptions import InvalidNamespaceException
from rclpy.impl.names import namespace_error


def validate_namespace(namespace: str) -> Literal[True]:
    """Return True for ``/`` or ``/a/b``; raise InvalidNamespaceException for an invalid namespace."""
    fault = namespace_error(namespace)
    if fault is not None:
        raise InvalidNamespaceException(namespace, *fault)
    return True
