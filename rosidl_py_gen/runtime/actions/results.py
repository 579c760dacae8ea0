"""Asking for the results of goals: one request for each goal, which stays open until the goal ends.

Decides whom an answer may come from. Every server of the action's name gets the request, and one that started later
does not know the goal: its UNKNOWN says nothing while a server that may have accepted the goal is still there. When all
of those are gone, whoever took their place is asked; when nobody does for a while, the result is lost.

There is no task and no future per goal, only what the client of a service keeps for a request: results are awaited for
as long as goals run, also while plain code lets no event loop run. Source: protocol.md 8.3, 8.5.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.actions.client_goal import ActionServerLostError
from rosidl_py_gen.runtime.actions.states import GoalStatus
from rosidl_py_gen.runtime.endpoints.client import Client
from rosidl_py_gen.runtime.endpoints.header import ServerLostError
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import ServiceType

_LOOK_S = 0.5
"""How often the presence of the server is looked at while a result is awaited."""
_PAUSE_S = 0.01
"""Between bursts of requests: a server only has to note them, and answers much later."""


class _Wanted:
    """One result that is awaited.

    Attributes:
        servers: reply writers of the servers that may know the goal.
        sequence: of the request; 0 while there is nobody to ask.
    """

    __slots__ = ("fail", "request", "sequence", "servers", "tell")

    def __init__(self, request: Any, tell: Callable[[Any], None], fail: Callable[[Exception], None]) -> None:
        self.request = request
        self.tell = tell
        self.fail = fail
        self.servers: set[bytes] = set()
        self.sequence = 0


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
        self._lost_after_s = math.inf if lost_after_ns is None else lost_after_ns / 1e9
        self._wanted: set[_Wanted] = set()
        self._look_timer: asyncio.TimerHandle | None = None
        self._seen_s = 0.0
        self.client: Client[Any, Any] = Client(scope, service_type, name, SERVICES_DEFAULT, pause_s=_PAUSE_S)

    @property
    def pending_count(self) -> int:
        """How many results are awaited."""
        return len(self._wanted)

    def ask(self, request: Any, tell: Callable[[Any], None], fail: Callable[[Exception], None]) -> None:
        """Send a request; one of the functions will be called, on the loop's thread or when the client closes.

        Args:
            tell: gets the response.
            fail: gets `ActionServerLostError`, `DecodeError` or `ClosedError`.
        """
        loop = self._scope.bridge.running_loop()
        wanted = _Wanted(request, tell, fail)
        self._wanted.add(wanted)
        self._put(wanted)
        if self._look_timer is None:
            self._seen_s = loop.time()
            self._look_timer = loop.call_later(_LOOK_S, self._look)

    def _put(self, wanted: _Wanted) -> None:
        self.client.forget(wanted.sequence)
        wanted.servers = self.client.servers()
        if wanted.servers:
            wanted.sequence = self.client.ask(
                wanted.request, partial(self._on_reply, wanted), partial(self._on_error, wanted)
            )

    def _on_reply(self, wanted: _Wanted, response: Any, server: bytes | None) -> bool:
        """Whether the answer was UNKNOWN while another server may know the goal."""
        if response.status == GoalStatus.UNKNOWN:
            wanted.servers.discard(server or b"")
            if not wanted.servers.isdisjoint(self.client.servers()):
                return True
        self._end(wanted, wanted.tell, response)
        return False

    def _on_error(self, wanted: _Wanted, error: Exception) -> None:
        if isinstance(error, ServerLostError):
            wanted.servers.clear()  # `_look` asks again when there is one
        else:
            self._end(wanted, wanted.fail, error)

    def _end(self, wanted: _Wanted, say: Callable[[Any], None], what: Any) -> None:
        self._wanted.discard(wanted)
        say(what)

    def _look(self) -> None:
        """While results are awaited, look at the servers from time to time; one timer for all goals."""
        self._look_timer = None
        if not self._wanted or self._scope.closed:
            return
        loop = self._scope.bridge.running_loop()
        present, now_s = self.client.servers(), loop.time()
        if present:
            self._seen_s = now_s
        for wanted in [wanted for wanted in self._wanted if wanted.servers.isdisjoint(present)]:
            if present:
                self._put(wanted)
            elif now_s - self._seen_s >= self._lost_after_s:
                self.client.forget(wanted.sequence)
                message = (
                    f"the server of {self.client.name} went away and did not come back in {self._lost_after_s} s; "
                )
                self._end(wanted, wanted.fail, ActionServerLostError(message + "the goal's result is lost"))
        self._look_timer = loop.call_later(_LOOK_S, self._look)
