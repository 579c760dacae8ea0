"""Ends without ending anything: a daemon thread spins, a client waits, and main returns."""

import threading

import rclpy
from rclpy.node import Node
from std_srvs.srv import Empty

rclpy.init()
node = Node("leaves")
client = node.create_client(Empty, "nobody")
thread = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
thread.start()
asking = threading.Thread(target=client.call, args=(Empty.Request(),), daemon=True)
asking.start()
print("main ends", thread.is_alive(), asking.is_alive())
