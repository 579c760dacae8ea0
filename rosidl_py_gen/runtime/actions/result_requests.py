"""Requests of an action client for the results of its goals: each goal has one request, which is open until the goal
ends.

Every server of the action's name receives a request, and replies UNKNOWN if it was started after the goal was accepted.
So UNKNOWN is ignored while a server that may have accepted the goal is present. When all of these have disappeared, the
present servers get the request; if there are no servers for `server_lost_timeout_s`, the result is lost.

One timer for all goals checks for conditions that no event reports:

- Servers queue few requests, and silently drop older ones. If the status topic reports the end of a goal and no result
  arrives, the request is repeated, with doubling delays; earlier requests may still be answered. If a server that
  accepted the goal replies UNKNOWN after the end, the request is repeated at most `_MAX_UNKNOWN_REPLIES` times.
- A killed server is announced until its lease ends. If a second node of the same name appears, its server gets the
  request. If the new server replies UNKNOWN and the old one acknowledges nothing, the goal ended with the old process.

A server of rclcpp sends the goal response before it registers the goal, so that a request in between is answered with
UNKNOWN. A server that may have accepted the goal and replies UNKNOWN within `REGISTRATION_TIMEOUT_S` gets another
request.

A goal costs no task and no future, because results are pending for as long as goals run.
Source: docs/internals/protocol.md 8.3, 8.5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.runtime.actions.states import ActionServerLostError, GoalStatus
from rosidl_py_gen.runtime.entities.client import Client
from rosidl_py_gen.runtime.entities.service_common import ServerLostError
from rosidl_py_gen.runtime.graph.graph import BARE_DDS_NODE, UNKNOWN_NODE
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.flow_control import PendingRequest
    from rosidl_py_gen.runtime.entities.message_types import ServiceType

CHECK_INTERVAL_S = 0.5
"""Interval in seconds at which an action client checks its servers while results are pending."""
_BATCH_INTERVAL_S = 0.01
"""Interval in seconds between groups of result requests that are sent together. It delays no result, because servers
reply when goals end."""
RETRY_DELAY_S = 0.5
"""Time in seconds from the end of a goal until the request for its result is repeated; doubles with each repetition."""
_MAX_UNKNOWN_REPLIES = 3
"""Number of UNKNOWN replies about an ended goal, from servers that accepted it, after which UNKNOWN is its result."""
ACK_TIMEOUT_S = 1.0
"""Time in seconds without acknowledgement after which an action server is considered dead if a second node has its
node's name.

A running server acknowledges within milliseconds.
"""
REGISTRATION_TIMEOUT_S = 2.0
"""Time in seconds after the acceptance of a goal in which the reply UNKNOWN may mean that the server has not registered
the goal yet.

