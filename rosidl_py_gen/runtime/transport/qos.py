"""Quality-of-service profiles: policies with the numbers of rmw, the presets of ROS, and compatibility of endpoints.

Durations are integer nanoseconds with two special values: 0 means "unspecified", `INFINITE_NS` means "never".
For matching the two are the same, because a DDS entity without the policy has an infinite period.

Endpoints must be compatible in QoS and type. The reasons against a match are texts for people; the texts about QoS
equal the texts of rmw.

Source: docs/internals/protocol.md 7.1, 7.3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, IntEnum, auto
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import RosidlError, printable

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint

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


class OrderRule(NamedTuple):
    """Matching rule of an enum: the weakest offer and the strictest request are incompatible.

    Attributes:
        weakest: weakest offer.
        strictest: strictest request.
        incompatible: text about the weakest offer and the strictest request.
        both_undetermined: text about two undetermined values, with two places for their names.
        offer_undetermined: text about an undetermined offer and the strictest request, with a place for the offer.
        request_undetermined: text about the weakest offer and an undetermined request, with a place for the request.
    """

    weakest: IntEnum
    strictest: IntEnum
    incompatible: str
    both_undetermined: str
    offer_undetermined: str
    request_undetermined: str

    def mismatch(self, offer: IntEnum, request: IntEnum) -> str:
        """Return a text if the two values are incompatible; else an empty text."""
        return self.incompatible if offer is self.weakest and request is self.strictest else ""

    def possible_mismatch(self, offer: IntEnum, request: IntEnum) -> str:
        """Return a text if an undetermined value may be incompatible with the other value; else an empty text."""
        offer_name, request_name = offer.name, request.name
        if offer_name in _UNDETERMINED and request_name in _UNDETERMINED:
            return self.both_undetermined.format(offer_name.lower(), request_name.lower())
        if offer_name in _UNDETERMINED and request is self.strictest:
            return self.offer_undetermined.format(offer_name.lower())
        if request_name in _UNDETERMINED and offer is self.weakest:
            return self.request_undetermined.format(request_name.lower())
        return ""


_UNDETERMINED = ("SYSTEM_DEFAULT", "UNKNOWN")
"""Names of policy values that are undetermined: the middleware chooses a value in their place, or they were not
discovered."""


class DurationRule(NamedTuple):
    """Matching rule of a duration: a request must not be shorter than the offer.

    Attributes:
        absent: text about a request without an offer.
        shorter: text about a request that is shorter than the offer.
    """

    absent: str
    shorter: str

    def mismatch(self, offer_ns: int, request_ns: int) -> str:
        """Return a text if the two durations are incompatible; else an empty text."""
        if request_ns in _ENDLESS:
            return ""
        if offer_ns in _ENDLESS:
            return self.absent
        return self.shorter if request_ns < offer_ns else ""


_ENDLESS = (UNSPECIFIED_NS, INFINITE_NS)


class Policy(NamedTuple):
    """QoS policy as a field of `QoSProfile`: its names, the kind of its value, its matching rule and its form in DDS.

    Attributes:
        field: field of `QoSProfile`; a field that ends with ``_ns`` is a duration.
        rmw_name: name in rmw, in rclpy and in the files of rosbag2.
        kind: number in rmw.
        unset: value that discovery reports for a policy that an endpoint leaves to the middleware or does not have.
        label: name in texts for people; empty for a policy that has no line of its own in these texts.
        enum: enum class of the values; None for numbers and flags.
        limits: smallest and largest value of a number; None for others.
        rule: rule by which an offer matches a request; None if the policy does not influence matching.
        dds: name in the functions of Cyclone, such as ``dds_qset_history``; empty if DDS does not have the policy.
            Policies with the same name are one policy of DDS, and the parameters of its functions in this order.
        dds_values: members of `enum` in the order of their numbers in DDS; None for a number that ROS does not have.
        is_for_publishers: True if subscriptions do not have the policy.
    """

    field: str
    rmw_name: str
    kind: QoSPolicyKind
    unset: int
    label: str = ""
    enum: type[IntEnum] | None = None
    limits: tuple[int, int] | None = None
    rule: OrderRule | DurationRule | None = None
    dds: str = ""
    dds_values: tuple[IntEnum | None, ...] = ()
    is_for_publishers: bool = False

    @property
    def is_period(self) -> bool:
        """Return True if the value is a duration in nanoseconds."""
        return self.field.endswith("_ns")

    @property
    def is_flag(self) -> bool:
        """Return True if the value is True or False."""
        return self.enum is None and self.limits is None and not self.is_period

    def is_announced(self, *, is_writer: bool) -> bool:
        """Return True if writers or readers of DDS have the policy and announce it."""
        return bool(self.dds) and (is_writer or not self.is_for_publishers)


POLICIES = (
    Policy(
        "reliability",
        "reliability",
        QoSPolicyKind.RELIABILITY,
        Reliability.RELIABLE,
        "Reliability",
        enum=Reliability,
        rule=OrderRule(
            Reliability.BEST_EFFORT,
            Reliability.RELIABLE,
            "Best effort publisher and reliable subscription",
            "Publisher reliability is {} and subscription reliability is {}",
            "Reliable subscription, but publisher is {}",
            "Best effort publisher, but subscription is {}",
        ),
        dds="reliability",
        dds_values=(Reliability.BEST_EFFORT, Reliability.RELIABLE),
    ),
    Policy(
        "history",
        "history",
        QoSPolicyKind.HISTORY,
        History.KEEP_LAST,
        "History (Depth)",
        enum=History,
        dds="history",
        dds_values=(History.KEEP_LAST, History.KEEP_ALL),
    ),
    Policy("depth", "depth", QoSPolicyKind.DEPTH, 1, limits=(0, MAX_DEPTH), dds="history"),
    Policy(
        "durability",
        "durability",
        QoSPolicyKind.DURABILITY,
        Durability.VOLATILE,
        "Durability",
        enum=Durability,
        rule=OrderRule(
            Durability.VOLATILE,
            Durability.TRANSIENT_LOCAL,
            "Volatile publisher and transient local subscription",
            # "durabilty" is how rmw spells it, and tools compare texts.
            "Publisher durabilty is {} and subscription durability is {}",
            "Transient local subscription, but publisher is {}",
            "Volatile publisher, but subscription is {}",
        ),
        dds="durability",
        dds_values=(Durability.VOLATILE, Durability.TRANSIENT_LOCAL),
    ),
    Policy(
        "lifespan_ns",
        "lifespan",
        QoSPolicyKind.LIFESPAN,
        INFINITE_NS,
        "Lifespan",
        dds="lifespan",
        is_for_publishers=True,
    ),
    Policy(
        "deadline_ns",
        "deadline",
        QoSPolicyKind.DEADLINE,
        INFINITE_NS,
        "Deadline",
        rule=DurationRule(
            "Subscription has a deadline, but publisher does not",
            "Subscription deadline is less than publisher deadline",
        ),
        dds="deadline",
    ),
    Policy(
        "liveliness",
        "liveliness",
        QoSPolicyKind.LIVELINESS,
        Liveliness.AUTOMATIC,
        "Liveliness",
        enum=Liveliness,
        rule=OrderRule(
            Liveliness.AUTOMATIC,
            Liveliness.MANUAL_BY_TOPIC,
            "Publisher's liveliness is automatic and subscription's is manual by topic",
            "Publisher liveliness is {} and subscription liveliness is {}",
            "Subscription's liveliness is manual by topic, but publisher's is {}",
            "Publisher's liveliness is automatic, but subscription's is {}",
        ),
        dds="liveliness",
        dds_values=(Liveliness.AUTOMATIC, None, Liveliness.MANUAL_BY_TOPIC),
    ),
    Policy(
        "liveliness_lease_ns",
        "liveliness_lease_duration",
        QoSPolicyKind.LIVELINESS_LEASE_DURATION,
        INFINITE_NS,
        "Liveliness lease duration",
        rule=DurationRule(
            "Subscription has a liveliness lease duration, but publisher does not",
            "Subscription liveliness lease duration is less than publisher",
        ),
        dds="liveliness",
    ),
    Policy(
        "avoid_ros_namespace_conventions",
        "avoid_ros_namespace_conventions",
        QoSPolicyKind.AVOID_ROS_NAMESPACE_CONVENTIONS,
        False,
    ),
)
"""All policies, in the order of ``ros2 topic info --verbose``, which is also the order in which DDS checks them.

