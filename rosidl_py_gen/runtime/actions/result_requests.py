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

A server of rclcpp sends the goal response before it registers the goal, so that a request in between is answered with
UNKNOWN. A server that may have accepted the goal and answers so within `REGISTRATION_TIMEOUT_S` is asked again.

There is no task and no future per goal, only what the client of a service keeps for a request: results are awaited for
as long as goals run, also while plain code lets no event loop run. Source: docs/internals/protocol.md 8.3, 8.5.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime.actions.client_goal import ActionServerLostError
from rosidl_py_gen.runtime.actions.states import GoalStatus
from rosidl_py_gen.runtime.entities.client import Client
from rosidl_py_gen.runtime.entities.service_common import ServerLostError
from rosidl_py_gen.runtime.graph.graph import BARE_DDS_NODE, UNKNOWN_NODE
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import ServiceType

_CHECK_INTERVAL_S = 0.5
"""How often the presence of the server is looked at while a result is awaited."""
_BATCH_INTERVAL_S = 0.01
"""Between bursts of requests: a server only has to note them, and answers much later."""
_RETRY_DELAY_S = 0.5
"""How long after the news of its end the result of a goal is asked for again; each further time takes twice as long."""
_MAX_UNKNOWN_REPLIES = 3
"""So often a server that must know a goal may say that it does not."""
_ACK_TIMEOUT_S = 1.0
"""So long a server acknowledges nothing, and its node is there a second time: it is gone."""
REGISTRATION_TIMEOUT_S = 2.0
"""Time after the acceptance of a goal in which UNKNOWN may mean that the server has not registered the goal yet. rclcpp
needs less than 1 ms for that on an idle machine. A larger value delays the error for a goal that is really unknown."""
FIRST_RETRY_DELAY_S = 0.02
"""Time until such a server is asked again; each further retry waits twice as long."""


class _ResultRequest:
    """One result that is awaited.

    Attributes:
        has_ended: whether the goal is known to have ended.
        servers: reply writers of the servers that may know the goal.
        first: those that were there when it was accepted.
        asked: all that got a request.
        sequences: of the requests; empty while there is nobody to ask.
        retry_at_s: when to ask again; 0 while the goal goes on.
        pause_s: between the last time and that one.
        denied: how often servers of `initial_servers` did not know the goal.
        answer: the UNKNOWN of a server that came later, and when that was.
        accepted_s: time of the acceptance.
        is_early: a server of `initial_servers` answered UNKNOWN before it may have registered the goal.
        is_retrying: the servers are asked again after a delay.
        delay_s: until the next such retry.
    """

    __slots__ = (
        *(
            "accepted_s",
            "retry_at_s",
            "unknown_reply",
            "asked",
            "delay_s",
            "unknown_replies",
            "initial_servers",
            "has_ended",
            "is_early",
        ),
        *("is_retrying", "on_error", "on_reply", "pause_s", "request", "sequences", "candidate_servers"),
    )

    def __init__(
        self,
        request: Any,
        on_reply: Callable[[Any], None],
        on_error: Callable[[Exception], None],
        has_ended: Callable[[], bool],
        accepted_s: float,
    ) -> None:
        self.request = request
        self.on_reply = on_reply
        self.on_error = on_error
        self.has_ended = has_ended
        self.candidate_servers: set[bytes] = set()
        self.initial_servers: frozenset[bytes] = frozenset()
        self.asked: set[bytes] = set()
        self.sequences: list[int] = []
        self.retry_at_s = 0.0
        self.pause_s = _RETRY_DELAY_S
        self.unknown_replies = 0
        self.unknown_reply: tuple[Any, float] | None = None
        self.accepted_s = accepted_s
        self.is_early = False
        self.is_retrying = False
        self.delay_s = FIRST_RETRY_DELAY_S

    def is_due(self, now_s: float) -> bool:
        """Whether the goal has ended, and its result should have come by now."""
        if not self.has_ended():
            return False
        if not self.retry_at_s:
            self.retry_at_s = now_s + self.pause_s
        return now_s >= self.retry_at_s


