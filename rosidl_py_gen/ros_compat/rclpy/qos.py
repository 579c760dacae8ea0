"""QoS policies and profiles, and the check whether two profiles are compatible."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from enum import Enum, IntEnum
from typing import Any, TypeVar, Union

from rclpy._classes import Checked
from rclpy._rclpy_pybind11 import RMW_QOS_DEADLINE_BEST_AVAILABLE, QoSCompatibility
from rclpy.duration import Duration
from rosidl_py_gen import runtime
from rosidl_py_gen.runtime import QoSPolicyKind
from rosidl_py_gen.runtime import qos as presets

_P = TypeVar("_P", bound=IntEnum)


def qos_policy_name_from_kind(policy_kind: QoSPolicyKind | int) -> str:
    """Return the name of the QoS policy with a number; raise ValueError for an unknown number."""
    return QoSPolicyKind(policy_kind).name


class InvalidQoSProfileException(Exception):
    """Raised for a QoS profile without a history or a depth."""

    def __init__(self, *args: object) -> None:
        super().__init__("Invalid QoSProfile", *args)


class QoSPolicyEnum(IntEnum):
    """Base class of QoS policies, whose values also have short lower-case names, as on command lines."""

    @classmethod
    def short_keys(cls) -> list[str]:
        """Return the short names of all values of the policy."""
        return [key.lower() for key in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> int:
        """Return the number of the value with a name in upper or lower case; raise KeyError for an unknown name."""
        return int(cls[name.upper()].value)

    @property
    def short_key(self) -> str:
        """Short name of the value, in lower case."""
        return self.name.lower()


class _OldName:
    """Descriptor for the deprecated name of a policy's value; reading the attribute emits a warning."""

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
    """QoS policy that selects the messages to store: the last messages (KEEP_LAST) or all.

    Numbers are the numbers of rmw.
    """

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


@_with_old_names("RMW_QOS_POLICY_RELIABILITY_", "SYSTEM_DEFAULT", "RELIABLE", "BEST_EFFORT", "UNKNOWN")
class ReliabilityPolicy(QoSPolicyEnum):
    """QoS policy that decides if lost messages are sent again. Numbers are the numbers of rmw."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


@_with_old_names("RMW_QOS_POLICY_DURABILITY_", "SYSTEM_DEFAULT", "TRANSIENT_LOCAL", "VOLATILE", "UNKNOWN")
class DurabilityPolicy(QoSPolicyEnum):
    """QoS policy that decides if subscriptions that join late receive earlier messages.

    Numbers are the numbers of rmw.
    """

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
    RMW_QOS_POLICY_DURABILITY_UNKNOWN="UNKNOWN",  # as in rclpy, by mistake
)
class LivelinessPolicy(QoSPolicyEnum):
    """QoS policy that decides how a publisher proves that it is alive. Numbers are the numbers of rmw."""

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
    """QoS profile of rosidl_py_gen.runtime that can be converted back to the arguments of `QoSProfile`."""

    __slots__ = ()

    def to_dict(self) -> dict[str, Any]:
        profile = QoSProfile.rosidl_from_runtime(self)
        return {name: getattr(profile, name) for name in _DEFAULTS}


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
_DEFAULTS |= {
    policy.rmw_name: getattr(presets.DEFAULT, policy.field)
    for policy in presets.POLICIES
    if policy.rmw_name not in _DEFAULTS
}
"""Defaults of rmw by field of a QoS profile; fields that rclpy does not have come last. `history` precedes `depth`,
because the setter of `depth` reads it."""


class QoSProfile:
    """QoS profile of an endpoint; its fields can be set.

    Raises:
        InvalidQoSProfileException: both `history` and `depth` are missing, or KEEP_LAST without `depth`.
        AssertionError: a field is unknown, or a value has the wrong type.
    """

    __slots__ = tuple(f"_{name}" for name in _DEFAULTS)

    history = Checked[HistoryPolicy](int, convert=HistoryPolicy)
    reliability = Checked[ReliabilityPolicy](int, convert=ReliabilityPolicy)
    durability = Checked[DurabilityPolicy](int, convert=DurabilityPolicy)
    liveliness = Checked[LivelinessPolicy](int, convert=LivelinessPolicy)
    lifespan: Duration
    deadline: Duration
    liveliness_lease_duration: Duration
    avoid_ros_namespace_conventions: bool

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
        """Number of messages that history KEEP_LAST stores; setting 0 warns, and means the middleware's default."""
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
        """Return the QoS profile of rosidl_py_gen, which replaces the C structure of rclpy.

        Raises:
            rosidl_py_gen.runtime.InvalidQoSError: a number is out of range; a ValueError.
        """
        values = {}
        for policy in presets.POLICIES:
            value = getattr(self, policy.rmw_name)
            if policy.enum is not None:
                value = policy.enum(value)
            elif policy.is_period:
                value = value.nanoseconds
            values[policy.field] = value
        values["depth"] = int(self.depth)  # a bool is an int in rclpy
        return _RuntimeProfile(**values)

    @classmethod
    def rosidl_from_runtime(cls, profile: runtime.QoSProfile) -> QoSProfile:
        """Convert a QoS profile of rosidl_py_gen.runtime to a `QoSProfile`, without a warning for depth 0."""
        values = {}
        for policy in presets.POLICIES:
            value = getattr(profile, policy.field)
            values[policy.rmw_name] = Duration(nanoseconds=value) if policy.is_period else value
        converted = cls(**{**values, "depth": 1})
        converted._depth = profile.depth
        return converted

    def __eq__(self, other: object) -> bool:
        return isinstance(other, QoSProfile) and all(getattr(self, name) == getattr(other, name) for name in _DEFAULTS)

    def __str__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!s}' for name in _DEFAULTS)})"