Checks of a profile, `effective`, matching, DDS, files of rosbag2, texts and the rclpy layer follow this table. Zenoh
does not: its form is the form of rmw_zenoh. CONTRIBUTING.md has the steps to add a policy.
"""
DDS_POLICIES: dict[str, tuple[Policy, ...]] = {
    policy.dds: tuple(other for other in POLICIES if other.dds == policy.dds) for policy in POLICIES if policy.dds
}
"""Policies of ROS that DDS has, by the name of the policy in DDS."""
ENUMS = {policy.field: policy.enum for policy in POLICIES if policy.enum is not None}
"""Enum classes of QoS policies, by the field of `QoSProfile` that has a member of the enum as value."""
PERIODS = {policy.field: policy.rmw_name for policy in POLICIES if policy.is_period}
"""Names in rmw of the QoS policies whose value is a duration, by field of `QoSProfile`."""
_LIMITS = {policy.field: policy.limits for policy in POLICIES if policy.limits is not None}
_FLAGS = tuple(policy.field for policy in POLICIES if policy.is_flag)


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
        for name, (lowest, highest) in _LIMITS.items():
            number = getattr(self, name)
            if number.__class__ is not int or not lowest <= number <= highest:
                raise InvalidQoSError(f"{name} must be an int from {lowest} to {highest}, got {number!r}")
        for name in PERIODS:
            period = getattr(self, name)
            if period.__class__ is not int or not 0 <= period <= INFINITE_NS:
                raise InvalidQoSError(f"{name} must be an int of nanoseconds from 0 to 2**63-1, got {period!r}")
        for name in _FLAGS:
            flag = getattr(self, name)
            if flag.__class__ is not bool:
                raise InvalidQoSError(f"{name} must be True or False, got {flag!r}")

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
    values: dict[str, Any] = dict(_NOT_ANNOUNCED[is_writer])
    for field, open_values, unset in _ANNOUNCED[is_writer]:
        value = getattr(qos, field)
        values[field] = unset if value in open_values else value
    values["depth"] = 0 if values["history"] is History.KEEP_ALL else max(1, qos.depth)
    return QoSProfile(**values)


def _open_values(policy: Policy) -> tuple[int, ...]:
    if policy.enum is not None:
        return tuple(member for member in policy.enum if member not in policy.dds_values)
    return (UNSPECIFIED_NS,) if policy.is_period else ()


_ANNOUNCED = tuple(
    tuple(
        (policy.field, _open_values(policy), policy.unset)
        for policy in POLICIES
        if policy.is_announced(is_writer=is_writer)
    )
    for is_writer in (False, True)
)
"""Policies that a reader, and a writer, announces: the field, the values that leave the choice to the middleware, and
the value that discovery reports for those."""
_NOT_ANNOUNCED = tuple(
    {policy.field: policy.unset for policy in POLICIES if not policy.is_announced(is_writer=is_writer)}
    for is_writer in (False, True)
)
"""Values that discovery reports for the policies that a reader, and a writer, does not announce."""


# -------------------------------------------------------------------------------------------------------- compatibility


class Compatibility(Enum):
    """Result of comparing two QoS profiles: compatible, possibly incompatible (WARNING), or incompatible (ERROR)."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class CompatibilityResult:
    """Result of comparing the QoS profiles of a publisher and a subscription, with reasons.

    Attributes:
        reason: fragments that each end in ``;``; empty if the result is OK.
        policies: the incompatible policies, in the order in which DDS checks them; the lease of liveliness counts as
            LIVELINESS, as in DDS. Empty unless the result is ERROR.
    """

    compatibility: Compatibility
    reason: str
    policies: tuple[QoSPolicyKind, ...] = ()

    @property
    def matches(self) -> bool:
        """False if the two endpoints will certainly not communicate."""
        return self.compatibility is not Compatibility.ERROR


