"""Compatibility of two endpoints in QoS and type, with texts for people; the texts about QoS equal the texts of rmw."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, IntEnum, auto
from typing import TYPE_CHECKING, Literal

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime.transport.qos import (
    BEST_AVAILABLE,
    DEFAULT,
    INFINITE_NS,
    SENSOR_DATA,
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

    from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint


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
    if offered.reliability is Reliability.BEST_EFFORT and requested.reliability is Reliability.RELIABLE:
        mismatches.append((QoSPolicyKind.RELIABILITY, "Best effort publisher and reliable subscription"))
    if offered.durability is Durability.VOLATILE and requested.durability is Durability.TRANSIENT_LOCAL:
        mismatches.append((QoSPolicyKind.DURABILITY, "Volatile publisher and transient local subscription"))
    deadline = _duration_mismatch(
        offered.deadline_ns,
        requested.deadline_ns,
        "Subscription has a deadline, but publisher does not",
        "Subscription deadline is less than publisher deadline",
    )
    mismatches += [(QoSPolicyKind.DEADLINE, text) for text in deadline]
    if offered.liveliness is Liveliness.AUTOMATIC and requested.liveliness is Liveliness.MANUAL_BY_TOPIC:
        text = "Publisher's liveliness is automatic and subscription's is manual by topic"
        mismatches.append((QoSPolicyKind.LIVELINESS, text))
    lease = _duration_mismatch(
        offered.liveliness_lease_ns,
        requested.liveliness_lease_ns,
        "Subscription has a liveliness lease duration, but publisher does not",
        "Subscription liveliness lease duration is less than publisher",
    )
    return mismatches + [(QoSPolicyKind.LIVELINESS, text) for text in lease]


def _duration_mismatch(offered_ns: int, requested_ns: int, absent: str, shorter: str) -> list[str]:
    open_ended = (UNSPECIFIED_NS, INFINITE_NS)
    if requested_ns in open_ended:
        return []
    if offered_ns in open_ended:
        return [absent]
    return [shorter] if requested_ns < offered_ns else []


_POSSIBLE_MISMATCHES = (
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
"""Possible QoS mismatches, each with the policy, the weakest offer, the strictest request, and three texts.

The texts are for three cases: both values are undetermined, only the offer, or only the request.
"""
_UNDETERMINED = ("SYSTEM_DEFAULT", "UNKNOWN")
"""Names of policy values that are undetermined: the middleware chooses a value in their place, or they were not
discovered."""


def _possible_mismatches(offered: QoSProfile, requested: QoSProfile) -> Iterator[str]:
    for policy, weakest, strictest, both_text, offer_text, request_text in _POSSIBLE_MISMATCHES:
        offer, request = getattr(offered, policy), getattr(requested, policy)
        names = offer.name.lower(), request.name.lower()
        if offer.name in _UNDETERMINED and request.name in _UNDETERMINED:
            yield both_text.format(*names)
        elif offer.name in _UNDETERMINED and request is strictest:
            yield offer_text.format(names[0])
        elif request.name in _UNDETERMINED and offer is weakest:
            yield request_text.format(names[1])


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


_FIELDS = {
    "reliability": ("reliability",),
    "durability": ("durability",),
    "deadline": ("deadline_ns",),
    "liveliness": ("liveliness", "liveliness_lease_ns"),
}
"""Names of the fields of `QoSProfile` for each QoS policy, by the policy's lower-case name."""


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
    names = ("reliability", "durability", "deadline_ns", "liveliness", "liveliness_lease_ns")
    replaced = [name for name in names if getattr(profile, name) == getattr(BEST_AVAILABLE, name)]
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
        """Kind of the difference as in `Mismatch.kind`; other kinds than type and definition count as ``qos``."""
        if self.kind is IncompatibilityKind.TYPE:
            return "type"
        return "definition" if self.kind is IncompatibilityKind.DEFINITION else "qos"

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
