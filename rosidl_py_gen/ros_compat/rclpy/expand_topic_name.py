"""Expansion of topic and service names."""

from rclpy.impl.names import name_error
from rosidl_py_gen import InvalidNameError, runtime


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """Return the full name of a topic, such as ``/ns/node/x`` for ``~/x``, without remapping.

    The result may still be an invalid name.

    Raises:
        ValueError: one of the three arguments is invalid.
    """
    for kind, name in (("topic name", topic_name), ("node name", node_name), ("namespace", node_namespace)):
        if error := name_error(kind, name):
            raise ValueError(f"{kind.replace('namespace', 'node namespace')} '{name}' is invalid: {error[0]}")
    try:
        return runtime.expand_name(topic_name, node_name, node_namespace)
    except InvalidNameError as invalid:
        if invalid.name != topic_name or (topic_name.startswith("/") and "{" not in topic_name):
            return invalid.name  # the invalid result of the expansion
        raise ValueError(f"topic name '{topic_name}' is invalid: {invalid.reason}") from invalid