def check_compatible(offered: QoSProfile, requested: QoSProfile) -> CompatibilityResult:
    """Return whether a publisher with `offered` and a subscription with `requested` communicate, and why not.

    As in rmw, there are no warnings if there is an error. Unlike rmw, an infinite duration counts as unspecified:
    discovered profiles contain infinite ones, and DDS matches them.
    """
    # Source: docs/internals/protocol.md 7.6.
    errors = _mismatches(offered, requested)
    if errors:
        text = "".join(f"ERROR: {text};" for _, text in errors)
        return CompatibilityResult(Compatibility.ERROR, text, tuple(dict.fromkeys(kind for kind, _ in errors)))
    warnings = [f"WARNING: {text};" for text in _possible_mismatches(offered, requested)]
    if warnings:
        return CompatibilityResult(Compatibility.WARNING, "".join(warnings))
    return CompatibilityResult(Compatibility.OK, "")


def _mismatches(offered: QoSProfile, requested: QoSProfile) -> list[tuple[QoSPolicyKind, str]]:
    mismatches = []
    for field, kind, mismatch in _RULES:
        if text := mismatch(getattr(offered, field), getattr(requested, field)):
            mismatches.append((kind, text))
    return mismatches


def _possible_mismatches(offered: QoSProfile, requested: QoSProfile) -> Iterator[str]:
    for field, possible_mismatch in _ORDER_RULES:
        if text := possible_mismatch(getattr(offered, field), getattr(requested, field)):
            yield text


