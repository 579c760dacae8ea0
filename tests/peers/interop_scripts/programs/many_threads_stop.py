"""A MultiThreadedExecutor stopped by a signal; finally, as people write it."""

import rclpy
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Int32


class Minimal(Node):
    def __init__(self):
        super().__init__("minimal")
        self.sub = self.create_subscription(Int32, "in", self.on, 10)
        self.pub = self.create_publisher(Int32, "out", 10)

    def on(self, msg):
        self.pub.publish(Int32(data=-msg.data))


def main(args=None):
    rclpy.init(args=args)
    node = Minimal()
    executor = MultiThreadedExecutor(num_threads=2)
    executor.add_node(node)
    try:
        print("Beginning client, shut down with CTRL-C")
        executor.spin()
        print("returned")
    except KeyboardInterrupt:
        print("Keyboard interrupt, shutting down.")
    except ExternalShutdownException:
        print("external")
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()


main()
