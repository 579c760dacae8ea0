"""Names: private, absolute, with the node's name, remapped for one node, and what becomes of them."""

import sys

import rclpy
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from std_msgs.msg import String
from std_srvs.srv import Empty

rclpy.init(args=sys.argv)
print(remove_ros_args(sys.argv)[1:], remove_ros_args(args=["a", "--ros-args", "-r", "x:=y", "--", "b"]))
first = Node("first")
second = Node("second", namespace="given", cli_args=["--ros-args", "-r", "own:=only_second", "-p", "here:=1"])
third = Node("third", use_global_arguments=False)
for node in (first, second, third):
    topics = [node.create_publisher(String, name, 1) for name in ("plain", "~/private", "/absolute", "{node}/sub", "own")]
    service = node.create_service(Empty, "~/reset", lambda request, response: response)
    print(node.get_fully_qualified_name(), [topic.topic_name for topic in topics], service.service_name)
    print([node.resolve_topic_name(name) for name in ("plain", "~/private")])
    print(node.resolve_topic_name("plain", only_expand=True), node.get_logger().name)
print(second.declare_parameter("here", 0).value, first.declare_parameter("here", 0).value)
executor = rclpy.executors.SingleThreadedExecutor()
for node in (first, second, third):
    executor.add_node(node)
try:
    executor.spin()
except KeyboardInterrupt:
    pass