_RULES = tuple(
    (policy.field, DDS_POLICIES[policy.dds][0].kind, policy.rule.mismatch)
    for policy in POLICIES
    if policy.rule is not None
)
"""Matching rules, each with the field of `QoSProfile` and the kind of the policy of DDS that the field belongs to."""
_ORDER_RULES = tuple(
    (policy.field, policy.rule.possible_mismatch) for policy in POLICIES if isinstance(policy.rule, OrderRule)
)


def describe_policies(*, theirs: QoSProfile, ours: QoSProfile, policies: Iterable[str]) -> str:
    """Return a text about the policies in which two profiles differ, such as ``reliability BEST_EFFORT, here
    RELIABLE``.

    Only `policies` are compared, which are lower-case names.
    """
    texts = []
    for policy in policies:
        for name in _FIELDS[policy]:
            their_text, our_text = (_value_text(getattr(profile, name)) for profile in (theirs, ours))
            if their_text != our_text:
                texts.append(f"{name.removesuffix('_ns').replace('_', ' ')} {their_text}, here {our_text}")
    return "; ".join(texts)


_FIELDS: dict[str, list[str]] = {}
"""Names of the fields of `QoSProfile` for each QoS policy that influences matching, by the policy's lower-case name."""
for _field, _kind, _ in _RULES:
    _FIELDS.setdefault(_kind.name.lower(), []).append(_field)


def _value_text(value: IntEnum | int) -> str:
    if isinstance(value, IntEnum):
        return value.name
    return "none" if value in (UNSPECIFIED_NS, INFINITE_NS) else f"{value / NS_PER_S:g} s"


_PRESETS = {
    "DEFAULT": DEFAULT,
    "SENSOR_DATA": SENSOR_DATA,
    "SERVICES_DEFAULT": SERVICES_DEFAULT,
    "BEST_AVAILABLE": BEST_AVAILABLE,
}
"""Presets that errors recommend, by their names in `rosidl_py_gen.runtime.qos`."""


