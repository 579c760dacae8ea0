"""What programs take from rclpy's C extension by name: its exceptions and enums. There is no C here, and no handle."""

from __future__ import annotations

import builtins
from enum import IntEnum

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


class EnumOfC(IntEnum):
    """What is printed with its name, as C's enumerations are; those of Python are numbers there from 3.11 on."""

    def __str__(self) -> str:
        return f"{type(self).__name__}.{self.name}"

    def __format__(self, spec: str) -> str:
        return format(str(self), spec)


class QoSCompatibility(EnumOfC):
    """The verdict of `rclpy.qos.qos_check_compatible`."""

    OK = 0
    WARNING = 1
    ERROR = 2


class TransitionCallbackReturnType(EnumOfC):
    """What the callback of a lifecycle transition answers; numbers of lifecycle_msgs/Transition."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99

    def to_label(self) -> str:
        """The transition that follows."""
        return f"transition_{self.name.lower()}"
