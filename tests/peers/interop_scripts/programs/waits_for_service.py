"""The tutorials' loop that waits for a server, and a signal meanwhile."""

import rclpy
from rclpy.node import Node
from std_srvs.srv import Empty


class Waiting(Node):
    def __init__(self):
        super().__init__("waiting")
        self.cli = self.create_client(Empty, "nobody")
        said = False
        while not self.cli.wait_for_service(timeout_sec=0.3):
            if not said:
                self.get_logger().info("service not available, waiting again...")
            said = True


rclpy.init()
try:
    Waiting()
except KeyboardInterrupt:
    print("interrupted")
except Exception as error:
    print(type(error).__name__)
