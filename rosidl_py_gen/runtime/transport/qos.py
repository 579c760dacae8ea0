"""Quality-of-service profiles: policies with the numbers of rmw, the profile, and the presets of ROS.

Durations are integer nanoseconds with two special values: 0 means "unspecified", `INFINITE_NS` means "never".
For matching the two are the same, because a DDS entity without the policy has an infinite period.

Source: docs/internals/protocol.md 7.1, 7.3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError

UNSPECIFIED_NS = 0
INFINITE_NS = 9223372036_854775807
BEST_AVAILABLE_NS = 9223372036_854775806
MAX_DEPTH = 2**31 - 1


class InvalidQoSError(RosidlError, ValueError):
    """Raised if a QoS value is out of range, of the wrong type, or not permitted where it is used."""


class History(IntEnum):
    """QoS policy that selects how many samples an endpoint retains; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class Reliability(IntEnum):
    """QoS policy that decides if lost samples are sent again; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class Durability(IntEnum):
    """QoS policy that decides if endpoints that join late receive earlier samples; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class Liveliness(IntEnum):
    """QoS policy that decides how a publisher asserts that it is alive; numbers of rmw, which has removed 2."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


class QoSPolicyKind(IntEnum):
    """QoS policy that makes two endpoints incompatible; numbers of rmw_qos_policy_kind_t and of rclpy."""

    INVALID = 1
    DURABILITY = 2
    DEADLINE = 4
    LIVELINESS = 8
    RELIABILITY = 16
    HISTORY = 32
    LIFESPAN = 64
    DEPTH = 128
    LIVELINESS_LEASE_DURATION = 256
    AVOID_ROS_NAMESPACE_CONVENTIONS = 512


@dataclass(frozen=True, slots=True)
class Policy:
    """QoS policy as a field of `QoSProfile`: its names, and the kind of its value.

    Attributes:
        field: field of `QoSProfile`; a field that ends with ``_ns`` is a duration.
        rmw_name: name in rmw, in rclpy and in the files of rosbag2.
        label: name in texts for people; empty for a policy that has no line of its own in these texts.
        enum: enum class of the values; None for numbers and flags.
    """

    field: str
    rmw_name: str
    label: str = ""
    enum: type[IntEnum] | None = None

    @property
    def is_period(self) -> bool:
        """Return True if the value is a duration in nanoseconds."""
        return self.field.endswith("_ns")


POLICIES = (
    Policy("reliability", "reliability", "Reliability", Reliability),
    Policy("history", "history", "History (Depth)", History),
    Policy("depth", "depth"),
    Policy("durability", "durability", "Durability", Durability),
    Policy("lifespan_ns", "lifespan", "Lifespan"),
    Policy("deadline_ns", "deadline", "Deadline"),
    Policy("liveliness", "liveliness", "Liveliness", Liveliness),
    Policy("liveliness_lease_ns", "liveliness_lease_duration", "Liveliness lease duration"),
    Policy("avoid_ros_namespace_conventions", "avoid_ros_namespace_conventions"),
)
"""All policies, in the order of ``ros2 topic info --verbose``.

