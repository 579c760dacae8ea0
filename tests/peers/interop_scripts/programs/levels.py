"""Levels of loggers by the command line, and the services that change them."""

import rclpy
from rclpy.logging import get_logger
from rclpy.node import Node

rclpy.init()
node = Node("levels", enable_logger_service=True)
log = node.get_logger()


def say(when):
    for one in (log, log.get_child("child"), get_logger("other"), get_logger("third")):
        one.debug(f"{when} debug of {one.name}")
        one.info(f"{when} info")
        one.warning(f"{when} warning")


say("first")
print(log.get_effective_level().name, get_logger("other").get_effective_level().name)
timer = node.create_timer(0.02, lambda: log.debug("debug in spite of all") and timer.cancel())
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    say("last")