def find_preset(qos: QoSProfile, *, publisher: bool, peers: Sequence[QoSProfile], is_service: bool = False) -> str:
    """Return the name of a QoS preset that is compatible with the profiles of all `peers`; empty if none is.

    If several presets are compatible, the result is close to `qos`.
    """
    names = ["DEFAULT", "SENSOR_DATA"]
    if qos.reliability is Reliability.BEST_EFFORT:
        names.reverse()
    for name in ["SERVICES_DEFAULT"] if is_service else [*names, "BEST_AVAILABLE"]:
        preset = resolve_best_available(_PRESETS[name], publisher=publisher, peers=peers)
        pairs = ((preset, peer) if publisher else (peer, preset) for peer in peers)
        if all(check_compatible(offer, request).matches for offer, request in pairs):
            return name
    return ""


def resolve_best_available(profile: QoSProfile, *, publisher: bool, peers: Sequence[QoSProfile]) -> QoSProfile:
    """Replace BEST_AVAILABLE policies of a new publisher or subscription by values that match its discovered `peers`.

    Without peers a subscription becomes BEST_EFFORT, VOLATILE and AUTOMATIC, which match any publisher that appears
    later. Source: docs/internals/protocol.md 7.5.
    """
    manual = [peer.liveliness is Liveliness.MANUAL_BY_TOPIC for peer in peers]
    is_reliable = publisher or _all_of_some([peer.reliability is Reliability.RELIABLE for peer in peers])
    is_transient = publisher or _all_of_some([peer.durability is Durability.TRANSIENT_LOCAL for peer in peers])
    is_manual = any(manual) if publisher else _all_of_some(manual)
    best = QoSProfile(
        reliability=Reliability.RELIABLE if is_reliable else Reliability.BEST_EFFORT,
        durability=Durability.TRANSIENT_LOCAL if is_transient else Durability.VOLATILE,
        deadline_ns=_best_duration(publisher, [peer.deadline_ns for peer in peers]),
        liveliness=Liveliness.MANUAL_BY_TOPIC if is_manual else Liveliness.AUTOMATIC,
        liveliness_lease_ns=_best_duration(publisher, [peer.liveliness_lease_ns for peer in peers]),
    )
    return _replace_best_available(profile, best)


def _all_of_some(values: list[bool]) -> bool:
    return bool(values) and all(values)


def without_best_available(profile: QoSProfile) -> QoSProfile:
    """Replace BEST_AVAILABLE policies by policies of `SERVICES_DEFAULT`, for a client or server of a service."""
    return _replace_best_available(profile, SERVICES_DEFAULT)


def _best_duration(publisher: bool, peers_ns: Sequence[int]) -> int:
    # An unspecified period is endless for DDS, so it must lose a "smallest" and win a "largest".
    periods = [INFINITE_NS if value == UNSPECIFIED_NS else value for value in peers_ns]
    best = (min if publisher else max)(periods, default=INFINITE_NS)
    return UNSPECIFIED_NS if best == INFINITE_NS else best


def _replace_best_available(profile: QoSProfile, best: QoSProfile) -> QoSProfile:
    replaced = [name for name, _, _ in _RULES if getattr(profile, name) == getattr(BEST_AVAILABLE, name)]
    return replace(profile, **{name: getattr(best, name) for name in replaced})


FORMAT_VARIABLE = "ROSIDL_PY_GEN_ZENOH_FORMAT"
"""Name of an environment variable. If its value is ``humble``, this process uses Zenoh keys and tokens without type
hashes."""
_MAX_TEXT_CHARS = 600
"""Maximum length of a type's name or hash in `Incompatibility.reason`."""
_MAX_PEER_TYPE_CHARS = 300
"""Maximum length of a type's name in a result of `Incompatibility.reason_of`."""
_MAX_PEER_HASH_CHARS = 200
"""Maximum length of a hash in a result of `Incompatibility.reason_of`."""


