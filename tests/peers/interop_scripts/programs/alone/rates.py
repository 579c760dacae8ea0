"""Rates in a thread: sleeping while another thread spins, destroyed, and ended by shutdown."""

import threading

import rclpy
from rclpy.exceptions import ROSInterruptException

rclpy.init()
node = rclpy.create_node("rates")
executor = rclpy.executors.SingleThreadedExecutor()
executor.add_node(node)
thread = threading.Thread(target=executor.spin)
thread.start()
for wrong in (0, -1, None):
    try:
        node.create_rate(wrong)
    except Exception as error:
        print(wrong, type(error).__name__)
rate = node.create_rate(50)
start = node.get_clock().now()
for _ in range(5):
    rate.sleep()
passed = (node.get_clock().now() - start).nanoseconds / 1e9
print(0.06 < passed < 30, passed > 60)
print(node.destroy_rate(rate))
try:
    rate.sleep()
except RuntimeError as error:
    print(type(error).__name__, error)
slow = node.create_rate(0.001)
ended = []


def sleep():
    try:
        slow.sleep()
    except ROSInterruptException as error:
        ended.append(type(error).__name__)


sleeper = threading.Thread(target=lambda: (sleep(), sleep()))
sleeper.start()
executor.create_task(lambda: rclpy.shutdown())
sleeper.join(10)
thread.join(10)
print(ended, thread.is_alive(), rclpy.ok())
