"""Asking for the results of goals: one request for each goal, which stays open until the goal ends.

Decides whom an answer may come from. Every server of the action's name gets the request, and one that started later
does not know the goal: its UNKNOWN says nothing while a server that may have accepted the goal is still there. When all
of those are gone, whoever took their place is asked; when nobody does for a while, the result is lost.

Two things are looked at from time to time, because nothing announces them:

- Servers keep few requests, and drop older ones without a word. When the status topic says that the goal has ended and
  no result came, it is asked for again, after longer and longer times; what was asked before may still be answered. A
  server that was there from the beginning and does not know such a goal is asked again, too, but not for ever.
- A server that was killed counts as there until its lease is over. When its node is there a second time, the new one
  is asked. That one does not know the goal, and the old one no longer takes in what we send, while one that lives
  does that within milliseconds: then the goal has ended with it.

There is no task and no future per goal, only what the client of a service keeps for a request: results are awaited for
as long as goals run, also while plain code lets no event loop run. Source: docs/internals/protocol.md 8.3, 8.5.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.actions.client_goal import ActionServerLostError
from rosidl_py_gen.runtime.actions.states import GoalStatus
from rosidl_py_gen.runtime.endpoints.client import Client
from rosidl_py_gen.runtime.endpoints.service_parts import ServerLostError
from rosidl_py_gen.runtime.graph.state import BARE_DDS_NODE, UNKNOWN_NODE
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT
from rosidl_py_gen.stamps import NS_PER_S

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import ServiceType

_LOOK_S = 0.5
"""How often the presence of the server is looked at while a result is awaited."""
_PAUSE_S = 0.01
"""Between bursts of requests: a server only has to note them, and answers much later."""
_AGAIN_S = 0.5
"""How long after the news of its end the result of a goal is asked for again; each further time takes twice as long."""
_DENIALS = 3
"""So often a server that must know a goal may say that it does not."""
_SILENT_S = 1.0
"""So long a server acknowledges nothing, and its node is there a second time: it is gone."""


class _Wanted:
    """One result that is awaited.

    Attributes:
        has_ended: whether the goal is known to have ended.
        servers: reply writers of the servers that may know the goal.
        first: those that were there when it was accepted.
        asked: all that got a request.
        sequences: of the requests; empty while there is nobody to ask.
        again_s: when to ask again; 0 while the goal goes on.
        pause_s: between the last time and that one.
        denied: how often servers of `first` did not know the goal.
        answer: the UNKNOWN of a server that came later, and when that was.
    """

    __slots__ = (
        *("again_s", "answer", "asked", "denied", "fail", "first", "has_ended", "pause_s", "request", "sequences"),
        *("servers", "tell"),
    )

    def __init__(
        self,
        request: Any,
        tell: Callable[[Any], None],
        fail: Callable[[Exception], None],
        has_ended: Callable[[], bool],
    ) -> None:
        self.request = request
        self.tell = tell
        self.fail = fail
        self.has_ended = has_ended
        self.servers: set[bytes] = set()
        self.first: frozenset[bytes] = frozenset()
        self.asked: set[bytes] = set()
        self.sequences: list[int] = []
        self.again_s = 0.0
        self.pause_s = _AGAIN_S
        self.denied = 0
        self.answer: tuple[Any, float] | None = None

    def is_due(self, now_s: float) -> bool:
        """Whether the goal has ended, and its result should have come by now."""
        if not self.has_ended():
            return False
        if not self.again_s:
            self.again_s = now_s + self.pause_s
        return now_s >= self.again_s


class ResultClient:
    """The results that one action client waits for."""

    def __init__(
        self,
        scope: Scope,
        service_type: ServiceType[Any, Any],
        name: str,
        lost_after_ns: int | None,
    ) -> None:
        self._scope = scope
        self._lost_after_s = math.inf if lost_after_ns is None else lost_after_ns / NS_PER_S
        self._wanted: set[_Wanted] = set()
        self._look_timer: asyncio.TimerHandle | None = None
        self._seen_s = 0.0
        self.client: Client[Any, Any] = Client(scope, service_type, name, SERVICES_DEFAULT, pause_s=_PAUSE_S)

    @property
    def pending_count(self) -> int:
        """How many results are awaited."""
        return len(self._wanted)

    def ask(
        self,
        request: Any,
        tell: Callable[[Any], None],
        fail: Callable[[Exception], None],
        has_ended: Callable[[], bool],
    ) -> None:
        """Send a request; one of the functions will be called, on the loop's thread or when the client closes.

        Args:
            tell: gets the response.
            fail: gets `ActionServerLostError`, `DecodeError` or `ClosedError`.
            has_ended: whether the goal is known to have ended, so that its result should be there.
        """
        loop = self._scope.bridge.running_loop()
        wanted = _Wanted(request, tell, fail, has_ended)
        self._wanted.add(wanted)
        self._put(wanted)
        wanted.first = frozenset(wanted.servers)
        if self._look_timer is None:
            self._seen_s = loop.time()
            self._look_timer = loop.call_later(_LOOK_S, self._look)

    def _put(self, wanted: _Wanted) -> None:
        """Ask those that are there now, and nobody else any more."""
        self._forget(wanted)
        wanted.servers = self.client._servers()
        if wanted.servers:
            self._ask(wanted)

    def _ask(self, wanted: _Wanted) -> None:
        wanted.asked |= self.client._servers()
        on_reply, on_error = partial(self._on_reply, wanted), partial(self._on_error, wanted)
        wanted.sequences.append(self.client._ask(wanted.request, on_reply, on_error))

    def _forget(self, wanted: _Wanted) -> None:
        for sequence in wanted.sequences:
            self.client._forget(sequence)
        wanted.sequences.clear()

    def _on_reply(self, wanted: _Wanted, response: Any, server: bytes | None) -> bool:
        """Whether the answer was UNKNOWN while a server may know the goal."""
        if wanted not in self._wanted:
            return False
        if response.status == GoalStatus.UNKNOWN:
            if server in wanted.first and wanted.has_ended():
                wanted.denied += 1
                if wanted.denied < _DENIALS:
                    return True
            wanted.servers.discard(server or b"")
            if not wanted.servers.isdisjoint(self.client._servers()):
                wanted.answer = response, self._scope.bridge.running_loop().time()
                return True
        self._end(wanted, wanted.tell, response)
        return False

    def _on_error(self, wanted: _Wanted, error: Exception) -> None:
        if wanted not in self._wanted:
            return
        if isinstance(error, ServerLostError):
            wanted.servers.clear()  # `_look` asks again when there is one
        else:
            self._end(wanted, wanted.fail, error)

    def _end(self, wanted: _Wanted, say: Callable[[Any], None], what: Any) -> None:
        self._wanted.discard(wanted)
        self._forget(wanted)
        say(what)

    # ---------------------------------------------------------------------------------------------- from time to time

    def _look(self) -> None:
        """While results are awaited, look at the servers from time to time; one timer for all goals."""
        self._look_timer = None
        if not self._wanted or self._scope.closed:
            return
        loop = self._scope.bridge.running_loop()
        present, now_s = self.client._servers(), loop.time()
        if present:
            self._seen_s = now_s
        names = {server: self._node_of(server) for server in present}
        for wanted in list(self._wanted):
            if wanted.servers.isdisjoint(present):
                self._look_for_another(wanted, present, now_s)
            elif wanted.answer is not None and self._is_replaced(wanted, names, now_s):
                self._end(wanted, wanted.tell, wanted.answer[0])
            elif self._successors(wanted, names) - wanted.asked:
                self._ask(wanted)
            elif wanted.is_due(now_s):
                wanted.pause_s *= 2
                wanted.again_s = now_s + wanted.pause_s
                self._ask(wanted)
        self._look_timer = loop.call_later(_LOOK_S, self._look)

    def _look_for_another(self, wanted: _Wanted, present: set[bytes], now_s: float) -> None:
        if present:
            self._put(wanted)
        elif now_s - self._seen_s >= self._lost_after_s:
            message = f"the server of {self.client.name} went away and did not come back in {self._lost_after_s} s; "
            self._end(wanted, wanted.fail, ActionServerLostError(message + "the goal's result is lost"))

    def _node_of(self, server: bytes) -> tuple[str, str]:
        endpoint = self._scope.graph.endpoints.get(server)
        return UNKNOWN_NODE if endpoint is None else self._scope.graph.node_of(endpoint)

    def _successors(self, wanted: _Wanted, names: dict[bytes, tuple[str, str]]) -> set[bytes]:
        """Servers that came later and have the node's name of one that may know the goal."""
        old = {names[server] for server in wanted.servers if server in names} - {UNKNOWN_NODE, BARE_DDS_NODE}
        return {server for server, name in names.items() if name in old and server not in wanted.first | wanted.servers}

    def _is_replaced(self, wanted: _Wanted, names: dict[bytes, tuple[str, str]], now_s: float) -> bool:
        """Whether all that may know the goal have been started again, and the old ones hear nothing any more."""
        assert wanted.answer is not None
        new = {names[server] for server in self._successors(wanted, names)}
        replaced = all(names[server] in new for server in wanted.servers if server in names)
        return replaced and now_s - wanted.answer[1] >= _SILENT_S and not self.client.all_acknowledged()
