"""Types of clocks, as in rclpy: `ClockType`."""

from enum import IntEnum


class ClockType(IntEnum):
    """Type of a clock, with the numbers of rcl."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3