Checks of a profile, files of rosbag2, texts and the rclpy layer follow this table. The middlewares do not: each has its
own form for a policy. CONTRIBUTING.md has the steps to add one.
"""
ENUMS = {policy.field: policy.enum for policy in POLICIES if policy.enum is not None}
"""Enum classes of QoS policies, by the field of `QoSProfile` that has a member of the enum as value."""
PERIODS = {policy.field: policy.rmw_name for policy in POLICIES if policy.is_period}
"""Names in rmw of the QoS policies whose value is a duration, by field of `QoSProfile`."""


def _policy_member(name: str, kind: type[IntEnum], value: object) -> IntEnum:
    """Convert a plain int to a member of `kind`; raise `InvalidQoSError` for other values, or an int as history."""
    numbers = [int(member) for member in kind]
    if value.__class__ is int and value in numbers and kind is not History:
        return kind(value)
    members = ", ".join(f"{kind.__name__}.{member.name}" for member in kind if member.name != "UNKNOWN")
    reason = f"{name} must be one of {members}; got {value!r}"
    if value.__class__ is int and kind is History:
        reason += f". A keep-last depth is written QoSProfile(depth={value}), or just {value} in place of the profile"
    elif isinstance(value, str) and value.upper() in kind.__members__:
        reason += f": write {kind.__name__}.{value.upper()}"
    raise InvalidQoSError(reason)


def _duration_ns(subject: str, seconds: float) -> int:
    is_number = isinstance(seconds, (int, float)) and not isinstance(seconds, bool)
    if is_number and seconds == float("inf"):
        return INFINITE_NS
    if not is_number or not 0 <= seconds < INFINITE_NS / NS_PER_S:
        raise InvalidQoSError(f"{subject} must be seconds, 0 (unspecified) or more, or math.inf; got {seconds!r}")
    return round(seconds * NS_PER_S)


@dataclass(frozen=True, slots=True)
class QoSProfile:
    """Quality of service of an endpoint; every builder method returns a changed copy.

    The default value is the ROS default profile: keep last 10, reliable, volatile. Policies are enum members; the plain
    ints of rmw are accepted too, except for `history`: as the first argument, an int would be meant as a depth.

    Raises:
        InvalidQoSError: a value has the wrong type or is out of range.
    """

    history: History = History.KEEP_LAST
    depth: int = 10
    reliability: Reliability = Reliability.RELIABLE
    durability: Durability = Durability.VOLATILE
    deadline_ns: int = 0
    lifespan_ns: int = 0
    liveliness: Liveliness = Liveliness.SYSTEM_DEFAULT
    liveliness_lease_ns: int = 0
    avoid_ros_namespace_conventions: bool = False

    def __post_init__(self) -> None:
        for name, kind in ENUMS.items():
            value: object = getattr(self, name)
            if value.__class__ is not kind:
                object.__setattr__(self, name, _policy_member(name, kind, value))
        if self.depth.__class__ is not int or not 0 <= self.depth <= MAX_DEPTH:
            raise InvalidQoSError(f"depth must be an int from 0 to {MAX_DEPTH}, got {self.depth!r}")
        for name in PERIODS:
            period = getattr(self, name)
            if period.__class__ is not int or not 0 <= period <= INFINITE_NS:
                raise InvalidQoSError(f"{name} must be an int of nanoseconds from 0 to 2**63-1, got {period!r}")
        if self.avoid_ros_namespace_conventions.__class__ is not bool:
            value = self.avoid_ros_namespace_conventions
            raise InvalidQoSError(f"avoid_ros_namespace_conventions must be True or False, got {value!r}")

    def short(self) -> str:
        """Return reliability, durability and history as a short text: ``reliable, volatile, keep last 10``."""
        history = f"keep last {self.depth}" if self.history is History.KEEP_LAST else self.history.name
        words = (self.reliability.name, self.durability.name, history)
        return ", ".join(word.lower().replace("_", " ") for word in words)

    def keep_last(self, depth: int) -> QoSProfile:
        """Return a copy that retains the newest `depth` samples; 0 counts as 1 on the wire."""
        return replace(self, history=History.KEEP_LAST, depth=depth)

    def keep_all(self) -> QoSProfile:
        """Return a copy that retains every sample; its depth is 0."""
        return replace(self, history=History.KEEP_ALL, depth=0)

    def reliable(self) -> QoSProfile:
        """Return a copy with which lost samples are sent again."""
        return replace(self, reliability=Reliability.RELIABLE)

    def best_effort(self) -> QoSProfile:
        """Return a copy with which lost samples are not sent again."""
        return replace(self, reliability=Reliability.BEST_EFFORT)

    def volatile(self) -> QoSProfile:
        """Return a copy with which late joiners receive only samples that are sent later."""
        return replace(self, durability=Durability.VOLATILE)

    def transient_local(self) -> QoSProfile:
        """Return a copy with which late joiners also receive the samples that the publisher retains."""
        return replace(self, durability=Durability.TRANSIENT_LOCAL)

    def deadline(self, seconds: float) -> QoSProfile:
        """Return a copy with a deadline: a sample is expected at least every `seconds`; `math.inf` for no deadline."""
        return replace(self, deadline_ns=_duration_ns("deadline", seconds))

    def lifespan(self, seconds: float) -> QoSProfile:
        """Return a copy with which samples older than `seconds` are dropped; `math.inf` for never."""
        return replace(self, lifespan_ns=_duration_ns("lifespan", seconds))

    def automatic_liveliness(self, lease_s: float | None = None) -> QoSProfile:
        """Return a copy with which a publisher's process asserts liveliness; None does not change the lease."""
        return self._with_liveliness(Liveliness.AUTOMATIC, lease_s)

    def manual_liveliness(self, lease_s: float | None = None) -> QoSProfile:
        """Return a copy with which a publisher asserts its liveliness by publishing, or by an explicit call.

        None does not change the lease.
        """
        return self._with_liveliness(Liveliness.MANUAL_BY_TOPIC, lease_s)

    def no_ros_prefix(self) -> QoSProfile:
        """Return a copy of the profile with which the topic name has no prefix `rt/` in DDS."""
        # Source: docs/internals/protocol.md 4.
        return replace(self, avoid_ros_namespace_conventions=True)

    def _with_liveliness(self, kind: Liveliness, lease_s: float | None) -> QoSProfile:
        lease_ns = self.liveliness_lease_ns if lease_s is None else _duration_ns("liveliness lease", lease_s)
        return replace(self, liveliness=kind, liveliness_lease_ns=lease_ns)