class IncompatibilityKind(Enum):
    """Property in which two endpoints differ."""

    TYPE = auto()
    DEFINITION = auto()
    """The definitions of the type differ."""
    QOS = auto()
    HASH_FORMAT = auto()
    """Only one of two endpoints has a type hash in its key, so Zenoh does not match them."""


def qos_incompatibility(writer: DiscoveredEndpoint, reader: DiscoveredEndpoint) -> IncompatibilityKind | None:
    """Return QOS if DDS does not match a writer and a reader of one topic and type because of QoS; else None."""
    return None if check_compatible(writer.qos, reader.qos).matches else IncompatibilityKind.QOS


@dataclass(frozen=True, slots=True)
class Incompatibility:
    """Pair of a writer and a reader that do not exchange messages, or misread them."""

    kind: IncompatibilityKind
    writer: DiscoveredEndpoint
    reader: DiscoveredEndpoint

    @property
    def mismatch_kind(self) -> Literal["type", "definition", "qos"]:
        """Kind of the difference as in `Mismatch.kind`; a missing type hash counts as ``definition``."""
        if self.kind is IncompatibilityKind.TYPE:
            return "type"
        return "qos" if self.kind is IncompatibilityKind.QOS else "definition"

    @property
    def policies(self) -> tuple[QoSPolicyKind, ...]:
        """Incompatible QoS policies; empty if the endpoints differ in another property."""
        if self.kind is not IncompatibilityKind.QOS:
            return ()
        return check_compatible(self.writer.qos, self.reader.qos).policies

    @property
    def reason(self) -> str:
        """Text for people that states the difference with the values of both endpoints."""
        if self.kind is IncompatibilityKind.TYPE:
            return f"types differ, {_type_text(self.writer)} and {_type_text(self.reader)}"
        if self.kind is IncompatibilityKind.DEFINITION:
            writer_hash, reader_hash = (printable(text, _MAX_TEXT_CHARS) for text in _hashes(self.writer, self.reader))
            return f"their definitions of {_type_text(self.writer)} differ: {writer_hash} and {reader_hash}"
        if self.kind is IncompatibilityKind.HASH_FORMAT:
            return (
                "only one of them has a type hash, and Humble has none: all nodes of a domain have to use the format "
                f"of Humble ({FORMAT_VARIABLE}=humble), or none"
            )
        return f"their quality of service is incompatible. {check_compatible(self.writer.qos, self.reader.qos).reason}"

    def reason_of(self, peer: DiscoveredEndpoint, name: str) -> str:
        """Return a text that states how `peer`, one of the two endpoints, differs from the other endpoint.

        `name` names the node of `peer` in the text.
        """
        own = self.reader if peer.is_writer else self.writer
        if self.kind is IncompatibilityKind.TYPE:
            return f"{name} has another type, {_type_text(peer, _MAX_PEER_TYPE_CHARS)}"
        if self.kind is IncompatibilityKind.DEFINITION:
            theirs, ours = (printable(text, _MAX_PEER_HASH_CHARS) for text in _hashes(peer, own))
            of = "its type" if own.topic_key.kind != "topic" else printable(own.type, _MAX_PEER_TYPE_CHARS)
            return f"{name} has another definition of {of}, {theirs}; here it is {ours}"
        policies = (policy.name.lower() for policy in self.policies)
        if differ := describe_policies(theirs=peer.qos, ours=own.qos, policies=policies):
            return f"{name} {'offers' if peer.is_writer else 'requests'} incompatible QoS: {differ}"
        return f"{name} does not match: {self.reason}"


def _type_text(endpoint: DiscoveredEndpoint, max_chars: int = _MAX_TEXT_CHARS) -> str:
    return printable(endpoint.service_type or endpoint.type, max_chars)


def _hashes(one: DiscoveredEndpoint, other: DiscoveredEndpoint) -> tuple[str, str]:
    """Return the type hashes of two endpoints: hashes of the messages if both announce one, else hashes of the
    services.
    """
    if one.type_hash and other.type_hash:
        return one.type_hash, other.type_hash
    return one.service_hash or one.type_hash, other.service_hash or other.type_hash
