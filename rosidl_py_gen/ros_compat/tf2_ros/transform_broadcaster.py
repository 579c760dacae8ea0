"""Broadcasters: publishers of changing transforms, and of static transforms."""

from collections.abc import Iterable
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from tf2_msgs.msg import TFMessage


class TransformBroadcaster:
    """Publisher of transforms on ``/tf``; `qos` is a profile or a depth, by default 100."""

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        self.pub_tf = node.create_publisher(TFMessage, "/tf", QoSProfile(depth=100) if qos is None else qos)

    def sendTransform(self, transform: Any) -> None:
        """Publish one transform, or several transforms in one message."""
        self.pub_tf.publish(TFMessage(transforms=_as_list(transform)))


class StaticTransformBroadcaster:
    """Publisher of transforms that are valid at all times on ``/tf_static``; `qos` is a profile or a depth."""

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        if qos is None:
            qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, history=HistoryPolicy.KEEP_LAST)
        self.pub_tf = node.create_publisher(TFMessage, "/tf_static", qos)
        self.net_message = TFMessage()
        self._rosidl_child_frame_ids: set[str] = set()

    def sendTransform(self, transform: Any) -> None:
        """Publish one or several transforms, together with all earlier transforms of this broadcaster.

        A further transform for a child frame that has one already is ignored.
        """
        for item in _as_list(transform):
            if item.child_frame_id not in self._rosidl_child_frame_ids:
                self._rosidl_child_frame_ids.add(item.child_frame_id)
                self.net_message.transforms.append(item)
        self.pub_tf.publish(self.net_message)


def _as_list(transform: Any) -> list[Any]:
    """Return a list of transforms; the argument is one transform, or several."""
    return list(transform) if isinstance(transform, Iterable) else [transform]
