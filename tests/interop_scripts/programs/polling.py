"""A main loop of its own with spin_once and time.sleep."""

import time

import rclpy
from std_msgs.msg import Int32

rclpy.init()
node = rclpy.create_node("polling")
total, seen = 0, []


def on(msg):
    global total
    total += msg.data
    seen.append(msg.data)
    time.sleep(0.01)  # stands for work


node.create_subscription(Int32, "in", on, 10)
while rclpy.ok() and len(seen) < 5:
    rclpy.spin_once(node, timeout_sec=0)
    time.sleep(0.005)
print("sum", total, seen, flush=True)
until = time.time() + 3
while time.time() < until:
    rclpy.spin_once(node, timeout_sec=0.1)
rclpy.shutdown()
print(rclpy.ok())
