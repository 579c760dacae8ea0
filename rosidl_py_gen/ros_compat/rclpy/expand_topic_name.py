"""Expansion of topic and service names."""

from rclpy.impl.names import namespace_error, node_name_error, topic_name_error
from rosidl_py_gen import InvalidNameError, runtime


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """Return ``/ns/node/x`` for ``~/x``, without remapping; the result may still be an invalid name.

    Raises:
        ValueError: one of the three arguments is invalid.
    """
    for kind, name, error in (
        ("topic name", topic_name, topic_name_error(topic_name)),
        ("node name", node_name, node_name_error(node_name)),
        ("node namespace", node_namespace, namespace_error(node_namespace)),
    ):
        if error is not None:
            raise ValueError(f"{kind} '{name}' is invalid: {error[0]}")
    try:
        return runtime.expand_name(topic_name, node_name, node_namespace)
    except InvalidNameError as invalid:
        if invalid.name != topic_name or (topic_name.startswith("/") and "{" not in topic_name):
            return invalid.name  # the invalid result of the expansion
        raise ValueError(f"topic name '{topic_name}' is invalid: {invalid.reason}") from invalid
