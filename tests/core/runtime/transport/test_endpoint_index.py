"""Index of discovered endpoints, and the caches that are valid until endpoints of their topics change."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.transport.api import (
    DiscoveredEndpoint,
    EntityLost,
    NodeEntities,
    NodesAnnounced,
    ParticipantDiscovered,
    TopicKey,
)
from rosidl_py_gen.runtime.transport.endpoint_index import EndpointIndex, MatchCache

if TYPE_CHECKING:
    from collections.abc import Hashable

KEY, OTHER_KEY = TopicKey("topic", "/one"), TopicKey("topic", "/other")
PARTICIPANT = bytes(15) + b"\xff"


def endpoint(number: int, topic_key: TopicKey = KEY, *, is_writer: bool = True) -> DiscoveredEndpoint:
    return DiscoveredEndpoint(bytes(15) + bytes([number]), PARTICIPANT, is_writer, topic_key, "a/msg/B", QoSProfile())


def test_match_cache_stores_only_positive_results_until_endpoints_change() -> None:
    index, connected, checked = EndpointIndex(), {"a"}, []

    def check(key: Hashable) -> bool:
        checked.append(key)
        return key in connected

    cache = MatchCache(index, [KEY, OTHER_KEY], check)
    assert [cache[key] for key in "aabb"] == [True, True, False, False] and checked == ["a", "b", "b"]
    connected.add("b")
    assert cache["b"] and cache["b"] and checked[3:] == ["b"]
    connected.clear()
    assert cache["a"]  # cached result
    index.add(endpoint(1, OTHER_KEY))
    assert not cache["a"] and not cache["b"]


def test_result_is_not_cached_if_endpoints_changed_during_the_check() -> None:
    index, results = EndpointIndex(), [True, False]

    def check(_: Hashable) -> bool:
        index.add(endpoint(1))
        return results.pop(0)

    cache = MatchCache(index, [KEY], check)
    assert cache[None] and not cache[None]


def test_match_cache_survives_changes_of_other_topics_and_of_nodes() -> None:
    index, results = EndpointIndex(), [1, 2, 3]
    cache = MatchCache(index, [KEY], lambda _: results.pop(0))
    assert cache[None] == 1
    index.apply(
        [
            ParticipantDiscovered(PARTICIPANT, "/"),
            endpoint(1, OTHER_KEY),
            NodesAnnounced(PARTICIPANT, (NodeEntities("/", "n", frozenset(), frozenset()),)),
            EntityLost(endpoint(1).guid),
        ]
    )
    assert (index.version, cache[None], cache.version) == (4, 1, 0)
    index.add(endpoint(2))
    assert (cache[None], cache.version) == (2, 1)
    index.remove(endpoint(2).guid)
    assert (cache[None], cache.version) == (3, 2)


def test_match_cache_checks_results_again_that_are_not_final() -> None:
    results = [1, 2, 3, 4]
    cache = MatchCache(EndpointIndex(), [KEY], lambda _: results.pop(0), lambda result: result > 2)
    assert [cache[None] for _ in range(4)] == [1, 2, 3, 3]


def test_match_cache_drops_its_results_when_there_are_too_many() -> None:
    cache = MatchCache(EndpointIndex(), [KEY], lambda _: True)
    assert all(cache[number] for number in range(1500)) and len(cache) <= 1000


def test_index_retains_no_reference_to_lost_endpoints_and_closed_caches() -> None:
    index, endpoints = EndpointIndex(), [endpoint(1), endpoint(2, OTHER_KEY), endpoint(3, OTHER_KEY, is_writer=False)]
    caches = [MatchCache(index, [KEY, OTHER_KEY], bool) for _ in range(2)]
    before = [*map(sys.getrefcount, (KEY, OTHER_KEY))]
    index.apply(endpoints)
    index.apply([EntityLost(lost.guid) for lost in endpoints])
    assert (index.version, index.endpoints, index.topic_keys()) == (6, {}, [])
    assert index.take_changed_topics() == {KEY, OTHER_KEY} and index.take_changed_topics() == set()
    assert [*map(sys.getrefcount, (KEY, OTHER_KEY))] == before
    version = caches[0].version
    caches[0].close()
    caches[0].close()
    index.add(endpoints[0])
    assert (caches[0].version, caches[1].version) == (version, version + 1)
