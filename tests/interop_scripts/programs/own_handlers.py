"""Handlers of the program's own, before and after init, and options that leave signals alone."""

import signal
import sys

import rclpy
from rclpy.signals import SignalHandlerOptions

told = []


def before(number, frame):
    told.append(number)
    print("own handler", signal.Signals(number).name, rclpy.ok())


signal.signal(signal.SIGINT, before)
rclpy.init(signal_handler_options=SignalHandlerOptions.NO if "no" in sys.argv else None)
if "after" in sys.argv:
    signal.signal(signal.SIGINT, before)
context = rclpy.get_default_context()
context.on_shutdown(lambda: print("on_shutdown"))
node = rclpy.create_node("handlers")
print("started")
while rclpy.ok() and not told:
    rclpy.spin_once(node, timeout_sec=0.05)
print("ended", rclpy.ok(), len(told))
rclpy.try_shutdown()