class ResultRequester:
    """The results that one action client waits for."""

    def __init__(
        self,
        scope: EntityScope,
        service_type: ServiceType[Any, Any],
        name: str,
        lost_after_ns: int | None,
    ) -> None:
        self._scope = scope
        self._lost_after_s = math.inf if lost_after_ns is None else lost_after_ns / NS_PER_S
        self._pending: set[_ResultRequest] = set()
        self._look_timer: asyncio.TimerHandle | None = None
        self._seen_s = 0.0
        self.client: Client[Any, Any] = Client(
            scope, service_type, name, SERVICES_DEFAULT, batch_interval_s=_BATCH_INTERVAL_S
        )

    @property
    def pending_count(self) -> int:
        """How many results are awaited."""
        return len(self._pending)

    def ask(
        self,
        request: Any,
        on_reply: Callable[[Any], None],
        on_error: Callable[[Exception], None],
        has_ended: Callable[[], bool],
    ) -> None:
        """Send a request as soon as the goal is accepted; calls one of the functions, on the loop's thread or in close.

        Args:
            on_reply: gets the response.
            on_error: gets `ActionServerLostError`, `DecodeError` or `ClosedError`.
            has_ended: whether the goal is known to have ended, so that its result should be there.
        """
        loop = self._scope.bridge.running_loop()
        pending = _ResultRequest(request, on_reply, on_error, has_ended, loop.time())
        self._pending.add(pending)
        self._restart(pending)
        pending.initial_servers = frozenset(pending.candidate_servers)
        if self._look_timer is None:
            self._seen_s = loop.time()
            self._look_timer = loop.call_later(_CHECK_INTERVAL_S, self._check_servers)

    def _restart(self, pending: _ResultRequest) -> None:
        """Ask those that are there now, and nobody else any more."""
        self._forget(pending)
        pending.is_early = pending.is_retrying = False
        pending.candidate_servers = self.client._servers()
        if pending.candidate_servers:
            self._ask(pending)

    def _ask(self, pending: _ResultRequest) -> None:
        pending.asked |= self.client._servers()
        on_reply, on_error = partial(self._on_reply, pending), partial(self._on_error, pending)
        pending.sequences.append(self.client._start_request(pending.request, on_reply, on_error))

    def _forget(self, pending: _ResultRequest) -> None:
        for sequence in pending.sequences:
            self.client._abandon_request(sequence)
        pending.sequences.clear()

    def _on_reply(self, pending: _ResultRequest, response: Any, server: bytes | None) -> bool:
        """Whether the answer was UNKNOWN while a server may know the goal."""
        if pending not in self._pending:
            return False
        if response.status != GoalStatus.UNKNOWN:
            self._end(pending, pending.on_reply, response)
            return False
        now_s = self._scope.bridge.running_loop().time()
        if server is None or server in pending.initial_servers:
            if now_s - pending.accepted_s < REGISTRATION_TIMEOUT_S:
                pending.is_early = True
            elif pending.has_ended():
                pending.unknown_replies += 1
                if pending.unknown_replies < _MAX_UNKNOWN_REPLIES:
                    return True
        pending.candidate_servers.discard(server or b"")
        if not pending.candidate_servers.isdisjoint(self.client._servers()):
            pending.unknown_reply = response, now_s
            return True
        return self._deny(pending, response)

    def _deny(self, pending: _ResultRequest, response: Any) -> bool:
        """End with UNKNOWN; but ask again if the goal may be registered by then, and return True."""
        if pending.is_early and not pending.is_retrying:
            pending.is_retrying = True
            self._scope.bridge.running_loop().call_later(pending.delay_s, self._retry, pending)
            pending.delay_s *= 2
        if not pending.is_retrying:
            self._end(pending, pending.on_reply, response)
        return pending.is_retrying

    def _retry(self, pending: _ResultRequest) -> None:
        if pending in self._pending and pending.is_retrying and not self._scope.closed:
            self._restart(pending)

    def _on_error(self, pending: _ResultRequest, error: Exception) -> None:
        if pending not in self._pending:
            return
        if isinstance(error, ServerLostError):
            pending.candidate_servers.clear()  # `_check_servers` asks again when there is one
        else:
            self._end(pending, pending.on_error, error)

    def _end(self, pending: _ResultRequest, report: Callable[[Any], None], what: Any) -> None:
        self._pending.discard(pending)
        self._forget(pending)
        report(what)

    # ---------------------------------------------------------------------------------------------- from time to time

    def _check_servers(self) -> None:
        """While results are awaited, look at the servers from time to time; one timer for all goals."""
        self._look_timer = None
        if not self._pending or self._scope.closed:
            return
        loop = self._scope.bridge.running_loop()
        present, now_s = self.client._servers(), loop.time()
        if present:
            self._seen_s = now_s
        names = {server: self._node_of(server) for server in present}
        for pending in list(self._pending):
            if pending.is_retrying:
                continue
            if pending.candidate_servers.isdisjoint(present):
                self._switch_server(pending, present, now_s)
            elif pending.unknown_reply is not None and self._has_been_restarted(pending, names, now_s):
                self._deny(pending, pending.unknown_reply[0])
            elif self._restarted_servers(pending, names) - pending.asked:
                self._ask(pending)
            elif pending.is_due(now_s):
                pending.pause_s *= 2
                pending.retry_at_s = now_s + pending.pause_s
                self._ask(pending)
        self._look_timer = loop.call_later(_CHECK_INTERVAL_S, self._check_servers)

    def _switch_server(self, pending: _ResultRequest, present: set[bytes], now_s: float) -> None:
        if present:
            self._restart(pending)
        elif now_s - self._seen_s >= self._lost_after_s:
            message = f"the server of {self.client.name} went away and did not come back in {self._lost_after_s} s; "
            self._end(pending, pending.on_error, ActionServerLostError(message + "the goal's result is lost"))

    def _node_of(self, server: bytes) -> tuple[str, str]:
        endpoint = self._scope.graph.endpoints.get(server)
        return UNKNOWN_NODE if endpoint is None else self._scope.graph.node_of(endpoint)

    def _restarted_servers(self, pending: _ResultRequest, names: dict[bytes, tuple[str, str]]) -> set[bytes]:
        """Servers that came later and have the node's name of one that may know the goal."""
        old = {names[server] for server in pending.candidate_servers if server in names} - {UNKNOWN_NODE, BARE_DDS_NODE}
        return {
            server
            for server, name in names.items()
            if name in old and server not in pending.initial_servers | pending.candidate_servers
        }

    def _has_been_restarted(self, pending: _ResultRequest, names: dict[bytes, tuple[str, str]], now_s: float) -> bool:
        """Whether all that may know the goal have been started again, and the old ones hear nothing any more."""
        assert pending.unknown_reply is not None
        new = {names[server] for server in self._restarted_servers(pending, names)}
        replaced = all(names[server] in new for server in pending.candidate_servers if server in names)
        return replaced and now_s - pending.unknown_reply[1] >= _ACK_TIMEOUT_S and not self.client.all_acknowledged()
