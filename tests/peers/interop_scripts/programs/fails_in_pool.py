"""An exception in a callback of a MultiThreadedExecutor comes out of spin, later."""

import rclpy
from rclpy.executors import MultiThreadedExecutor

rclpy.init()
node = rclpy.create_node("pool")
failing = [lambda: {}["missing"]]
timer = node.create_timer(0.01, lambda: failing and failing.pop()())
executor = MultiThreadedExecutor(num_threads=2)
executor.add_node(node)
try:
    executor.spin()
except KeyError as error:
    print("caught", error)
failing.append(lambda: [][1])
rclpy.spin(node, executor=executor)
