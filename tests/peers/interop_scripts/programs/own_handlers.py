"""Handlers of the program's own, before and after init, and options that leave signals alone."""

import signal
import sys
import time

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

told = []


def before(number, frame):
    told.append(number)
    print("own handler", signal.Signals(number).name)


signal.signal(signal.SIGINT, before)
rclpy.init(signal_handler_options=SignalHandlerOptions.NO if "no" in sys.argv else None)
if "after" in sys.argv:
    signal.signal(signal.SIGINT, before)
context = rclpy.get_default_context()
context.on_shutdown(lambda: print("on_shutdown"))
node = rclpy.create_node("handlers")
print("started")
try:
    while not told:
        rclpy.spin_once(node, timeout_sec=0.05)
except (ExternalShutdownException, RCLError):  # or neither: the context is shut down by another thread of rclpy
    pass
for _ in range(0 if "no" in sys.argv or "after" in sys.argv else 200):
    if rclpy.ok():
        time.sleep(0.01)
print("ended", rclpy.ok(), len(told))
rclpy.try_shutdown()
