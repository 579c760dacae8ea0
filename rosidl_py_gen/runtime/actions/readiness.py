"""Whether the clients that may send goals would hear the feedback yet.

A client that has just appeared may be connected with the goal service before it is with the feedback topic, and what is
published until then is lost. So is what a reliable DDS writer sends before a new reader has had its first heartbeat,
which comes a few milliseconds after they were connected (measured: the first feedback of every tenth new client).
Decides to let the first handler after any change among the clients wait: up to 100 ms for connections, as service
replies do (protocol.md 5.2), and 10 ms for the heartbeat. Goals of known clients wait for nothing.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.endpoints.publisher import Publisher
    from rosidl_py_gen.runtime.endpoints.server import ServiceServer

_TRIES = 10
_PAUSE_S = 0.01
_PREFIX_BYTES = 12
"""The part of a GUID that all endpoints of a participant share."""


class Hearing:
    """The connections of one action server."""

    def __init__(self, goals: ServiceServer[Any, Any], feedback: Publisher[Any]) -> None:
        self._goals = goals
        self._feedback = feedback
        self._known: list[bytes] = []
        self._deaf: set[bytes] = set()

    def is_settled(self) -> bool:
        """Whether nothing has changed since everybody could hear."""
        return self._goals._reader.matched_writers() == self._known

    async def settle(self) -> None:
        """Return when every client can hear, or when those who cannot have had their time."""
        clients: list[bytes] = []
        for _ in range(_TRIES):
            clients = self._goals._reader.matched_writers()
            if not self._missing(clients):
                break
            await asyncio.sleep(_PAUSE_S)
        else:
            self._deaf |= self._missing(clients)
        await asyncio.sleep(_PAUSE_S)
        self._known = clients

    def _missing(self, clients: list[bytes]) -> set[bytes]:
        senders = {guid[:_PREFIX_BYTES] for guid in clients}
        self._deaf &= senders
        hearers = {guid[:_PREFIX_BYTES] for guid in self._feedback._writer.matched_readers()}
        return senders - hearers - self._deaf
