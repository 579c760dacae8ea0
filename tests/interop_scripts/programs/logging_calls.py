"""Log calls: levels, once, throttled, children, wrong arguments."""

import rclpy
from rclpy.logging import LoggingSeverity, get_logger

rclpy.init()
node = rclpy.create_node("logs")
log = node.get_logger()
for number in range(3):
    log.info(f"every {number}")
    log.info("once", once=True)
    log.warning("skipped", skip_first=True)
    log.error("throttled", throttle_duration_sec=100.0)
log.debug("not shown")
log.set_level(LoggingSeverity.DEBUG)
log.debug("shown")
log.fatal("fatal")
log.get_child("child").warn("child")
get_logger("alone").info("alone")
print(log.get_effective_level(), log.is_enabled_for(LoggingSeverity.DEBUG), log.info("answer"), log.name)
for wrong in (lambda: log.info(3), lambda: log.info("x", nothing=True), lambda: log.info("%s", "x")):
    try:
        wrong()
    except Exception as error:
        print(type(error).__name__)
node.destroy_node()
rclpy.shutdown()
