"""Uses of nodes and endpoints after a shutdown, after a signal, and after their destruction."""

import os
import signal
import time

import rclpy
from rclpy.clock import Clock
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Empty


class Full(Node):
    def __init__(self):
        rclpy.init()
        super().__init__("full")
        self.p = self.create_publisher(String, "t", 1)
        self.s = self.create_subscription(String, "t", print, 1)
        self.c = self.create_client(Empty, "e")
        self.t = self.create_timer(1.0, print)
        self.g = self.create_guard_condition(print)


def tell(name, what):
    try:
        print(name, what())
    except Exception as error:
        print(name, type(error).__name__)


def everything(n):
    tell("publish", lambda: n.p.publish(String()))
    tell("publish bytes", lambda: n.p.publish(b"\0\1\0\0\1\0\0\0\0"))
    tell("get_subscription_count", n.p.get_subscription_count)
    tell("topic_name", lambda: (n.p.topic_name, n.s.topic_name))
    tell("wait_for_all_acked", n.p.wait_for_all_acked)
    tell("assert_liveliness", n.p.assert_liveliness)
    tell("call_async", lambda: n.c.call_async(Empty.Request()).done())
    tell("service_is_ready", n.c.service_is_ready)
    tell("wait_for_service", lambda: n.c.wait_for_service(timeout_sec=0.1))
    tell("get_topic_names_and_types", n.get_topic_names_and_types)
    tell("count_publishers", lambda: n.count_publishers("x"))
    tell("get_node_names", n.get_node_names)
    tell("wait_for_node", lambda: n.wait_for_node("x", 0.1))
    tell("get_name", n.get_name)
    tell("info", lambda: n.get_logger().info("still there"))
    tell("declare_parameter", lambda: n.declare_parameter("a", 1).value)
    tell("now", lambda: n.get_clock().now().nanoseconds > 0)
    tell("timer", lambda: (n.t.cancel(), n.t.reset(), n.t.is_ready()))
    tell("trigger", n.g.trigger)
    tell("create_publisher", lambda: n.create_publisher(String, "x", 1) and "made")
    tell("create_subscription", lambda: n.create_subscription(String, "x", print, 1) and "made")
    tell("create_client", lambda: n.create_client(Empty, "x") and "made")
    tell("create_service", lambda: n.create_service(Empty, "x", print) and "made")
    tell("resolve_topic_name", lambda: n.resolve_topic_name("x"))
    tell("destroy_subscription", lambda: n.destroy_subscription(n.s))
    tell("destroy_node", n.destroy_node)
    tell("sleep_for", lambda: Clock().sleep_for(Duration(seconds=0.01)))


print("after shutdown")
node = Full()
tell("resolve", lambda: node.resolve_topic_name("not valid"))
rclpy.shutdown()
tell("create_timer", lambda: node.create_timer(1.0, print))
tell("create_guard_condition", lambda: node.create_guard_condition(print))
everything(node)
print("after a signal")
node = Full()
os.kill(os.getpid(), signal.SIGTERM)
while rclpy.ok():
    time.sleep(0.01)
tell("create_timer", lambda: node.create_timer(1.0, print))
tell("executor", lambda: rclpy.executors.SingleThreadedExecutor.__name__)
everything(node)
rclpy.try_shutdown()
print("after destroy_node")
node = Full()
node.destroy_node()
everything(node)
rclpy.shutdown()
