"""Names of rclpy's C extension that programs use: exceptions, enums and logging. There is no C here, and no handle."""

from __future__ import annotations

import builtins
from enum import Enum

from rosidl_py_gen import runtime

RMW_DURATION_INFINITE = 2**63 - 1
RMW_QOS_DEADLINE_BEST_AVAILABLE = RMW_QOS_LIVELINESS_LEASE_DURATION_BEST_AVAILABLE = 2**63 - 2
RCL_DEFAULT_DOMAIN_ID = 2**64 - 1


class InvalidHandle(RuntimeError):
    """Something was used after it was destroyed."""


class RCLError(RuntimeError):
    """ROS refused an operation."""


class RCLInvalidROSArgsError(RCLError):
    """What follows ``--ros-args`` cannot be read."""


class UnknownROSArgsError(RuntimeError):
    """After ``--ros-args`` stands what ROS does not know."""


class NodeNameNonExistentError(RCLError):
    """A node was asked about that is not in the graph."""


class UnsupportedEventTypeError(RCLError):
    """The middleware has no such event."""


class NotImplementedError(builtins.NotImplementedError):
    """The middleware has no such feature."""


class RCUtilsError(RuntimeError):
    """A name of a severity, or a level, that does not exist."""


class RMWError(RuntimeError):
    """The middleware refused an operation."""


class ScopedEnumOfC(Enum):
    """An enumeration of C++, printed with the name of its class. It has a number and is none: it equals no number."""

    value: int

    def __int__(self) -> int:
        return self.value

    def __index__(self) -> int:
        return self.value

    def __str__(self) -> str:
        return f"{type(self).__name__}.{self.name}"


class EnumOfC(ScopedEnumOfC):
    """An enumeration of C; it equals its number, and so a member of an `IntEnum`."""

    def __eq__(self, other: object) -> bool:
        return self is other if isinstance(other, Enum) and not isinstance(other, int) else self.value == other

    def __hash__(self) -> int:
        return hash(self.value)


class ClockType(EnumOfC):
    """The kind of clock, as times have it; `rclpy.clock_type.ClockType` is what programs give."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3


class ClockChange(EnumOfC):
    """The change of a clock's source, as callbacks get it; `rclpy.clock.ClockChange` has the same numbers."""

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4


class rmw_qos_policy_kind_t(EnumOfC):  # as in C
    """The policy that two endpoints disagree on, as events have it; `rclpy.qos.QoSPolicyKind` has the same numbers."""

    RMW_QOS_POLICY_INVALID = 1
    RMW_QOS_POLICY_DURABILITY = 2
    RMW_QOS_POLICY_DEADLINE = 4
    RMW_QOS_POLICY_LIVELINESS = 8
    RMW_QOS_POLICY_RELIABILITY = 16
    RMW_QOS_POLICY_HISTORY = 32
    RMW_QOS_POLICY_LIFESPAN = 64
    RMW_QOS_POLICY_DEPTH = 128
    RMW_QOS_POLICY_LIVELINESS_LEASE_DURATION = 256
    RMW_QOS_POLICY_AVOID_ROS_NAMESPACE_CONVENTIONS = 512


class QoSCompatibility(EnumOfC):
    """The verdict of `rclpy.qos.qos_check_compatible`."""

    OK = 0
    WARNING = 1
    ERROR = 2


class TransitionCallbackReturnType(ScopedEnumOfC):
    """What the callback of a lifecycle transition answers; numbers of lifecycle_msgs/Transition."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99

    def to_label(self) -> str:
        """The transition that follows."""
        return f"transition_{self.name.lower()}"


def rclpy_logging_rcutils_log(
    severity: int, name: str, message: str, function_name: str, file_path: str, line_number: int, /
) -> None:
    """Log a message as coming from a place in a file, without the filters of `RcutilsLogger`."""
    if not isinstance(message, str):
        raise TypeError(f"rclpy_logging_rcutils_log: expected a str as message, got {message!r:.100}")
    logger = runtime.get_logger(name)
    if severity and logger.isEnabledFor(severity):
        site = (str(file_path), int(line_number))
        logger.handle(logger.makeRecord(logger.name, int(severity), *site, message, (), None, str(function_name)))


def rclpy_logging_set_logger_level(name: str, level: int, detailed_error: bool = False) -> None:
    """Set the level of a logger; the root, without a level, logs everything."""
    if name or level:
        runtime.set_logger_level(name, int(level))
    else:
        runtime.get_logger("").setLevel(1)  # 0 would be that of Python's root logger


def rclpy_logging_get_logger_effective_level(name: str, /) -> int:
    """Return the severity from which on a logger logs."""
    return _severity(runtime.get_logger(name).getEffectiveLevel())


def rclpy_logging_get_logger_level(name: str, /) -> int:
    """Return the level that was set, 0 for none."""
    return _severity(runtime.get_logger_level(name))


def _severity(level: int) -> int:
    return min(level // 10 * 10, 50)  # programs may have set others by Python's `logging`


def rclpy_logging_logger_is_enabled_for(name: str, severity: int, /) -> bool:
    """Return True if a logger would log at a severity."""
    return runtime.get_logger(name).isEnabledFor(severity)


def rclpy_logging_severity_level_from_string(severity: str, /) -> int:
    """Return the number of ``INFO`` or ``info``."""
    known = ("UNSET", "DEBUG", "INFO", "WARN", "ERROR", "FATAL")
    if severity.upper() not in known:
        raise RuntimeError(f"unknown severity {severity!r:.100}; expected one of {', '.join(known)}")
    return known.index(severity.upper()) * 10


def rclpy_logging_get_logging_directory() -> str:
    """Return the folder of log files."""
    return str(runtime.get_logging_directory())
