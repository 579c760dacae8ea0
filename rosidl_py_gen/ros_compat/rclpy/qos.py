"""Quality of service: policies, profiles, and whether two profiles match."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from enum import Enum, IntEnum
from typing import Any, TypeVar, Union  # noqa: F401

from rclpy._rclpy_pybind11 import RMW_QOS_DEADLINE_BEST_AVAILABLE, QoSCompatibility
from rclpy.duration import Duration
from rclpy.impl._fields import Checked
from rosidl_py_gen import runtime
from rosidl_py_gen.runtime import QoSPolicyKind as QoSPolicyKind
from rosidl_py_gen.runtime import qos as presets

_P = TypeVar("_P", bound=IntEnum)


def qos_policy_name_from_kind(policy_kind: QoSPolicyKind | int) -> str:
    """``'LIVELINESS'`` for 8; ValueError for a number that is none."""
    return QoSPolicyKind(policy_kind).name


class InvalidQoSProfileException(Exception):
    """A profile that lacks a history or a depth."""

    def __init__(self, *args: object) -> None:
        super().__init__("Invalid QoSProfile", *args)


class QoSPolicyEnum(IntEnum):
    """A policy, with the lower-case names that command lines use."""

    @classmethod
    def short_keys(cls) -> list[str]:
        """All names in lower case."""
        return [key.lower() for key in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> int:
        """The number of a name in any case; KeyError for an unknown one."""
        return int(cls[name.upper()].value)

    @property
    def short_key(self) -> str:
        """The name in lower case."""
        return self.name.lower()


class _OldName:
    """A name of a policy from before Foxy; says so when it is used."""

    def __init__(self, old: str, new: str) -> None:
        self._old, self._new = old, new

    def __get__(self, instance: object, owner: Any) -> Any:
        text = f"{owner.__name__}.{self._old} is deprecated. Use {owner.__name__}.{self._new} instead."
        warnings.warn(text, stacklevel=2)
        return owner[self._new]


def _with_old_names(prefix: str, *names: str, **others: str) -> Callable[[type[_P]], type[_P]]:
    def add(policy: type[_P]) -> type[_P]:
        for old, new in {**{prefix + name: name for name in names}, **others}.items():
            setattr(policy, old, _OldName(old, new))
        return policy

    return add


@_with_old_names("RMW_QOS_POLICY_HISTORY_", "SYSTEM_DEFAULT", "KEEP_LAST", "KEEP_ALL", "UNKNOWN")
class HistoryPolicy(QoSPolicyEnum):
    """How many messages are kept; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


@_with_old_names("RMW_QOS_POLICY_RELIABILITY_", "SYSTEM_DEFAULT", "RELIABLE", "BEST_EFFORT", "UNKNOWN")
class ReliabilityPolicy(QoSPolicyEnum):
    """Whether lost messages are sent again; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


@_with_old_names("RMW_QOS_POLICY_DURABILITY_", "SYSTEM_DEFAULT", "TRANSIENT_LOCAL", "VOLATILE", "UNKNOWN")
class DurabilityPolicy(QoSPolicyEnum):
    """Whether those who come late get earlier messages; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


