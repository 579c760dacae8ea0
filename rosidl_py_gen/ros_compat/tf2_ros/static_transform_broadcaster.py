"""Sends transforms that hold at all times."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import TransformStamped as TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

from tf2_ros.transform_broadcaster import as_list


class StaticTransformBroadcaster:
    """A publisher on ``/tf_static`` that keeps its last message for who comes later; `qos` is a profile or a depth."""

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        if qos is None:
            qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, history=HistoryPolicy.KEEP_LAST)
        self.pub_tf = node.create_publisher(TFMessage, "/tf_static", qos)
        self.net_message = TFMessage()
        self._rosidl_child_frame_ids: set[str] = set()

    def sendTransform(self, transform: Any) -> None:
        """Send one transform or several, with all that were sent before; the first of each child frame stays."""
        for one in as_list(transform):
            if one.child_frame_id not in self._rosidl_child_frame_ids:
                self._rosidl_child_frame_ids.add(one.child_frame_id)
                self.net_message.transforms.append(one)
        self.pub_tf.publish(self.net_message)
