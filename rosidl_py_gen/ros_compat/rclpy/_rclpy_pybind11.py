"""Exceptions, enums and logging functions that programs use from rclpy's C extension, all of them written in Python."""

from __future__ import annotations

import builtins
from enum import Enum
from typing import Any

from rosidl_py_gen import runtime
from rosidl_py_gen.runtime import QoSPolicyKind

RMW_DURATION_INFINITE = 2**63 - 1
RMW_QOS_DEADLINE_BEST_AVAILABLE = RMW_QOS_LIVELINESS_LEASE_DURATION_BEST_AVAILABLE = 2**63 - 2
RCL_DEFAULT_DOMAIN_ID = 2**64 - 1


class InvalidHandle(RuntimeError):
    """Raised when an entity is used after it was destroyed."""


class RCLError(RuntimeError):
    """Raised when ROS refuses an operation."""


class TimerCancelledError(RCLError):
    """Raised by rclpy 10 for the call of a cancelled timer; never raised by this package."""


class RCLInvalidROSArgsError(RCLError):
    """Raised when the arguments after ``--ros-args`` cannot be parsed."""


class UnknownROSArgsError(RuntimeError):
    """Raised when an argument after ``--ros-args`` is unknown."""


class NodeNameNonExistentError(RCLError):
    """Raised when a requested node is not in the graph."""


class UnsupportedEventTypeError(RCLError):
    """Raised when the middleware does not report a kind of event."""


class NotImplementedError(builtins.NotImplementedError):
    """Raised when the middleware does not have a feature; a subclass of Python's exception of this name."""


class RCUtilsError(RuntimeError):
    """Raised for an unknown severity or logger level."""


class RMWError(RuntimeError):
    """Raised when the middleware refuses an operation."""


class ScopedEnumOfC(Enum):
    """Base of enumerations that are scoped enums in C++: members convert to integers, but do not equal them."""

    value: int

    def __int__(self) -> int:
        return self.value

    def __index__(self) -> int:
        return self.value

    def __str__(self) -> str:
        return f"{type(self).__name__}.{self.name}"


class EnumOfC(ScopedEnumOfC):
    """Base of enumerations that are enums in C: members equal their numbers, and therefore members of an `IntEnum` with
    these numbers.
    """

    def __eq__(self, other: object) -> bool:
        return self is other if isinstance(other, Enum) and not isinstance(other, int) else self.value == other

    def __hash__(self) -> int:
        return hash(self.value)


class ClockType(EnumOfC):
    """Type of a clock in the C extension; programs pass `rclpy.clock_type.ClockType`."""

    UNINITIALIZED = 0
    ROS_TIME = 1
    SYSTEM_TIME = 2
    STEADY_TIME = 3


class ClockChange(EnumOfC):
    """Change of the source of a clock's time, which jump callbacks receive.

    `rclpy.clock.ClockChange` has the same numbers.
    """

    ROS_TIME_NO_CHANGE = 1
    ROS_TIME_ACTIVATED = 2
    ROS_TIME_DEACTIVATED = 3
    SYSTEM_TIME_NO_CHANGE = 4


rmw_qos_policy_kind_t: Any = EnumOfC(  # type: ignore[call-arg]
    "rmw_qos_policy_kind_t", {f"RMW_QOS_POLICY_{kind.name}": kind.value for kind in QoSPolicyKind}, module=__name__
)
"""QoS policy that makes two endpoints incompatible, named as in C, with the numbers of `rclpy.qos.QoSPolicyKind`."""


class QoSCompatibility(EnumOfC):
    """Result of `rclpy.qos.qos_check_compatible`."""

    OK = 0
    WARNING = 1
    ERROR = 2


class TransitionCallbackReturnType(ScopedEnumOfC):
    """Result of the callback of a lifecycle transition, with the numbers of lifecycle_msgs/Transition."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99

    def to_label(self) -> str:
        """Return the label of the lifecycle transition that follows a callback with this result."""
        return f"transition_{self.name.lower()}"


def rclpy_logging_rcutils_log(
    severity: int, name: str, message: str, function_name: str, file_path: str, line_number: int, /
) -> None:
    """Log a message with the given call site, without the options of `RcutilsLogger` such as `once`."""
    if not isinstance(message, str):
        raise TypeError(f"rclpy_logging_rcutils_log: expected a str as message, got {message!r:.100}")
    logger = runtime.get_logger(name)
    if severity and logger.isEnabledFor(severity):
        site = (str(file_path), int(line_number))
        logger.handle(logger.makeRecord(logger.name, int(severity), *site, message, (), None, str(function_name)))


def rclpy_logging_set_logger_level(name: str, level: int, detailed_error: bool = False) -> None:
    """Set the level of a logger; level 0 of the root logger enables all records."""
    if name or level:
        runtime.set_logger_level(name, int(level))
    else:
        runtime.get_logger("").setLevel(1)  # 0 would inherit the level of Python's root logger


def rclpy_logging_get_logger_effective_level(name: str, /) -> int:
    return _severity(runtime.get_logger(name).getEffectiveLevel())


def rclpy_logging_get_logger_level(name: str, /) -> int:
    """Return the level that was set for a logger, 0 if none was set."""
    return _severity(runtime.get_logger_level(name))


def _severity(level: int) -> int:
    return min(level // 10 * 10, 50)  # programs may set other levels by Python's `logging`


def rclpy_logging_logger_is_enabled_for(name: str, severity: int, /) -> bool:
    return runtime.get_logger(name).isEnabledFor(severity)


def rclpy_logging_severity_level_from_string(severity: str, /) -> int:
    """Return the number of a severity by its name, in upper or lower case; raise RuntimeError for an unknown name."""
    names = ("UNSET", "DEBUG", "INFO", "WARN", "ERROR", "FATAL")
    if severity.upper() not in names:
        raise RuntimeError(f"unknown severity {severity!r:.100}; expected one of {', '.join(names)}")
    return names.index(severity.upper()) * 10


def rclpy_logging_get_logging_directory() -> str:
    return str(runtime.get_logging_directory())
