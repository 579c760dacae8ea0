"""Profiles, presets, matching and texts of incompatibilities: the tables of docs/internals/protocol.md 7."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from rosidl_py_gen.runtime.transport import qos
from rosidl_py_gen.runtime.transport.api import DiscoveredEndpoint, TopicKey
from rosidl_py_gen.runtime.transport.qos import (
    BEST_AVAILABLE,
    DEFAULT,
    INFINITE_NS,
    SENSOR_DATA,
    SYSTEM_DEFAULT,
    Compatibility,
    Durability,
    History,
    Incompatibility,
    IncompatibilityKind,
    InvalidQoSError,
    Liveliness,
    QoSProfile,
    Reliability,
    as_profile,
    check_compatible,
    resolve_best_available,
    without_best_available,
)

REL, BE = Reliability.RELIABLE, Reliability.BEST_EFFORT
VOL, TL = Durability.VOLATILE, Durability.TRANSIENT_LOCAL


def test_enumerations_have_the_numbers_of_rmw() -> None:
    assert [int(v) for v in History] == [0, 1, 2, 3]
    names = ("SYSTEM_DEFAULT", "RELIABLE", "BEST_EFFORT", "UNKNOWN", "BEST_AVAILABLE")
    assert {v.name: int(v) for v in Reliability} == {name: number for number, name in enumerate(names)}
    names = ("SYSTEM_DEFAULT", "AUTOMATIC", "", "MANUAL_BY_TOPIC", "UNKNOWN", "BEST_AVAILABLE")
    assert {v.name: int(v) for v in Liveliness} == {name: number for number, name in enumerate(names) if name}
    assert [int(v) for v in (Durability.TRANSIENT_LOCAL, Durability.VOLATILE)] == [1, 2]


def test_qos_builder_calls_chain_and_return_new_profiles() -> None:
    profile = QoSProfile().keep_last(5).best_effort().transient_local().deadline(0.5).lifespan(2).manual_liveliness(3)
    assert profile == QoSProfile(
        History.KEEP_LAST, 5, BE, TL, 500_000_000, 2 * 10**9, Liveliness.MANUAL_BY_TOPIC, 3 * 10**9
    )
    assert QoSProfile() == DEFAULT
    assert profile.keep_all().depth == 0 and profile.keep_all().history is History.KEEP_ALL
    assert profile.reliable().volatile().automatic_liveliness().liveliness_lease_ns == 3 * 10**9
    assert profile.deadline(math.inf).deadline_ns == INFINITE_NS
    assert profile.no_ros_prefix().avoid_ros_namespace_conventions


def test_int_is_converted_to_keep_last_depth() -> None:
    assert as_profile(7) == DEFAULT.keep_last(7)
    assert as_profile(SYSTEM_DEFAULT) is SYSTEM_DEFAULT


@pytest.mark.parametrize("bad", [-1, True, 2**31, "10", 1.5])
def test_invalid_qos_depths_are_refused(bad: object) -> None:
    with pytest.raises(InvalidQoSError):
        as_profile(bad)  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", [-1.0, math.nan, -math.inf, 1e300, "x", None, True, [1]])
def test_invalid_qos_durations_are_refused(bad: float) -> None:
    with pytest.raises(InvalidQoSError, match="deadline must be seconds"):
        QoSProfile().deadline(bad)


def test_rmw_numbers_are_converted_to_policies() -> None:
    profile = QoSProfile(reliability=2, durability=1, liveliness=3)  # type: ignore[arg-type]
    assert profile.reliability is BE and profile.durability is TL and profile.liveliness is Liveliness.MANUAL_BY_TOPIC
    assert profile == QoSProfile().best_effort().transient_local().manual_liveliness()


@pytest.mark.parametrize(
    ("field", "bad", "words"),
    [
        ("reliability", "best_effort", r"got 'best_effort': write Reliability\.BEST_EFFORT"),
        ("history", 10, r"written QoSProfile\(depth=10\)"),
        ("history", "keep_all", r"got 'keep_all': write History\.KEEP_ALL"),
        ("durability", "sometimes", r"one of .*Durability\.VOLATILE.*; got 'sometimes'"),
        ("reliability", 7, r"one of .*Reliability\.RELIABLE.*; got 7"),
        ("reliability", True, "got True"),
        ("reliability", 1.0, "got 1.0"),
        ("durability", Reliability.RELIABLE, "got <Reliability.RELIABLE: 1>"),
        ("liveliness", 2, "got 2"),
        ("liveliness", None, "got None"),
        ("depth", True, "depth must be an int"),
        ("depth", 1.0, "depth must be an int"),
        ("deadline_ns", True, "deadline_ns must be an int"),
        ("lifespan_ns", 1e9, "lifespan_ns must be an int"),
        ("liveliness_lease_ns", -1, "liveliness_lease_ns must be an int"),
        ("avoid_ros_namespace_conventions", "yes", "must be True or False, got 'yes'"),
    ],
)
def test_invalid_qos_values_are_refused_with_advice(field: str, bad: Any, words: str) -> None:
    with pytest.raises(InvalidQoSError, match=words):
        QoSProfile(**{field: bad})
    with pytest.raises(InvalidQoSError, match=words):
        replace(QoSProfile(), **{field: bad})


@pytest.mark.parametrize("name", ["history", "reliability", "durability", "liveliness"])
def test_unknown_policies_of_discovered_profiles_cannot_be_used(name: str) -> None:
    kind = type(getattr(DEFAULT, name))
    discovered = replace(DEFAULT, **{name: kind["UNKNOWN"]})
    with pytest.raises(InvalidQoSError, match=rf"{name} must not be {kind.__name__}\.UNKNOWN"):
        as_profile(discovered)


TRANSIENT = QoSProfile().transient_local()


def test_stronger_offers_match_and_infinite_means_no_deadline() -> None:
    strong = QoSProfile().transient_local().manual_liveliness(1).deadline(1)
    weak = QoSProfile().best_effort().automatic_liveliness(2).deadline(2)
    assert check_compatible(strong, weak).compatibility is Compatibility.OK
    plain = QoSProfile().automatic_liveliness()
    assert check_compatible(plain, plain.deadline(math.inf).automatic_liveliness(math.inf)).reason == ""


def test_best_available_publisher_takes_the_strongest_policies() -> None:
    peers = [QoSProfile().deadline(2), QoSProfile().deadline(1).manual_liveliness(4)]
    got = resolve_best_available(BEST_AVAILABLE, publisher=True, peers=peers)
    assert (got.reliability, got.durability, got.liveliness) == (REL, TL, Liveliness.MANUAL_BY_TOPIC)
    assert (got.deadline_ns, got.liveliness_lease_ns) == (10**9, 4 * 10**9)


def test_best_available_subscription_requests_only_policies_all_publishers_offer() -> None:
    peers = [TRANSIENT.manual_liveliness(1), QoSProfile().best_effort().manual_liveliness(2)]
    got = resolve_best_available(BEST_AVAILABLE, publisher=False, peers=peers)
    assert (got.reliability, got.durability, got.liveliness) == (BE, VOL, Liveliness.MANUAL_BY_TOPIC)
    assert (got.deadline_ns, got.liveliness_lease_ns) == (0, 2 * 10**9)
    for peer in peers:
        assert check_compatible(peer, got).matches


def test_best_available_subscription_without_publishers_matches_any_that_appears_later() -> None:
    got = resolve_best_available(BEST_AVAILABLE, publisher=False, peers=[])
    assert (got.reliability, got.durability, got.liveliness) == (BE, VOL, Liveliness.AUTOMATIC)
    assert (got.deadline_ns, got.liveliness_lease_ns) == (0, 0)
    assert all(check_compatible(offered, got).matches for offered in (DEFAULT, DEFAULT.best_effort()))


def test_explicit_policies_stay_and_services_never_use_best_available() -> None:
    explicit = QoSProfile().best_effort()
    assert resolve_best_available(explicit, publisher=False, peers=[DEFAULT]) == explicit
    assert without_best_available(BEST_AVAILABLE) == qos.SERVICES_DEFAULT


def test_each_incompatibility_kind_has_text_for_both_endpoints_and_for_the_peer() -> None:
    writer = DiscoveredEndpoint(b"w", b"", True, TopicKey("topic", "/t"), "p/msg/A", SENSOR_DATA, "RIHS01_1")
    reader = replace(writer, guid=b"r", is_writer=False, qos=DEFAULT, type_hash="RIHS01_2")
    other = replace(reader, type="p/msg/B")
    texts = {
        IncompatibilityKind.TYPE: ("types differ, p/msg/A and p/msg/B", "X has another type, p/msg/A"),
        IncompatibilityKind.DEFINITION: (
            "their definitions of p/msg/A differ: RIHS01_1 and RIHS01_2",
            "X has another definition of p/msg/A, RIHS01_1; here it is RIHS01_2",
        ),
        IncompatibilityKind.QOS: (
            "their quality of service is incompatible. ERROR: Best effort publisher and reliable subscription;",
            "X offers incompatible QoS: reliability BEST_EFFORT, here RELIABLE",
        ),
    }
    for kind, expected in texts.items():
        incompatibility = Incompatibility(kind, writer, other if kind is IncompatibilityKind.TYPE else reader)
        assert (incompatibility.reason, incompatibility.reason_of(writer, "X")) == expected
        assert bool(incompatibility.policies) == (kind is IncompatibilityKind.QOS)
        assert incompatibility.mismatch_kind == kind.name.lower()
    humble = Incompatibility(IncompatibilityKind.HASH_FORMAT, writer, replace(reader, type_hash=""))
    assert "only one of them has a type hash" in humble.reason and humble.mismatch_kind == "definition"
    assert humble.reason_of(writer, "X") == f"X does not match: {humble.reason}"
