"""Whether a peer is connected in all the ways it has to be.

That is looked up in the graph and in DDS, which takes longer than a call should. Decides to remember a yes until the
graph changes; a no is looked at again each time, because nothing announces when endpoints that are known get connected.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.endpoints.scope import Scope

P = TypeVar("P")

_POLL_S = 0.01


class Matching(Generic[P]):
    """The peers of one endpoint; `look` says whether one is connected."""

    def __init__(self, scope: Scope, look: Callable[[P], bool]) -> None:
        self._scope = scope
        self._look = look
        self._connected: set[P] = set()
        self._version = -1

    def is_complete(self, peer: P) -> bool:
        """Whether `peer` is connected."""
        version = self._scope.graph.version
        if version != self._version:
            self._connected.clear()
            self._version = version
        if peer in self._connected:
            return True
        if not self._look(peer):
            return False
        self._connected.add(peer)
        return True

    async def ready(self, peer: P, patience_s: float, is_closed: Callable[[], bool]) -> bool:
        """Wait until `peer` is connected; False when the time passed. Raises `ClosedError`."""
        return await self._scope.wait_until(lambda: self.is_complete(peer), patience_s, is_closed, poll_s=_POLL_S)

    def forget(self) -> None:
        """Look again at all."""
        self._connected.clear()
