"""Quality-of-service profiles: what they hold, the ROS presets, when two of them match.

Decides values only. How a profile becomes DDS policies is the transport's business (protocol.md 7.3).
Durations are integer nanoseconds with two special values: 0 means "unspecified", `INFINITE_NS` means "never";
for matching the two are the same, because a DDS entity without the policy has an infinite period.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, TypeVar

from rosidl_py_gen.runtime.transport.policies import (
    BEST_AVAILABLE_NS,
    INFINITE_NS,
    MAX_DEPTH,
    POLICIES,
    UNSPECIFIED_NS,
    Durability,
    History,
    InvalidQoSError,
    Liveliness,
    Reliability,
    duration_ns,
    policy_of,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = [
    "ACTION_STATUS",
    "BEST_AVAILABLE",
    "CLOCK",
    "DEFAULT",
    "INFINITE_NS",
    "PARAMETERS",
    "PARAMETER_EVENTS",
    "ROSOUT",
    "SENSOR_DATA",
    "SERVICES_DEFAULT",
    "SYSTEM_DEFAULT",
    "Compatibility",
    "CompatibilityResult",
    "Durability",
    "History",
    "InvalidQoSError",
    "Liveliness",
    "QoSLike",
    "QoSProfile",
    "Reliability",
    "as_profile",
    "check_compatible",
    "resolve_best_available",
    "without_best_available",
]

_T = TypeVar("_T")


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
        """Use the topic name as it is, without `rt/` in front (protocol.md 4)."""
        return replace(self, avoid_ros_namespace_conventions=True)

    def _with_liveliness(self, kind: Liveliness, lease_s: float | None) -> QoSProfile:
        lease_ns = self.liveliness_lease_ns if lease_s is None else duration_ns("liveliness lease", lease_s)
        return replace(self, liveliness=kind, liveliness_lease_ns=lease_ns)


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


# ---------------------------------------------------------------------------------------------------------- matching


class Compatibility(Enum):
    """The verdict of `check_compatible`."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class CompatibilityResult:
    """Verdict and reasons; `reason` is empty when all is well, else fragments that each end in ``;``."""

    compatibility: Compatibility
    reason: str

    @property
    def matches(self) -> bool:
        """False when the two endpoints will certainly not communicate."""
        return self.compatibility is not Compatibility.ERROR


def check_compatible(offered: QoSProfile, requested: QoSProfile) -> CompatibilityResult:
    """Say whether a publisher with `offered` and a subscription with `requested` communicate, and why not.

    Warnings are looked for only when there is no error, as rmw does. Unlike rmw an infinite duration counts as
    unspecified: discovered profiles carry infinite ones, and DDS matches them.

    Source: protocol.md 7.6.
    """
    errors = [f"ERROR: {text};" for text in _mismatches(offered, requested)]
    if errors:
        return CompatibilityResult(Compatibility.ERROR, "".join(errors))
    warnings = [f"WARNING: {text};" for text in _doubts(offered, requested)]
    if warnings:
        return CompatibilityResult(Compatibility.WARNING, "".join(warnings))
    return CompatibilityResult(Compatibility.OK, "")


def _mismatches(offered: QoSProfile, requested: QoSProfile) -> list[str]:
    found = []
    if offered.reliability is Reliability.BEST_EFFORT and requested.reliability is Reliability.RELIABLE:
        found.append("Best effort publisher and reliable subscription")
    if offered.durability is Durability.VOLATILE and requested.durability is Durability.TRANSIENT_LOCAL:
        found.append("Volatile publisher and transient local subscription")
    found += _duration_mismatch(
        offered.deadline_ns,
        requested.deadline_ns,
        "Subscription has a deadline, but publisher does not",
        "Subscription deadline is less than publisher deadline",
    )
    if offered.liveliness is Liveliness.AUTOMATIC and requested.liveliness is Liveliness.MANUAL_BY_TOPIC:
        found.append("Publisher's liveliness is automatic and subscription's is manual by topic")
    found += _duration_mismatch(
        offered.liveliness_lease_ns,
        requested.liveliness_lease_ns,
        "Subscription has a liveliness lease duration, but publisher does not",
        "Subscription liveliness lease duration is less than publisher",
    )
    return found


def _duration_mismatch(offered_ns: int, requested_ns: int, absent: str, shorter: str) -> list[str]:
    open_ended = (UNSPECIFIED_NS, INFINITE_NS)
    if requested_ns in open_ended:
        return []
    if offered_ns in open_ended:
        return [absent]
    return [shorter] if requested_ns < offered_ns else []