rclcpp needs less than 1 ms to register a goal on an idle machine. A larger value delays the error for a goal that is
really unknown.
"""
FIRST_RETRY_DELAY_S = 0.02
"""Time in seconds until a server that may not have registered a goal gets another result request; doubles with each
retry."""


@dataclass(slots=True, eq=False)
class _ResultRequest:
    """Pending result of one goal.

    Attributes:
        request: get_result request.
        on_reply: called with the response.
        on_error: called with the exception if there is no response.
        has_ended: returns True once the goal is known to have ended.
        accepted_s: loop time when the goal was accepted.
        candidate_servers: reply writers of the servers that may know the goal.
        initial_servers: reply writers of the servers that existed when the goal was accepted.
        requested_servers: reply writers of all servers that received a request.
        sent_requests: requests without a final response; empty while there is no server.
        repeat_at_s: loop time to repeat the request; 0 while the goal continues.
        repeat_interval_s: delay that leads to `repeat_at_s`.
        unknown_count: number of UNKNOWN replies of `initial_servers` after the goal has ended.
        unknown_reply: UNKNOWN reply that was ignored, because another server may know the goal, and its loop time.
        is_early: a server of `initial_servers` replied UNKNOWN, perhaps because it had not registered the goal yet.
        is_retrying: another request is sent after `retry_delay_s`.
        retry_delay_s: delay of the next retry.
    """

    request: Any
    on_reply: Callable[[Any], None]
    on_error: Callable[[Exception], None]
    has_ended: Callable[[], bool]
    accepted_s: float
    candidate_servers: set[bytes] = field(default_factory=set)
    initial_servers: frozenset[bytes] = frozenset()
    requested_servers: set[bytes] = field(default_factory=set)
    sent_requests: list[PendingRequest[Any]] = field(default_factory=list)
    repeat_at_s: float = 0.0
    repeat_interval_s: float = field(default_factory=lambda: RETRY_DELAY_S)
    unknown_count: int = 0
    unknown_reply: tuple[Any, float] | None = None
    is_early: bool = False
    is_retrying: bool = False
    retry_delay_s: float = FIRST_RETRY_DELAY_S

    def is_repeat_due(self, now_s: float) -> bool:
        if not self.has_ended():
            return False
        if not self.repeat_at_s:
            self.repeat_at_s = now_s + self.repeat_interval_s
        return now_s >= self.repeat_at_s


class ResultRequester:
    """Pending results of one action client. Thread: loop."""

    def __init__(
        self, scope: EntityScope, service_type: ServiceType[Any, Any], name: str, lost_after_ns: int | None
    ) -> None:
        self._scope = scope
        self._lost_after_s = math.inf if lost_after_ns is None else lost_after_ns / NS_PER_S
        self._pending: set[_ResultRequest] = set()
        self._check_timer: asyncio.TimerHandle | None = None
        self._server_seen_s = 0.0
        self.client: Client[Any, Any] = Client(
            scope, service_type, name, SERVICES_DEFAULT, batch_interval_s=_BATCH_INTERVAL_S
        )

    def request(
        self,
        request: Any,
        on_reply: Callable[[Any], None],
        on_error: Callable[[Exception], None],
        has_ended: Callable[[], bool],
    ) -> None:
        """Request the result of a goal that was just accepted; call `on_reply` or `on_error` once.

        Args:
            request: get_result request.
            on_reply: called with the response.
            on_error: called with `ActionServerLostError`, `DecodeError` or `ClosedError`.
            has_ended: returns True once the goal is known to have ended.
        """
        loop = self._scope.loop_binding.running_loop()
        pending = _ResultRequest(request, on_reply, on_error, has_ended, loop.time())
        self._pending.add(pending)
        self._restart(pending)
        pending.initial_servers = frozenset(pending.candidate_servers)
        if self._check_timer is None:
            self._server_seen_s = loop.time()
            self._check_timer = loop.call_later(CHECK_INTERVAL_S, self._check_servers)

    def _restart(self, pending: _ResultRequest) -> None:
        """Withdraw earlier requests for a result, and send a new request to the present servers, if there are any."""
        if pending.sent_requests:
            self._abandon(pending)
        pending.is_early = pending.is_retrying = False
        pending.candidate_servers = servers = self.client._servers()
        if servers:
            self._send(pending, servers)

    def _send(self, pending: _ResultRequest, servers: set[bytes]) -> None:
        """Send another request for a result to the present servers, whose reply writers are `servers`."""
        pending.requested_servers |= servers
        on_reply, on_error = partial(self._on_reply, pending), partial(self._on_error, pending)
        pending.sent_requests.append(self.client._start_request(pending.request, on_reply, on_error))

    def _abandon(self, pending: _ResultRequest) -> None:
        for request in pending.sent_requests:
            self.client._abandon_request(request)
        pending.sent_requests.clear()

    def _on_reply(self, pending: _ResultRequest, response: Any, server: bytes | None) -> bool:
        """Handle a response to a result request.

        Returns True to keep the request open, because another server may know the goal.
        """
        if pending not in self._pending:
            return False
        if response.status != GoalStatus.UNKNOWN:
            self._end(pending, pending.on_reply, response)
            return False
        now_s = self._scope.loop_binding.running_loop().time()
        if server is None or server in pending.initial_servers:
            if now_s - pending.accepted_s < REGISTRATION_TIMEOUT_S:
                pending.is_early = True
            elif pending.has_ended():
                pending.unknown_count += 1
                if pending.unknown_count < _MAX_UNKNOWN_REPLIES:
                    return True
        pending.candidate_servers.discard(server or b"")
        if not pending.candidate_servers.isdisjoint(self.client._servers()):
            pending.unknown_reply = response, now_s
            return True
        return self._accept_unknown(pending, response)

    def _accept_unknown(self, pending: _ResultRequest, response: Any) -> bool:
        """Handle a server's reply that it does not know the goal; return True if the result will be requested again.

        It is requested again if the server may not have registered the accepted goal yet. Otherwise the client's goal
        gets the reply, and the method returns False.
        """
        if pending.is_early and not pending.is_retrying:
            pending.is_retrying = True
            self._scope.loop_binding.running_loop().call_later(pending.retry_delay_s, self._retry, pending)
            pending.retry_delay_s *= 2
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
            pending.candidate_servers.clear()  # `_check_servers` sends another request when a server appears
        else:
            self._end(pending, pending.on_error, error)

    def _end(self, pending: _ResultRequest, report: Callable[[Any], None], value: Any) -> None:
        self._pending.discard(pending)
        self._abandon(pending)
        report(value)

    # ------------------------------------------------------------------------------------------- check of the servers

    def _check_servers(self) -> None:
        """Check the servers of all pending results, repeat requests where necessary, and schedule the next check."""
        self._check_timer = None
        if not self._pending or self._scope.closed:
            return
        loop = self._scope.loop_binding.running_loop()
        present, now_s = self.client._servers(), loop.time()
        if present:
            self._server_seen_s = now_s
        names = {server: self._node_of(server) for server in present}
        for pending in list(self._pending):
            if pending.is_retrying:
                continue
            if pending.candidate_servers.isdisjoint(present):
                self._switch_server(pending, present, now_s)
            elif pending.unknown_reply is not None and self._has_been_restarted(pending, names, now_s):
                self._accept_unknown(pending, pending.unknown_reply[0])
            elif self._restarted_servers(pending, names) - pending.requested_servers:
                self._send(pending, present)
            elif pending.is_repeat_due(now_s):
                pending.repeat_interval_s *= 2
                pending.repeat_at_s = now_s + pending.repeat_interval_s
                self._send(pending, present)
        self._check_timer = loop.call_later(CHECK_INTERVAL_S, self._check_servers)

    def _switch_server(self, pending: _ResultRequest, present: set[bytes], now_s: float) -> None:
        if present:
            self._restart(pending)
        elif now_s - self._server_seen_s >= self._lost_after_s:
            text = f"the server of {self.client.name} disappeared, and none has replaced it in {self._lost_after_s} s; "
            self._end(pending, pending.on_error, ActionServerLostError(text + "the goal's result is lost"))

    def _node_of(self, server: bytes) -> tuple[str, str]:
        endpoint = self._scope.graph.endpoints.get(server)
        return UNKNOWN_NODE if endpoint is None else self._scope.graph.node_of(endpoint)

    def _restarted_servers(self, pending: _ResultRequest, names: dict[bytes, tuple[str, str]]) -> set[bytes]:
        """Return the newer servers among the present servers whose node has the same name as a node that may know the
        goal.

        Args:
            names: name of the node of each present server.
        """
        old = {names[server] for server in pending.candidate_servers if server in names} - {UNKNOWN_NODE, BARE_DDS_NODE}
        return {
            server
            for server, name in names.items()
            if name in old and server not in pending.initial_servers | pending.candidate_servers
        }

    def _has_been_restarted(self, pending: _ResultRequest, names: dict[bytes, tuple[str, str]], now_s: float) -> bool:
        """Return True if all servers that may know the goal were restarted, and the old ones acknowledge nothing."""
        assert pending.unknown_reply is not None
        new = {names[server] for server in self._restarted_servers(pending, names)}
        all_restarted = all(names[server] in new for server in pending.candidate_servers if server in names)
        return (
            all_restarted and now_s - pending.unknown_reply[1] >= ACK_TIMEOUT_S and not self.client.all_acknowledged()
        )
