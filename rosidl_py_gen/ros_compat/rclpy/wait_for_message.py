"""One message, without spinning."""

from __future__ import annotations

from typing import Any, Union  # noqa: F401

from rclpy.node import Node as Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerGuardCondition as SignalHandlerGuardCondition
from rclpy.utilities import timeout_sec_to_nsec as timeout_sec_to_nsec


def wait_for_message(
    msg_type: type[Any], node: Node, topic: str, *, qos_profile: QoSProfile | int = 1, time_to_wait: float = -1
) -> tuple[bool, Any]:
    """Wait for the next message of a topic; other work of the node is left alone.

    Args:
        time_to_wait: seconds; negative means for ever.

    Returns:
        True and the message, or False and None when the time has passed or the context was shut down.
    """
    handle = node.context.handle
    if handle is None or not handle.ok():
        return False, None
    subscription = node.create_subscription(msg_type, topic, lambda _: None, qos_profile)
    found: list[Any] = []

    def arrived() -> bool:
        if not found and (message := subscription.handle.entity.take()) is not None:
            found.append(message)
        return bool(found)

    try:
        with subscription.handle:
            handle.wait(arrived, time_to_wait)
    finally:
        node.destroy_subscription(subscription)
    return (True, found[0]) if found else (False, None)
