"""Errors without a context, repeated and after `init`."""

import rclpy
from std_msgs.msg import String


def tell(what):
    try:
        print(what())
    except Exception as error:
        print([base.__name__ for base in type(error).__mro__][:2])


tell(lambda: rclpy.create_node("a"))
tell(rclpy.shutdown)
tell(rclpy.ok)
rclpy.init()
tell(rclpy.init)
node = rclpy.create_node("a")
tell(lambda: rclpy.create_node("not valid"))
tell(lambda: node.create_publisher(String, "not valid", 10))
tell(lambda: node.create_publisher(String, "a", -1))
tell(lambda: node.create_publisher(String, "a", "10"))
tell(lambda: node.create_publisher(str, "a", 10))
publisher = node.create_publisher(String, "a", 10)
tell(lambda: publisher.publish("text"))
tell(lambda: node.create_timer("1", print))
tell(lambda: node.destroy_publisher(publisher))
tell(lambda: node.destroy_publisher(publisher))
tell(lambda: publisher.publish(String()))
node.destroy_node()
tell(lambda: node.create_publisher(String, "a", 10))
rclpy.shutdown()
tell(rclpy.shutdown)
tell(rclpy.try_shutdown)
tell(lambda: rclpy.create_node("b"))
rclpy.init()
tell(rclpy.ok)
rclpy.shutdown()
