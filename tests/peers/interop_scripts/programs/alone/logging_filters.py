"""Filters of log calls in loops and functions: once, skip_first, throttle with clocks; refused combinations."""

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.logging import LoggingSeverity, get_logger, get_logger_level, get_logging_severity_from_string, set_logger_level

rclpy.init()
node = rclpy.create_node("filters", namespace="deep/er")
log = node.get_logger()
print(log.name, log.get_child("a").get_child("b").name)
steady = Clock(clock_type=ClockType.STEADY_TIME)


def often(number):
    return (
        log.info(f"once {number}", once=True),
        log.info(f"skip {number}", skip_first=True),
        log.info(f"both {number}", once=True, skip_first=True),
        log.warn(f"throttled {number}", throttle_duration_sec=1000),
        log.warning(f"throttled too {number}", throttle_duration_sec=1e-9),
        log.error(f"by clock {number}", throttle_duration_sec=1000, throttle_time_source_type=steady),
    )


for number in range(3):
    print(often(number))
log.debug("not shown")
log.fatal("fatal")
log.log("by number", LoggingSeverity.ERROR)
log.set_level(LoggingSeverity.ERROR)
print(log.warning("quiet"), log.error("loud"), log.get_effective_level(), get_logger_level(log.name))
print(log.get_child("x").get_effective_level(), log.get_child("x").info("quiet"), get_logger("other").is_enabled_for(LoggingSeverity.INFO))
set_logger_level("other", LoggingSeverity.FATAL)
print(get_logger("other").error("quiet"), get_logger("other").get_child("c").error("quiet"))
log.set_level(LoggingSeverity.UNSET)
print(log.get_effective_level(), get_logging_severity_from_string("WARN"))
for wrong in (
    lambda: log.info("x", throttle_duration_sec=0),
    lambda: log.info("x", throttle_time_source_type="ROS"),
    lambda: log.info("x", once=True, nothing=1),
    lambda: log.info(None),
    lambda: log.log("x", 3),
    lambda: log.info(),
    lambda: log.set_level("nothing"),
    lambda: get_logger("").info("root"),
    lambda: get_logger("x").get_child(""),
    lambda: get_logging_severity_from_string("nothing"),
    lambda: [log.info("changes", once=n) for n in (True, False)],
):
    try:
        print(wrong())
    except Exception as error:
        print(type(error).__name__)
log.info("100% {} done\nsecond line")
node.destroy_node()
rclpy.shutdown()
