"""An exception of a callback leaves spin_once, and the node stays usable; the next one ends the program."""

import rclpy
from std_msgs.msg import Int32

rclpy.init()
node = rclpy.create_node("fails")


def on(msg):
    print("got", msg.data)
    print(1 / (msg.data - 1))


node.create_subscription(Int32, "in", on, 10)
try:
    rclpy.spin(node)
except ZeroDivisionError as error:
    print("caught", error)


def end():
    raise RuntimeError("the end")


node.create_timer(2.0, end)
rclpy.spin(node)