def _doubts(offered: QoSProfile, requested: QoSProfile) -> list[str]:
    reliability, durability, liveliness = requested.reliability, requested.durability, requested.liveliness
    found = [
        _doubt(
            _open(offered.reliability),
            _open(reliability),
            offered.reliability is Reliability.BEST_EFFORT,
            reliability is Reliability.RELIABLE,
            "Publisher reliability is {} and subscription reliability is {}",
            "Reliable subscription, but publisher is {}",
            "Best effort publisher, but subscription is {}",
        ),
        _doubt(
            _open(offered.durability),
            _open(durability),
            offered.durability is Durability.VOLATILE,
            durability is Durability.TRANSIENT_LOCAL,
            # "durabilty" is how rmw spells it, and tools compare texts.
            "Publisher durabilty is {} and subscription durability is {}",
            "Transient local subscription, but publisher is {}",
            "Volatile publisher, but subscription is {}",
        ),
        _doubt(
            _open(offered.liveliness),
            _open(liveliness),
            offered.liveliness is Liveliness.AUTOMATIC,
            liveliness is Liveliness.MANUAL_BY_TOPIC,
            "Publisher liveliness is {} and subscription liveliness is {}",
            "Subscription's liveliness is manual by topic, but publisher's is {}",
            "Publisher's liveliness is automatic, but subscription's is {}",
        ),
    ]
    return [text for text in found if text]


def _open(policy: Reliability | Durability | Liveliness) -> str:
    """The policy's name when its meaning is left to the middleware or was not discovered, else an empty text."""
    return policy.name.lower() if policy.name in ("SYSTEM_DEFAULT", "UNKNOWN") else ""


def _doubt(
    offered: str, requested: str, weak_offer: bool, strong_request: bool, both: str, unsure_offer: str, unsure_ask: str
) -> str:
    if offered and requested:
        return both.format(offered, requested)
    if offered and strong_request:
        return unsure_offer.format(offered)
    if requested and weak_offer:
        return unsure_ask.format(requested)
    return ""


# ---------------------------------------------------------------------------------------------------- best available


def resolve_best_available(profile: QoSProfile, *, publisher: bool, peers: Sequence[QoSProfile]) -> QoSProfile:
    """Replace the BEST_AVAILABLE policies of a new endpoint by what its discovered `peers` allow.

    `publisher` says which side is created; `peers` are the endpoints of the other side. This happens once, at
    creation; with no peer a subscription becomes RELIABLE, TRANSIENT_LOCAL and MANUAL_BY_TOPIC, because "all of
    nobody" holds.

    Source: protocol.md 7.5.
    """
    return replace(
        profile,
        reliability=_best_reliability(profile.reliability, publisher, peers),
        durability=_best_durability(profile.durability, publisher, peers),
        liveliness=_best_liveliness(profile.liveliness, publisher, peers),
        deadline_ns=_best_duration(profile.deadline_ns, publisher, [peer.deadline_ns for peer in peers]),
        liveliness_lease_ns=_best_duration(
            profile.liveliness_lease_ns, publisher, [peer.liveliness_lease_ns for peer in peers]
        ),
    )


def without_best_available(profile: QoSProfile) -> QoSProfile:
    """Replace BEST_AVAILABLE policies by those of `SERVICES_DEFAULT`, as services and clients do (7.5)."""
    default = SERVICES_DEFAULT
    return replace(
        profile,
        reliability=_unless(profile.reliability, Reliability.BEST_AVAILABLE, default.reliability),
        durability=_unless(profile.durability, Durability.BEST_AVAILABLE, default.durability),
        liveliness=_unless(profile.liveliness, Liveliness.BEST_AVAILABLE, default.liveliness),
        deadline_ns=_unless(profile.deadline_ns, BEST_AVAILABLE_NS, default.deadline_ns),
        liveliness_lease_ns=_unless(profile.liveliness_lease_ns, BEST_AVAILABLE_NS, default.liveliness_lease_ns),
    )


def _best_reliability(wanted: Reliability, publisher: bool, peers: Sequence[QoSProfile]) -> Reliability:
    if wanted is not Reliability.BEST_AVAILABLE:
        return wanted
    if publisher or all(peer.reliability is Reliability.RELIABLE for peer in peers):
        return Reliability.RELIABLE
    return Reliability.BEST_EFFORT


def _best_durability(wanted: Durability, publisher: bool, peers: Sequence[QoSProfile]) -> Durability:
    if wanted is not Durability.BEST_AVAILABLE:
        return wanted
    if publisher or all(peer.durability is Durability.TRANSIENT_LOCAL for peer in peers):
        return Durability.TRANSIENT_LOCAL
    return Durability.VOLATILE


def _best_liveliness(wanted: Liveliness, publisher: bool, peers: Sequence[QoSProfile]) -> Liveliness:
    if wanted is not Liveliness.BEST_AVAILABLE:
        return wanted
    manual = [peer.liveliness is Liveliness.MANUAL_BY_TOPIC for peer in peers]
    return Liveliness.MANUAL_BY_TOPIC if (any(manual) if publisher else all(manual)) else Liveliness.AUTOMATIC


def _best_duration(wanted_ns: int, publisher: bool, peers_ns: Sequence[int]) -> int:
    if wanted_ns != BEST_AVAILABLE_NS:
        return wanted_ns
    # An unspecified period is endless for DDS, so it must lose a "smallest" and win a "largest".
    known = [INFINITE_NS if value == UNSPECIFIED_NS else value for value in peers_ns]
    best = (min if publisher else max)(known, default=INFINITE_NS)
    return UNSPECIFIED_NS if best == INFINITE_NS else best


def _unless(value: _T, unwanted: _T, default: _T) -> _T:
    return default if value == unwanted else value