DEFAULT = QoSProfile()
"""Profile of most topics: reliable, volatile, the last 10 samples."""
SENSOR_DATA = QoSProfile().keep_last(5).best_effort()
"""Profile of sensors: best effort, the last 5 samples. Subscriptions receive from reliable publishers as well."""
SERVICES_DEFAULT = QoSProfile()
"""Profile of services; equal to `DEFAULT`."""
PARAMETERS = QoSProfile().keep_last(1000)
"""Profile of parameter services; as `DEFAULT`, with the last 1000 samples."""
PARAMETER_EVENTS = QoSProfile().keep_last(1000)
"""Profile of ``/parameter_events``: reliable, the last 1000 samples."""
ROSOUT = QoSProfile().keep_last(1000).transient_local().lifespan(10)
"""Profile of ``/rosout``: transient local, the last 1000 samples of the last 10 seconds."""
ACTION_STATUS = QoSProfile().keep_last(1).transient_local()
"""Profile of the status of actions: transient local, the last sample."""
CLOCK = QoSProfile().keep_last(1).best_effort()
"""Profile of ``/clock``: best effort, the last sample."""
SYSTEM_DEFAULT = QoSProfile(History.SYSTEM_DEFAULT, 0, Reliability.SYSTEM_DEFAULT, Durability.SYSTEM_DEFAULT)
"""Profile with the defaults of the middleware."""
BEST_AVAILABLE = QoSProfile(
    reliability=Reliability.BEST_AVAILABLE,
    durability=Durability.BEST_AVAILABLE,
    deadline_ns=BEST_AVAILABLE_NS,
    liveliness=Liveliness.BEST_AVAILABLE,
    liveliness_lease_ns=BEST_AVAILABLE_NS,
)
"""Profile whose policies are chosen when an endpoint is created, to match as many discovered endpoints as possible."""

QoSLike = int | QoSProfile
"""Type of arguments that accept a QoS profile, or an int: the default profile with that keep-last depth."""


def as_profile(qos: QoSLike) -> QoSProfile:
    """Return `qos`, or the default profile with `qos` as its keep-last depth.

    Raises:
        InvalidQoSError: `qos` is neither a profile nor a valid depth, or has an UNKNOWN policy.
    """
    if isinstance(qos, QoSProfile):
        for name, kind in ENUMS.items():
            if getattr(qos, name).name == "UNKNOWN":
                raise InvalidQoSError(
                    f"{name} must not be {kind.__name__}.UNKNOWN; that value only describes discovered endpoints"
                )
        return qos
    if isinstance(qos, bool) or not isinstance(qos, int):
        raise InvalidQoSError(f"qos must be a QoSProfile or an int (keep-last depth), got {qos!r}")
    return DEFAULT.keep_last(qos)


def effective(qos: QoSProfile, *, is_writer: bool) -> QoSProfile:
    """Return the profile in the form in which discovery reports it: SYSTEM_DEFAULT and unspecified values become what
    they mean.

    Source: docs/internals/protocol.md 6.4, 7.3 (unspecified durations are infinite, a reader has no lifespan).
    """
    keep_all = qos.history is History.KEEP_ALL
    return replace(
        qos,
        history=History.KEEP_ALL if keep_all else History.KEEP_LAST,
        depth=0 if keep_all else max(1, qos.depth),
        reliability=qos.reliability if qos.reliability is Reliability.BEST_EFFORT else Reliability.RELIABLE,
        durability=qos.durability if qos.durability is Durability.TRANSIENT_LOCAL else Durability.VOLATILE,
        liveliness=qos.liveliness if qos.liveliness is Liveliness.MANUAL_BY_TOPIC else Liveliness.AUTOMATIC,
        deadline_ns=qos.deadline_ns or INFINITE_NS,
        lifespan_ns=(is_writer and qos.lifespan_ns) or INFINITE_NS,
        liveliness_lease_ns=qos.liveliness_lease_ns or INFINITE_NS,
        avoid_ros_namespace_conventions=False,
    )
