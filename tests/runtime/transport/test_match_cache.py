"""Positive results of a check are cached until the endpoints change, negative ones are checked again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosidl_py_gen.runtime.transport.service_endpoints import MatchCache

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
    assert cache.get("a")  # still cached
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
