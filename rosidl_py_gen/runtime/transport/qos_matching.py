"""When two quality-of-service profiles match, and what BEST_AVAILABLE becomes.

Decides with values only; texts are those of rmw. Imports `qos.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime.transport import qos as presets
from rosidl_py_gen.runtime.transport.qos import (
    BEST_AVAILABLE_NS,
    INFINITE_NS,
    SERVICES_DEFAULT,
    UNSPECIFIED_NS,
    Durability,
    Liveliness,
    QoSPolicyKind,
    QoSProfile,
    Reliability,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

_T = TypeVar("_T")


class Compatibility(Enum):
    """The verdict of `check_compatible`."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class CompatibilityResult:
    """Verdict and reasons.

    Attributes:
        compatibility: the verdict.
        reason: empty when all is well, else fragments that each end in ``;``.
        policies: those that stand against it, in the order in which DDS looks at them; as there, the lease of
            liveliness counts as LIVELINESS. Empty unless the verdict is ERROR.
    """

    compatibility: Compatibility
    reason: str
    policies: tuple[QoSPolicyKind, ...] = ()

    @property
    def matches(self) -> bool:
        """False when the two endpoints will certainly not communicate."""
        return self.compatibility is not Compatibility.ERROR


def check_compatible(offered: QoSProfile, requested: QoSProfile) -> CompatibilityResult:
    """Say whether a publisher with `offered` and a subscription with `requested` communicate, and why not.

    Warnings are looked for only when there is no error, as rmw does. Unlike rmw an infinite duration counts as
    unspecified: discovered profiles carry infinite ones, and DDS matches them.

    Source: docs/internals/protocol.md 7.6.
    """
    errors = _mismatches(offered, requested)
    if errors:
        text = "".join(f"ERROR: {text};" for _, text in errors)
        return CompatibilityResult(Compatibility.ERROR, text, tuple(dict.fromkeys(kind for kind, _ in errors)))
    warnings = [f"WARNING: {text};" for text in _possible_mismatches(offered, requested)]
    if warnings:
        return CompatibilityResult(Compatibility.WARNING, "".join(warnings))
    return CompatibilityResult(Compatibility.OK, "")


def _mismatches(offered: QoSProfile, requested: QoSProfile) -> list[tuple[QoSPolicyKind, str]]:
    found = []
    if offered.reliability is Reliability.BEST_EFFORT and requested.reliability is Reliability.RELIABLE:
        found.append((QoSPolicyKind.RELIABILITY, "Best effort publisher and reliable subscription"))
    if offered.durability is Durability.VOLATILE and requested.durability is Durability.TRANSIENT_LOCAL:
        found.append((QoSPolicyKind.DURABILITY, "Volatile publisher and transient local subscription"))
    deadline = _duration_mismatch(
        offered.deadline_ns,
        requested.deadline_ns,
        "Subscription has a deadline, but publisher does not",
        "Subscription deadline is less than publisher deadline",
    )
    found += [(QoSPolicyKind.DEADLINE, text) for text in deadline]
    if offered.liveliness is Liveliness.AUTOMATIC and requested.liveliness is Liveliness.MANUAL_BY_TOPIC:
        text = "Publisher's liveliness is automatic and subscription's is manual by topic"
        found.append((QoSPolicyKind.LIVELINESS, text))
    lease = _duration_mismatch(
        offered.liveliness_lease_ns,
        requested.liveliness_lease_ns,
        "Subscription has a liveliness lease duration, but publisher does not",
        "Subscription liveliness lease duration is less than publisher",
    )
    return found + [(QoSPolicyKind.LIVELINESS, text) for text in lease]


def _duration_mismatch(offered_ns: int, requested_ns: int, absent: str, shorter: str) -> list[str]:
    open_ended = (UNSPECIFIED_NS, INFINITE_NS)
    if requested_ns in open_ended:
        return []
    if offered_ns in open_ended:
        return [absent]
    return [shorter] if requested_ns < offered_ns else []


_DOUBTS = (
    (
        "reliability",
        Reliability.BEST_EFFORT,
        Reliability.RELIABLE,
        "Publisher reliability is {} and subscription reliability is {}",
        "Reliable subscription, but publisher is {}",
        "Best effort publisher, but subscription is {}",
    ),
    (
        "durability",
        Durability.VOLATILE,
        Durability.TRANSIENT_LOCAL,
        # "durabilty" is how rmw spells it, and tools compare texts.
        "Publisher durabilty is {} and subscription durability is {}",
        "Transient local subscription, but publisher is {}",
        "Volatile publisher, but subscription is {}",
    ),
    (
        "liveliness",
        Liveliness.AUTOMATIC,
        Liveliness.MANUAL_BY_TOPIC,
        "Publisher liveliness is {} and subscription liveliness is {}",
        "Subscription's liveliness is manual by topic, but publisher's is {}",
        "Publisher's liveliness is automatic, but subscription's is {}",
    ),
)
"""Policy, the offer that may be too little, the request that may be too much, and what is said when both are open, the
offer is open to such a request, the request is open to such an offer."""
_OPEN = ("SYSTEM_DEFAULT", "UNKNOWN")
"""What leaves its meaning to the middleware, or was not discovered."""


