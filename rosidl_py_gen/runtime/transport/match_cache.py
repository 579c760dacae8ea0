"""Cache of which peers are matched: a positive result is cached, a negative one is checked again each time.

DDS reports when endpoints appear and disappear, but not when discovered endpoints become matched. So a positive result
holds until the set of discovered endpoints changes, and a negative one may be outdated a moment later.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

ResultT = TypeVar("ResultT")


class Versioned(Protocol):
    """A set of endpoints whose `version` grows with each change."""

    version: int


class MatchCache(Generic[ResultT]):
    """Results of `check`, cached per key while they are true and the version of `endpoints` stays the same."""

    def __init__(self, endpoints: Versioned, check: Callable[[Hashable], ResultT]) -> None:
        self._endpoints = endpoints
        self._check = check
        self._positive: dict[Hashable, ResultT] = {}
        self._version = -1

    def get(self, key: Hashable = None) -> ResultT:
        """Return the cached result for `key`, or check."""
        version = self._endpoints.version
        if version != self._version:
            self._positive.clear()
            self._version = version
        result = self._positive.get(key)
        if result is None:
            result = self._check(key)
            if result and version == self._version:  # else another thread has seen a newer version
                self._positive[key] = result
        return result

    def clear(self) -> None:
        """Discard all results."""
        self._positive.clear()
