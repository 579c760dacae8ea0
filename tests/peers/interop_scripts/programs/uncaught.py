"""spin, and nothing caught."""

import rclpy
from rclpy.node import Node

rclpy.init()
node = Node("uncaught")
print("started")
rclpy.spin(node)
print("never")