def _possible_mismatches(offered: QoSProfile, requested: QoSProfile) -> Iterator[str]:
    for policy, least, most, both_open, open_offer, open_request in _DOUBTS:
        offer, request = getattr(offered, policy), getattr(requested, policy)
        shown = offer.name.lower(), request.name.lower()
        if offer.name in _OPEN and request.name in _OPEN:
            yield both_open.format(*shown)
        elif offer.name in _OPEN and request is most:
            yield open_offer.format(shown[0])
        elif request.name in _OPEN and offer is least:
            yield open_request.format(shown[1])


def describe_policies(*, theirs: QoSProfile, ours: QoSProfile, policies: Iterable[str]) -> str:
    """Return the values of policies, by lower-case names: ``reliability BEST_EFFORT, here RELIABLE``."""
    found = []
    for policy in policies:
        for name, unit in _VALUES[policy]:
            one, other = (_value_text(getattr(profile, name), unit) for profile in (theirs, ours))
            if one != other:
                found.append(f"{name.removesuffix('_ns').replace('_', ' ')} {one}, here {other}")
    return "; ".join(found)


_VALUES = {
    "reliability": (("reliability", ""),),
    "durability": (("durability", ""),),
    "deadline": (("deadline_ns", "s"),),
    "liveliness": (("liveliness", ""), ("liveliness_lease_ns", "s")),
}
"""Fields of a profile that a policy consists of, and their units."""


def _value_text(value: IntEnum | int, unit: str) -> str:
    if isinstance(value, IntEnum):
        return value.name
    return "none" if value in (UNSPECIFIED_NS, INFINITE_NS) else f"{value / NS_PER_S:g} {unit}"


def find_preset(qos: QoSProfile, *, publisher: bool, peers: Sequence[QoSProfile], is_service: bool = False) -> str:
    """Return the name of a preset that matches all peers, close to `qos` if there are several; empty if none does."""
    names = ["DEFAULT", "SENSOR_DATA"]
    if qos.reliability is Reliability.BEST_EFFORT:
        names.reverse()
    for name in ["SERVICES_DEFAULT"] if is_service else [*names, "BEST_AVAILABLE"]:
        preset = resolve_best_available(getattr(presets, name), publisher=publisher, peers=peers)
        pairs = ((preset, peer) if publisher else (peer, preset) for peer in peers)
        if all(check_compatible(offer, request).matches for offer, request in pairs):
            return name
    return ""


# ---------------------------------------------------------------------------------------------------- best available


def resolve_best_available(profile: QoSProfile, *, publisher: bool, peers: Sequence[QoSProfile]) -> QoSProfile:
    """Replace the BEST_AVAILABLE policies of a new endpoint by what its discovered `peers` allow.

    `publisher` says which side is created; `peers` are the endpoints of the other side. This happens once, at
    creation; with no peer a subscription becomes RELIABLE, TRANSIENT_LOCAL and MANUAL_BY_TOPIC, because "all of
    nobody" holds.

    Source: docs/internals/protocol.md 7.5.
    """
    return replace(
        profile,
        reliability=_unless(
            profile.reliability,
            Reliability.BEST_AVAILABLE,
            Reliability.RELIABLE
            if publisher or all(peer.reliability is Reliability.RELIABLE for peer in peers)
            else Reliability.BEST_EFFORT,
        ),
        durability=_unless(
            profile.durability,
            Durability.BEST_AVAILABLE,
            Durability.TRANSIENT_LOCAL
            if publisher or all(peer.durability is Durability.TRANSIENT_LOCAL for peer in peers)
            else Durability.VOLATILE,
        ),
        liveliness=_unless(
            profile.liveliness,
            Liveliness.BEST_AVAILABLE,
            Liveliness.MANUAL_BY_TOPIC
            if (any if publisher else all)(peer.liveliness is Liveliness.MANUAL_BY_TOPIC for peer in peers)
            else Liveliness.AUTOMATIC,
        ),
        deadline_ns=_best_duration(profile.deadline_ns, publisher, [peer.deadline_ns for peer in peers]),
        liveliness_lease_ns=_best_duration(
            profile.liveliness_lease_ns, publisher, [peer.liveliness_lease_ns for peer in peers]
        ),
    )


def without_best_available(profile: QoSProfile) -> QoSProfile:
    """Replace BEST_AVAILABLE policies by those of `SERVICES_DEFAULT`, as services and clients do.

    Source: docs/internals/protocol.md 7.5.
    """
    default = SERVICES_DEFAULT
    return replace(
        profile,
        reliability=_unless(profile.reliability, Reliability.BEST_AVAILABLE, default.reliability),
        durability=_unless(profile.durability, Durability.BEST_AVAILABLE, default.durability),
        liveliness=_unless(profile.liveliness, Liveliness.BEST_AVAILABLE, default.liveliness),
        deadline_ns=_unless(profile.deadline_ns, BEST_AVAILABLE_NS, default.deadline_ns),
        liveliness_lease_ns=_unless(profile.liveliness_lease_ns, BEST_AVAILABLE_NS, default.liveliness_lease_ns),
    )


def _best_duration(wanted_ns: int, publisher: bool, peers_ns: Sequence[int]) -> int:
    if wanted_ns != BEST_AVAILABLE_NS:
        return wanted_ns
    # An unspecified period is endless for DDS, so it must lose a "smallest" and win a "largest".
    known = [INFINITE_NS if value == UNSPECIFIED_NS else value for value in peers_ns]
    best = (min if publisher else max)(known, default=INFINITE_NS)
    return UNSPECIFIED_NS if best == INFINITE_NS else best


def _unless(value: _T, unwanted: _T, default: _T) -> _T:
    return default if value == unwanted else value
