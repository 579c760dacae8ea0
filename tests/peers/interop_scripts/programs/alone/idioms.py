"""Common idioms: nodes and endpoints without a variable, repeated calls, calls after the end."""

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger


def tell(what):
    try:
        print(what())
    except Exception as error:
        print(type(error).__name__)


class Garbage(Node):
    count = 0

    def __init__(self):
        super().__init__("garbage")
        self.create_subscription(String, "loop", self.heard, 10)
        self.create_timer(0.02, lambda pub=self.create_publisher(String, "loop", 10): pub.publish(String(data="x")))

    def heard(self, msg):
        Garbage.count += 1
        if Garbage.count == 3:
            raise SystemExit


rclpy.init()
try:
    rclpy.spin(Garbage())
except SystemExit:
    print("heard", Garbage.count)
tell(rclpy.init)
rclpy.shutdown()
tell(rclpy.shutdown)
tell(rclpy.try_shutdown)
rclpy.init(args=None)
print(rclpy.ok())
node = Node("used")
publisher = node.create_publisher(String, "x", 10)
subscription = node.create_subscription(String, "x", print, 10)
service = node.create_service(Trigger, "s", print)
client = node.create_client(Trigger, "s")
timer = node.create_timer(1.0, print)
same_name = Node("used", enable_rosout=False)
print(same_name.get_fully_qualified_name())
tell(lambda: node.destroy_subscription(publisher))
tell(subscription.destroy)
tell(subscription.destroy)
node.destroy_node()
tell(node.destroy_node)
tell(lambda: publisher.publish(String()))
tell(publisher.get_subscription_count)
tell(lambda: publisher.topic_name)
tell(timer.cancel)
tell(lambda: client.call_async(Trigger.Request()))
tell(client.service_is_ready)
tell(lambda: node.get_name())
tell(lambda: node.get_logger().info("after"))
tell(lambda: node.get_clock().now().nanoseconds > 0)
tell(lambda: node.declare_parameter("late", 1).value)
tell(lambda: rclpy.spin_once(node, timeout_sec=0.1))
tell(lambda: rclpy.spin_once(same_name, timeout_sec=0))
rclpy.shutdown()
tell(lambda: same_name.create_publisher(String, "x", 10))
tell(same_name.get_name)
tell(same_name.destroy_node)
with rclpy.context.Context() as context:
    tell(lambda: rclpy.init(context=context))
    print(context.ok(), rclpy.ok(), rclpy.ok(context=context))
    own = rclpy.create_node("own", context=context)
    tell(lambda: own.context is context)
    own.destroy_node()
print(context.ok())
tell(lambda: rclpy.init(domain_id=-1))
tell(lambda: rclpy.init(args=["x", "--ros-args", "--no-such-flag"]))
tell(rclpy.ok)
