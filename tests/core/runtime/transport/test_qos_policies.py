"""Each policy of `QoSProfile` has a row in `POLICIES`, which states its number, its matching rule and its form in DDS.

A new policy fails here for each place that does not have it, also in Zenoh and in bags;
tests/slow/ros_compat/test_qos_policies.py is about rclpy.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import pytest
import yaml

from rosidl_py_gen.bags.metadata import OfferedQoS
from rosidl_py_gen.runtime.transport.api import EndpointSpec, TopicKey
from rosidl_py_gen.runtime.transport.qos import (
    DEFAULT,
    POLICIES,
    SYSTEM_DEFAULT,
    Durability,
    History,
    InvalidQoSError,
    Liveliness,
    QoSPolicyKind,
    QoSProfile,
    Reliability,
    check_compatible,
    effective,
)
from rosidl_py_gen.runtime.transport.zenoh.wire_formats import qos_text, read_qos

CHANGED: dict[str, Any] = {
    "history": History.KEEP_ALL,
    "depth": 7,
    "reliability": Reliability.BEST_EFFORT,
    "durability": Durability.TRANSIENT_LOCAL,
    "deadline_ns": 1_500_000_000,
    "lifespan_ns": 2_500_000_000,
    "liveliness": Liveliness.MANUAL_BY_TOPIC,
    "liveliness_lease_ns": 3_500_000_000,
    "avoid_ros_namespace_conventions": True,
}
"""A value of each policy that is not its default."""
METHODS: dict[str, Callable[[QoSProfile], QoSProfile]] = {
    "history": QoSProfile.keep_all,
    "depth": lambda profile: profile.keep_last(7),
    "reliability": QoSProfile.best_effort,
    "durability": QoSProfile.transient_local,
    "deadline_ns": lambda profile: profile.deadline(1.5),
    "lifespan_ns": lambda profile: profile.lifespan(2.5),
    "liveliness": QoSProfile.manual_liveliness,
    "liveliness_lease_ns": lambda profile: profile.automatic_liveliness(3.5),
    "avoid_ros_namespace_conventions": QoSProfile.no_ros_prefix,
}
"""A method of profiles that gives each policy its changed value."""
MATCHED = {"reliability", "durability", "deadline_ns", "liveliness", "liveliness_lease_ns"}
"""Policies that keep a publisher and a subscription from matching."""
FOR_PUBLISHERS = {"lifespan_ns"}
ANNOUNCED = sorted(CHANGED.keys() - {"avoid_ros_namespace_conventions"})  # which is a matter of the topic's name
BAG_PROFILE = replace(DEFAULT, **{field: CHANGED[field] for field in ANNOUNCED})
FIELDS = sorted(field.name for field in fields(QoSProfile))


def changed(field: str) -> QoSProfile:
    return replace(DEFAULT, **{field: CHANGED[field]})


def test_every_policy_has_a_row_a_changed_value_and_a_number() -> None:
    assert sorted(policy.field for policy in POLICIES) == sorted(CHANGED) == FIELDS
    assert [policy.kind.name for policy in POLICIES] == [policy.rmw_name.upper() for policy in POLICIES]
    assert {policy.kind for policy in POLICIES} == set(QoSPolicyKind) - {QoSPolicyKind.INVALID}
    assert [field for field in FIELDS if CHANGED[field] == getattr(DEFAULT, field)] == []


@pytest.mark.parametrize("field", FIELDS)
def test_every_policy_has_a_method_that_sets_it(field: str) -> None:
    assert getattr(METHODS[field](DEFAULT), field) == CHANGED[field]


@pytest.mark.parametrize("value", [-(2**40), 2**70, 1.5, "x", None])
@pytest.mark.parametrize("field", FIELDS)
def test_wrong_values_of_every_policy_are_refused(field: str, value: object) -> None:
    with pytest.raises(InvalidQoSError, match=field):
        replace(DEFAULT, **{field: value})


@pytest.mark.dds
@pytest.mark.parametrize("is_writer", [True, False])
@pytest.mark.parametrize("field", ANNOUNCED)
def test_dds_endpoints_have_the_policy(field: str, is_writer: bool) -> None:
    from rosidl_py_gen.runtime.transport.cyclone.endpoints import endpoint_qos, read_profile
    from rosidl_py_gen.runtime.transport.cyclone.library import CycloneApi, DdscLibrary, load

    library = load(os.environ)
    assert isinstance(library, DdscLibrary)
    api, profile = CycloneApi(library.handle), effective(changed(field), is_writer=is_writer)
    with endpoint_qos(api, EndpointSpec(TopicKey("topic", "/t"), "a/msg/B", profile), is_writer=is_writer) as qos:
        read = read_profile(api, qos, is_writer=is_writer)
    assert read == profile
    expected = (
        CHANGED[field]
        if is_writer or field not in FOR_PUBLISHERS
        else getattr(effective(DEFAULT, is_writer=False), field)
    )
    assert getattr(read, field) == expected


def test_enums_have_the_numbers_of_dds() -> None:
    numbers = {
        policy.field: {member.name: number for number, member in enumerate(policy.dds_values) if member is not None}
        for policy in POLICIES
        if policy.dds_values
    }
    assert numbers == {
        "reliability": {"BEST_EFFORT": 0, "RELIABLE": 1},
        "history": {"KEEP_LAST": 0, "KEEP_ALL": 1},
        "durability": {"VOLATILE": 0, "TRANSIENT_LOCAL": 1},
        "liveliness": {"AUTOMATIC": 0, "MANUAL_BY_TOPIC": 2},
    }


@pytest.mark.parametrize("field", FIELDS)
def test_only_policies_with_a_rule_keep_endpoints_from_matching(field: str) -> None:
    profiles = [effective(profile, is_writer=True) for profile in (DEFAULT, changed(field))]
    results = [check_compatible(offered, requested) for offered in profiles for requested in profiles]
    mismatches = [result for result in results if not result.matches]
    assert bool(mismatches) == (field in MATCHED)
    for result in mismatches:
        (kind,) = result.policies
        assert field.startswith(kind.name.lower()) and result.reason.startswith("ERROR: ")


def test_discovery_reports_the_choice_of_the_middleware() -> None:
    chosen = effective(SYSTEM_DEFAULT, is_writer=True)
    assert chosen == QoSProfile(depth=1).deadline(math.inf).lifespan(math.inf).automatic_liveliness(math.inf)
    assert {policy.field: policy.unset for policy in POLICIES} == {name: getattr(chosen, name) for name in FIELDS}


@pytest.mark.parametrize("field", ANNOUNCED)
def test_zenoh_tokens_have_the_policy(field: str) -> None:
    read = read_qos(qos_text(changed(field)))
    assert read is not None and getattr(read, field) == CHANGED[field] != getattr(read_qos(qos_text(DEFAULT)), field)


@pytest.mark.parametrize("field", ANNOUNCED)
def test_bags_have_the_policy(field: str) -> None:
    assert OfferedQoS.parse(OfferedQoS([changed(field)]).text) == [changed(field)]


@pytest.mark.parametrize("field", ANNOUNCED)
def test_policies_that_a_bag_lacks_have_their_defaults(field: str) -> None:
    rmw_name = next(policy.rmw_name for policy in POLICIES if policy.field == field)
    (row,) = yaml.safe_load(OfferedQoS([BAG_PROFILE]).text)
    del row[rmw_name]
    expected = replace(BAG_PROFILE, **{field: getattr(DEFAULT, field)})
    assert OfferedQoS.parse(yaml.safe_dump([row])) == [expected] != [BAG_PROFILE]


@pytest.mark.parametrize("text", ["- {}", "- {colour: 1}"])
def test_bag_text_without_policies_has_no_profile(text: str) -> None:
    assert OfferedQoS.parse(text) == []
