"""A thread that spins, rates, and a main thread that publishes."""

import threading

import rclpy
from rclpy.node import Node
from std_msgs.msg import Int32

rclpy.init()
node = Node("threads")
publisher = node.create_publisher(Int32, "count", 10)


def spin():
    try:
        rclpy.spin(node)
    except rclpy.executors.ExternalShutdownException:
        pass  # or it returns, when it looked just after the rate's timer


thread = threading.Thread(target=spin, daemon=True)
thread.start()
rate = node.create_rate(20)
number = 0
try:
    while rclpy.ok():
        if publisher.get_subscription_count() and number < 3:
            number += 1
            publisher.publish(Int32(data=number))
        rate.sleep()
except (KeyboardInterrupt, rclpy.exceptions.ROSInterruptException):
    thread.join()
    print("ended", number)