for _name, _default in _DEFAULTS.items():
    if not hasattr(QoSProfile, _name):
        _field = Checked[Any](type(_default))
        _field.__set_name__(QoSProfile, _name)
        setattr(QoSProfile, _name, _field)

DeadlineBestAvailable = Duration(nanoseconds=RMW_QOS_DEADLINE_BEST_AVAILABLE)
LivelinessLeaseDurationeBestAvailable = Duration(nanoseconds=RMW_QOS_DEADLINE_BEST_AVAILABLE)  # spelled as in rclpy

qos_profile_unknown = QoSProfile(
    history=HistoryPolicy.UNKNOWN,
    depth=0,
    reliability=ReliabilityPolicy.UNKNOWN,
    durability=DurabilityPolicy.UNKNOWN,
    liveliness=LivelinessPolicy.UNKNOWN,
)
qos_profile_default = QoSProfile.rosidl_from_runtime(presets.DEFAULT)
qos_profile_system_default = QoSProfile.rosidl_from_runtime(presets.SYSTEM_DEFAULT)
qos_profile_sensor_data = QoSProfile.rosidl_from_runtime(presets.SENSOR_DATA)
qos_profile_services_default = QoSProfile.rosidl_from_runtime(presets.SERVICES_DEFAULT)
qos_profile_parameters = QoSProfile.rosidl_from_runtime(presets.PARAMETERS)
qos_profile_parameter_events = QoSProfile.rosidl_from_runtime(presets.PARAMETER_EVENTS)
qos_profile_best_available = QoSProfile.rosidl_from_runtime(presets.BEST_AVAILABLE)
qos_profile_action_status_default = QoSProfile.rosidl_from_runtime(presets.ACTION_STATUS)
qos_profile_rosout_default = QoSProfile.rosidl_from_runtime(presets.ROSOUT)


class QoSPresetProfiles(Enum):
    """QoS profiles with a name in ROS, such as SENSOR_DATA."""

    UNKNOWN = qos_profile_unknown
    DEFAULT = qos_profile_default
    SYSTEM_DEFAULT = qos_profile_system_default
    SENSOR_DATA = qos_profile_sensor_data
    SERVICES_DEFAULT = qos_profile_services_default
    PARAMETERS = qos_profile_parameters
    PARAMETER_EVENTS = qos_profile_parameter_events
    ACTION_STATUS_DEFAULT = qos_profile_action_status_default
    BEST_AVAILABLE = qos_profile_best_available
    ROSOUT_DEFAULT = qos_profile_rosout_default

    @classmethod
    def short_keys(cls) -> list[str]:
        """Return the names of all preset profiles in lower case."""
        return [key.lower() for key in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> QoSProfile:
        """Return the profile with a name in upper or lower case; raise KeyError for an unknown name."""
        return cls[name.upper()].value


def qos_check_compatible(publisher_qos: QoSProfile, subscription_qos: QoSProfile) -> tuple[QoSCompatibility, str]:
    """Return the compatibility of a publisher's and a subscription's profile, and the reason.

    The compatibility is WARNING if the middleware decides later.
    """
    result = runtime.check_compatible(publisher_qos.get_c_qos_profile(), subscription_qos.get_c_qos_profile())
    return QoSCompatibility[result.compatibility.name], result.reason
