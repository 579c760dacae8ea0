"""A callback that publishes, attributes named like the node's own, and a subscription destroyed later."""

import rclpy
from rclpy.node import Node
from std_msgs.msg import Int32


class Relay(Node):
    def __init__(self):
        super().__init__("relay")
        self.logger = self.get_logger()
        self.name, self.clock, self._timers, self._lock = "own", None, [], None
        self.pub = self.create_publisher(msg_type=Int32, topic="out", qos_profile=10)
        self.sub = self.create_subscription(msg_type=Int32, topic="in", callback=self.on, qos_profile=10)

    def on(self, msg):
        self.pub.publish(Int32(data=10 * msg.data))
        self.logger.info(f"{msg.data}")


rclpy.init()
relay = Relay()
print(relay.get_name(), relay.get_namespace(), relay.get_fully_qualified_name())
try:
    rclpy.spin(relay)
except KeyboardInterrupt:
    print("destroyed", relay.destroy_subscription(relay.sub), relay.destroy_publisher(relay.pub))
    relay.destroy_node()
    relay.destroy_node()
    try:
        rclpy.shutdown()
    except Exception as error:
        print(type(error).__name__)
