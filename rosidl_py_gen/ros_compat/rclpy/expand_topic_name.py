"""Names as written, made fully qualified."""

from __future__ import annotations

from rclpy.impl.names import namespace_error, node_name_error, topic_name_error
from rosidl_py_gen import InvalidNameError, runtime


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """``/ns/node/x`` for ``~/x``, without remapping; what comes out may still be no allowed name.

    Raises ValueError when one of the three is not allowed.
    """
    for what, name, fault in (
        ("topic name", topic_name, topic_name_error(topic_name)),
        ("node name", node_name, node_name_error(node_name)),
        ("node namespace", node_namespace, namespace_error(node_namespace)),
    ):
        if fault is not None:
            raise ValueError(f"{what} '{name}' is invalid: {fault[0]}")
    try:
        return runtime.expand_name(topic_name, node_name, node_namespace)
    except InvalidNameError as error:
        if error.name != topic_name or (topic_name.startswith("/") and "{" not in topic_name):
            return error.name  # what came out, and is no name
        raise ValueError(f"topic name '{topic_name}' is invalid: {error.reason}") from error
