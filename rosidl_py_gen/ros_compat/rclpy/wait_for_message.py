"""Function that receives one message without an executor."""

from typing import Any, Union

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerGuardCondition
from rclpy.utilities import timeout_sec_to_nsec


def wait_for_message(
    msg_type: type[Any], node: Node, topic: str, *, qos_profile: QoSProfile | int = 1, time_to_wait: float = -1
) -> tuple[bool, Any]:
    """Wait for the next message of a topic, without running other callbacks of the node.

    Args:
        qos_profile: profile or depth.
        time_to_wait: maximum time to wait, in seconds; negative: unlimited.

    Returns:
        True and the message; False and None if the time has passed or the context was shut down.
    """
    handle = node.context.handle
    if handle is None or not handle.ok():
        return False, None
    subscription = node.create_subscription(msg_type, topic, lambda _: None, qos_profile)
    messages: list[Any] = []

    def has_arrived() -> bool:
        if not messages and (message := subscription.handle.entity.take()) is not None:
            messages.append(message)
        return bool(messages)

    try:
        with subscription.handle:
            handle.wait(has_arrived, None if time_to_wait < 0 else time_to_wait)
    finally:
        node.destroy_subscription(subscription)
    return (True, messages[0]) if messages else (False, None)
