"""Broadcaster of static transforms."""

from typing import Any

from geometry_msgs.msg import TransformStamped as TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

from tf2_ros.transform_broadcaster import as_list


class StaticTransformBroadcaster:
    """Publisher on ``/tf_static`` for transforms that are valid at all times; `qos` is a profile or a depth."""

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        if qos is None:
            qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, history=HistoryPolicy.KEEP_LAST)
        self.pub_tf = node.create_publisher(TFMessage, "/tf_static", qos)
        self.net_message = TFMessage()
        self._rosidl_child_frame_ids: set[str] = set()

    def sendTransform(self, transform: Any) -> None:
        """Publish transforms, together with all earlier ones; the first one of each child frame is retained."""
        for item in as_list(transform):
            if item.child_frame_id not in self._rosidl_child_frame_ids:
                self._rosidl_child_frame_ids.add(item.child_frame_id)
                self.net_message.transforms.append(item)
        self.pub_tf.publish(self.net_message)
