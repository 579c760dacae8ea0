"""Quality-of-service profiles: the policies with rmw's numbers, what a profile holds, and the ROS presets.

Decides which values there are. When two profiles match is `matching.py`, how one becomes DDS policies is the
transport's business (docs/internals/protocol.md 7.3). Imports nothing of ours but errors.

Durations are integer nanoseconds with two special values: 0 means "unspecified", `INFINITE_NS` means "never";
for matching the two are the same, because a DDS entity without the policy has an infinite period.
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
    """The caller asked for a quality of service that cannot exist."""


class History(IntEnum):
    """How many samples are kept; numbers of rmw (docs/internals/protocol.md 7.1)."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class Reliability(IntEnum):
    """Whether lost samples are sent again; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class Durability(IntEnum):
    """Whether late joiners get earlier samples; numbers of rmw."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class Liveliness(IntEnum):
    """Who says that a publisher is alive; numbers of rmw (2 was removed there)."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


class QoSPolicyKind(IntEnum):
    """What two endpoints disagree on; numbers of rmw_qos_policy_kind_t and of rclpy."""

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


POLICIES: dict[str, type[IntEnum]] = {
    "history": History,
    "reliability": Reliability,
    "durability": Durability,
    "liveliness": Liveliness,
}
"""Field of a profile -> what it may hold."""


def policy_of(name: str, kind: type[IntEnum], value: object) -> IntEnum:
    """The member that a plain int stands for; everything else is refused in words that name a member."""
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


def duration_ns(what: str, seconds: float) -> int:
    """Seconds as a period in ns; raises `InvalidQoSError`."""
    number = isinstance(seconds, (int, float)) and not isinstance(seconds, bool)
    if number and seconds == float("inf"):
        return INFINITE_NS
    if not number or not 0 <= seconds < INFINITE_NS / NS_PER_S:
        raise InvalidQoSError(f"{what} must be seconds, 0 (unspecified) or more, or math.inf; got {seconds!r}")
    return round(seconds * NS_PER_S)


# ----------------------------------------------------------------------------------------------------------- profile


@dataclass(frozen=True, slots=True)
class QoSProfile:
    """One endpoint's quality of service; every builder call returns a changed copy.

    The default value is the ROS default profile: keep last 10, reliable, volatile. Policies are enum members; the plain
    ints of rmw are accepted too, except for `history`, which is the first argument: a depth is meant there.

    Raises:
        InvalidQoSError: a value of another type, or out of range.
    """

    history: History = History.KEEP_LAST
    depth: int = 10
    reliability: Reliability = Reliability.RELIABLE
    durability: Durability = Durability.VOLATILE
    deadline_ns: int = UNSPECIFIED_NS
    lifespan_ns: int = UNSPECIFIED_NS
    liveliness: Liveliness = Liveliness.SYSTEM_DEFAULT
    liveliness_lease_ns: int = UNSPECIFIED_NS
    avoid_ros_namespace_conventions: bool = False

    def __post_init__(self) -> None:
        for name, kind in POLICIES.items():
            value: object = getattr(self, name)
            if value.__class__ is not kind:
                object.__setattr__(self, name, policy_of(name, kind, value))
        if self.depth.__class__ is not int or not 0 <= self.depth <= MAX_DEPTH:
            raise InvalidQoSError(f"depth must be an int from 0 to {MAX_DEPTH}, got {self.depth!r}")
        for name in ("deadline_ns", "lifespan_ns", "liveliness_lease_ns"):
            period = getattr(self, name)
            if period.__class__ is not int or not 0 <= period <= INFINITE_NS:
                raise InvalidQoSError(f"{name} must be an int of nanoseconds from 0 to 2**63-1, got {period!r}")
        if self.avoid_ros_namespace_conventions.__class__ is not bool:
            found = self.avoid_ros_namespace_conventions
            raise InvalidQoSError(f"avoid_ros_namespace_conventions must be True or False, got {found!r}")

    def short(self) -> str:
        """The policies that differ most often, in words: ``reliable, volatile, keep last 10``."""
        history = f"keep last {self.depth}" if self.history is History.KEEP_LAST else self.history.name
        words = (self.reliability.name, self.durability.name, history)
        return ", ".join(word.lower().replace("_", " ") for word in words)

    def keep_last(self, depth: int) -> QoSProfile:
        """Keep the newest `depth` samples; 0 counts as 1 on the wire."""
        return replace(self, history=History.KEEP_LAST, depth=depth)

    def keep_all(self) -> QoSProfile:
        """Keep every sample; the depth becomes 0."""
        return replace(self, history=History.KEEP_ALL, depth=0)

    def reliable(self) -> QoSProfile:
        """Send lost samples again."""
        return replace(self, reliability=Reliability.RELIABLE)

    def best_effort(self) -> QoSProfile:
        """Never send a sample twice."""
        return replace(self, reliability=Reliability.BEST_EFFORT)

    def volatile(self) -> QoSProfile:
        """Late joiners start with the next sample."""
        return replace(self, durability=Durability.VOLATILE)

    def transient_local(self) -> QoSProfile:
        """Late joiners get the samples the publisher still keeps."""
        return replace(self, durability=Durability.TRANSIENT_LOCAL)

    def deadline(self, seconds: float) -> QoSProfile:
        """Expect a sample at least every `seconds`; `math.inf` for never."""
        return replace(self, deadline_ns=duration_ns("deadline", seconds))

    def lifespan(self, seconds: float) -> QoSProfile:
        """Drop samples older than `seconds`; `math.inf` for never."""
        return replace(self, lifespan_ns=duration_ns("lifespan", seconds))

    def automatic_liveliness(self, lease_s: float | None = None) -> QoSProfile:
        """The process asserts liveliness; None leaves the lease as it is."""
        return self._with_liveliness(Liveliness.AUTOMATIC, lease_s)

    def manual_liveliness(self, lease_s: float | None = None) -> QoSProfile:
        """Each publish (or an explicit assertion) keeps the publisher alive; None leaves the lease as it is."""
        return self._with_liveliness(Liveliness.MANUAL_BY_TOPIC, lease_s)

    def no_ros_prefix(self) -> QoSProfile:
        """Use the topic name as it is, without `rt/` in front (docs/internals/protocol.md 4)."""
        return replace(self, avoid_ros_namespace_conventions=True)

    def _with_liveliness(self, kind: Liveliness, lease_s: float | None) -> QoSProfile:
        lease_ns = self.liveliness_lease_ns if lease_s is None else duration_ns("liveliness lease", lease_s)
        return replace(self, liveliness=kind, liveliness_lease_ns=lease_ns)


# ----------------------------------------------------------------------------------------------------------- presets


DEFAULT = QoSProfile()
SENSOR_DATA = QoSProfile().keep_last(5).best_effort()
SERVICES_DEFAULT = QoSProfile()
PARAMETERS = QoSProfile().keep_last(1000)
PARAMETER_EVENTS = QoSProfile().keep_last(1000)
ROSOUT = QoSProfile().keep_last(1000).transient_local().lifespan(10)
ACTION_STATUS = QoSProfile().keep_last(1).transient_local()
CLOCK = QoSProfile().keep_last(1).best_effort()
SYSTEM_DEFAULT = QoSProfile(History.SYSTEM_DEFAULT, 0, Reliability.SYSTEM_DEFAULT, Durability.SYSTEM_DEFAULT)
BEST_AVAILABLE = QoSProfile(
    reliability=Reliability.BEST_AVAILABLE,
    durability=Durability.BEST_AVAILABLE,
    deadline_ns=BEST_AVAILABLE_NS,
    liveliness=Liveliness.BEST_AVAILABLE,
    liveliness_lease_ns=BEST_AVAILABLE_NS,
)

QoSLike = int | QoSProfile
"""What every endpoint accepts: a profile, or a keep-last depth on top of the default profile."""


def as_profile(qos: QoSLike) -> QoSProfile:
    """The profile of a new endpoint: `qos` itself, or the default profile with `qos` as its keep-last depth.

    Raises `InvalidQoSError`, also for UNKNOWN policies: only what was discovered may be unknown.
    """
    if isinstance(qos, QoSProfile):
        for name, kind in POLICIES.items():
            if getattr(qos, name).name == "UNKNOWN":
                raise InvalidQoSError(f"{name} is {kind.__name__}.UNKNOWN: only discovered endpoints have that")
        return qos
    if isinstance(qos, bool) or not isinstance(qos, int):
        raise InvalidQoSError(f"qos must be a QoSProfile or an int (keep-last depth), got {qos!r}")
    return DEFAULT.keep_last(qos)


def effective(qos: QoSProfile, *, is_writer: bool) -> QoSProfile:
    """The profile as discovery shows it: SYSTEM_DEFAULT and unspecified values replaced by what they mean.

    Source: docs/internals/protocol.md 6.4, 7.3 (durations that are not set are infinite, a reader has no lifespan).
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