@_with_old_names(
    "RMW_QOS_POLICY_LIVELINESS_",
    "SYSTEM_DEFAULT",
    "AUTOMATIC",
    "MANUAL_BY_TOPIC",
    RMW_QOS_POLICY_DURABILITY_UNKNOWN="UNKNOWN",  # rclpy's slip of the pen
)
class LivelinessPolicy(QoSPolicyEnum):
    """Who says that a publisher is alive; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


QoSHistoryPolicy = HistoryPolicy
QoSReliabilityPolicy = ReliabilityPolicy
QoSDurabilityPolicy = DurabilityPolicy
QoSLivelinessPolicy = LivelinessPolicy


class _RuntimeProfile(runtime.QoSProfile):
    """A profile for the runtime that can tell what it was made of."""

    __slots__ = ()

    def to_dict(self) -> dict[str, Any]:
        """The arguments of `QoSProfile`."""
        made = QoSProfile._rosidl_from_runtime(self)
        return {name: getattr(made, name) for name in _FIELDS}


_FIELDS = (
    "history",  # before depth, which looks at it
    "depth",
    "reliability",
    "durability",
    "lifespan",
    "deadline",
    "liveliness",
    "liveliness_lease_duration",
    "avoid_ros_namespace_conventions",
)
"""In the order in which rclpy shows them."""


class QoSProfile:
    """Quality of service of an endpoint; fields can be set, too.

    Needs a `history`, a `depth`, or both: InvalidQoSProfileException. AssertionError for unknown fields, wrong types.
    """

    __slots__ = tuple(f"_{name}" for name in _FIELDS)

    history = Checked[HistoryPolicy](int, made=HistoryPolicy)
    reliability = Checked[ReliabilityPolicy](int, made=ReliabilityPolicy)
    durability = Checked[DurabilityPolicy](int, made=DurabilityPolicy)
    liveliness = Checked[LivelinessPolicy](int, made=LivelinessPolicy)
    lifespan = Checked[Duration](Duration)
    deadline = Checked[Duration](Duration)
    liveliness_lease_duration = Checked[Duration](Duration)
    avoid_ros_namespace_conventions = Checked[bool](bool)

    def __init__(self, **kwargs: Any) -> None:
        if not kwargs.keys() <= _DEFAULTS.keys():
            raise AssertionError(f"Invalid arguments passed to constructor: {kwargs.keys()!r}")
        if "history" not in kwargs:
            if "depth" not in kwargs:
                raise InvalidQoSProfileException("History and/or depth settings are required.")
            kwargs["history"] = HistoryPolicy.KEEP_LAST
        if kwargs["history"] == HistoryPolicy.KEEP_LAST and "depth" not in kwargs:
            raise InvalidQoSProfileException("History set to KEEP_LAST without a depth setting.")
        for name, default in _DEFAULTS.items():
            setattr(self, name, kwargs.get(name, default))

    @property
    def depth(self) -> int:
        """How many messages KEEP_LAST keeps; 0 is what the middleware has by default, and warned of."""
        return self._depth

    @depth.setter
    def depth(self, value: int) -> None:
        if not isinstance(value, int):
            raise AssertionError(f"depth must be int, got {value!r:.100}")
        if value == 0 and self.history == HistoryPolicy.KEEP_LAST:
            text = (
                "A zero depth with KEEP_LAST doesn't make sense; no data could be stored. "
                "This will be interpreted as SYSTEM_DEFAULT"
            )
            warnings.warn(text, stacklevel=2)
        self._depth = value

    def get_c_qos_profile(self) -> _RuntimeProfile:
        """The profile as rosidl_py_gen has it: there is no C structure here.

        Raises `rosidl_py_gen.runtime.InvalidQoSError`, a ValueError, for numbers out of range.
        """
        return _RuntimeProfile(
            history=runtime.History(self.history),
            depth=int(self.depth),
            reliability=runtime.Reliability(self.reliability),
            durability=runtime.Durability(self.durability),
            lifespan_ns=self.lifespan.nanoseconds,
            deadline_ns=self.deadline.nanoseconds,
            liveliness=runtime.Liveliness(self.liveliness),
            liveliness_lease_ns=self.liveliness_lease_duration.nanoseconds,
            avoid_ros_namespace_conventions=self.avoid_ros_namespace_conventions,
        )

    @classmethod
    def _rosidl_from_runtime(cls, profile: runtime.QoSProfile) -> QoSProfile:
        """The other way of `get_c_qos_profile`, without a warning for depth 0."""
        made = cls(depth=1)
        made.history = HistoryPolicy(profile.history)
        made._depth = profile.depth
        made.reliability = ReliabilityPolicy(profile.reliability)
        made.durability = DurabilityPolicy(profile.durability)
        made.lifespan = Duration(nanoseconds=profile.lifespan_ns)
        made.deadline = Duration(nanoseconds=profile.deadline_ns)
        made.liveliness = LivelinessPolicy(profile.liveliness)
        made.liveliness_lease_duration = Duration(nanoseconds=profile.liveliness_lease_ns)
        made.avoid_ros_namespace_conventions = profile.avoid_ros_namespace_conventions
        return made

    def __eq__(self, other: object) -> bool:
        return isinstance(other, QoSProfile) and all(getattr(self, name) == getattr(other, name) for name in _FIELDS)

    def __str__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!s}' for name in _FIELDS)})"


_DEFAULTS: dict[str, Any] = {
    "history": HistoryPolicy.KEEP_LAST,
    "depth": 10,
    "reliability": ReliabilityPolicy.RELIABLE,
    "durability": DurabilityPolicy.VOLATILE,
    "lifespan": Duration(),
    "deadline": Duration(),
    "liveliness": LivelinessPolicy.SYSTEM_DEFAULT,
    "liveliness_lease_duration": Duration(),
    "avoid_ros_namespace_conventions": False,
}
"""Field of a profile -> default of rmw."""

DeadlineBestAvailable = Duration(nanoseconds=RMW_QOS_DEADLINE_BEST_AVAILABLE)
LivelinessLeaseDurationeBestAvailable = Duration(nanoseconds=RMW_QOS_DEADLINE_BEST_AVAILABLE)

qos_profile_unknown = QoSProfile(
    history=HistoryPolicy.UNKNOWN,
    depth=0,
    reliability=ReliabilityPolicy.UNKNOWN,
    durability=DurabilityPolicy.UNKNOWN,
    liveliness=LivelinessPolicy.UNKNOWN,
)
qos_profile_default = QoSProfile._rosidl_from_runtime(presets.DEFAULT)
qos_profile_system_default = QoSProfile._rosidl_from_runtime(presets.SYSTEM_DEFAULT)
qos_profile_sensor_data = QoSProfile._rosidl_from_runtime(presets.SENSOR_DATA)
qos_profile_services_default = QoSProfile._rosidl_from_runtime(presets.SERVICES_DEFAULT)
qos_profile_parameters = QoSProfile._rosidl_from_runtime(presets.PARAMETERS)
qos_profile_parameter_events = QoSProfile._rosidl_from_runtime(presets.PARAMETER_EVENTS)
qos_profile_best_available = QoSProfile._rosidl_from_runtime(presets.BEST_AVAILABLE)
qos_profile_action_status_default = QoSProfile._rosidl_from_runtime(presets.ACTION_STATUS)


class QoSPresetProfiles(Enum):
    """The profiles that ROS names."""

    UNKNOWN = qos_profile_unknown
    DEFAULT = qos_profile_default
    SYSTEM_DEFAULT = qos_profile_system_default
    SENSOR_DATA = qos_profile_sensor_data
    SERVICES_DEFAULT = qos_profile_services_default
    PARAMETERS = qos_profile_parameters
    PARAMETER_EVENTS = qos_profile_parameter_events
    ACTION_STATUS_DEFAULT = qos_profile_action_status_default
    BEST_AVAILABLE = qos_profile_best_available

    @classmethod
    def short_keys(cls) -> list[str]:
        """All names in lower case."""
        return [key.lower() for key in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> QoSProfile:
        """The profile of a name in any case; KeyError for an unknown one."""
        return cls[name.upper()].value


def qos_check_compatible(publisher_qos: QoSProfile, subscription_qos: QoSProfile) -> tuple[QoSCompatibility, str]:
    """Whether the two would communicate, and why not; WARNING where the middleware decides."""
    found = runtime.check_compatible(publisher_qos.get_c_qos_profile(), subscription_qos.get_c_qos_profile())
    return QoSCompatibility[found.compatibility.name], found.reason
