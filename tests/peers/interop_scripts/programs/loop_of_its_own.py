"""while rclpy.ok() with time.sleep; Ctrl-C comes as KeyboardInterrupt inside of it, and the context is down."""

import time

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("sleeper")
publisher = node.create_publisher(String, "beat", 10)
print("started")
try:
    while rclpy.ok():
        try:
            publisher.publish(String(data="beat"))
        except RCLError:  # the other thread has shut the context down since `ok`
            break
        time.sleep(0.05)
    print("left")
except KeyboardInterrupt:
    print("interrupted")
for _ in range(100):  # the context is shut down by another thread of rclpy, a moment later
    if rclpy.ok():
        time.sleep(0.01)
try:
    publisher.publish(String(data="after"))
    print("published")
except Exception as error:
    print(type(error).__name__)
try:
    node.create_publisher(String, "x", 1)
except Exception as error:
    print(type(error).__name__)
node.destroy_node()
rclpy.try_shutdown()
try:
    rclpy.shutdown()
except RuntimeError as error:
    print(isinstance(error, RuntimeError))
