"""The profiles that ROS has names for, to be given as they are or changed: ``SENSOR_DATA.keep_last(1)``."""

from rosidl_py_gen.runtime.transport.qos import (
    ACTION_STATUS,
    BEST_AVAILABLE,
    CLOCK,
    DEFAULT,
    PARAMETER_EVENTS,
    PARAMETERS,
    ROSOUT,
    SENSOR_DATA,
    SERVICES_DEFAULT,
    SYSTEM_DEFAULT,
)

__all__ = [
    "ACTION_STATUS",
    "BEST_AVAILABLE",
    "CLOCK",
    "DEFAULT",
    "PARAMETERS",
    "PARAMETER_EVENTS",
    "ROSOUT",
    "SENSOR_DATA",
    "SERVICES_DEFAULT",
    "SYSTEM_DEFAULT",
]
