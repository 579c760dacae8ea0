"""A subscription with a sensor's quality of service, which ends the program; signals as they come."""

import sys

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from std_msgs.msg import String

rclpy.init(args=sys.argv)
node = rclpy.create_node("listener", namespace="/ns")
qos = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=5,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.VOLATILE,
)


def heard(msg):
    node.get_logger().warn("heard " + msg.data)
    print(repr(msg), subscription.topic_name, sep=" ")
    if msg.data == "end":
        raise SystemExit(3)


subscription = node.create_subscription(String, "/chatter", heard, qos)
other = node.create_subscription(String, "sensor", heard, qos_profile_sensor_data)
assert isinstance(node, Node)
rclpy.spin(node)
