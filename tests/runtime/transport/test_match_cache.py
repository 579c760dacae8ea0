"""Positive results of a check are cached until the endpoints change, negative ones are checked again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.qos import DEFAULT, SENSOR_DATA
from rosidl_py_gen.runtime.transport.discovery_events import DiscoveredEndpoint, TopicKey
from rosidl_py_gen.runtime.transport.incompatibility import Incompatibility, IncompatibilityKind
from rosidl_py_gen.runtime.transport.match_cache import MatchCache

if TYPE_CHECKING:
    from collections.abc import Hashable


@dataclass
class Endpoints:
    version: int = 0


def test_only_positive_results_are_cached_and_only_while_nothing_changes() -> None:
    endpoints, connected, checked = Endpoints(), {"a"}, []

    def check(key: Hashable) -> bool:
        checked.append(key)
        return key in connected

    cache = MatchCache(endpoints, check)
    assert [cache.get(key) for key in "aabb"] == [True, True, False, False] and checked == ["a", "b", "b"]
    connected.add("b")
    assert cache.get("b") and cache.get("b") and checked[3:] == ["b"]
    connected.clear()
    assert cache.get("a"), "nothing announces that"
    endpoints.version += 1
    assert not cache.get("a") and not cache.get("b")
    connected.add("a")
    assert cache.get("a")
    cache.clear()
    connected.clear()
    assert not cache.get("a")


def test_a_result_is_not_cached_when_the_endpoints_changed_during_the_check() -> None:
    endpoints = Endpoints()

    def check(_: Hashable) -> bool:
        endpoints.version += 1
        return endpoints.version == 1

    cache = MatchCache(endpoints, check)
    assert cache.get() and not cache.get()


def test_each_kind_of_incompatibility_has_a_text_about_both_and_about_the_peer() -> None:
    writer = DiscoveredEndpoint(b"w", b"", True, TopicKey("topic", "/t"), "p/msg/A", SENSOR_DATA, "RIHS01_1")
    reader = replace(writer, guid=b"r", is_writer=False, qos=DEFAULT, type_hash="RIHS01_2")
    other = replace(reader, type="p/msg/B")
    texts = {
        IncompatibilityKind.TYPE: ("types differ, p/msg/A and p/msg/B", "X has another type, p/msg/A"),
        IncompatibilityKind.DEFINITION: (
            "they have p/msg/A by different definitions, RIHS01_1 and RIHS01_2",
            "X has another definition of p/msg/A, RIHS01_1; here it is RIHS01_2",
        ),
        IncompatibilityKind.QOS: (
            "their quality of service is incompatible. ERROR: Best effort publisher and reliable subscription;",
            "X offers incompatible QoS: reliability BEST_EFFORT, here RELIABLE",
        ),
    }
    for kind, expected in texts.items():
        found = Incompatibility(kind, writer, other if kind is IncompatibilityKind.TYPE else reader)
        assert (found.reason, found.reason_of(writer, "X")) == expected
        assert bool(found.policies) == (kind is IncompatibilityKind.QOS)
        assert found.mismatch_kind == kind.name.lower()
    humble = Incompatibility(IncompatibilityKind.HASH_FORMAT, writer, replace(reader, type_hash=""))
    assert "only one of them has a type hash" in humble.reason and humble.mismatch_kind == "qos"
    assert humble.reason_of(writer, "X") == f"X does not match: {humble.reason}"
