"""Asking for the results of goals: one request for each goal, which stays open until the goal ends.

Decides whom an answer may come from. Every server of the action's name gets the request, and one that started later
does not know the goal: its UNKNOWN says nothing while a server that may have accepted the goal is still there. When all
of those are gone, whoever took their place is asked; when nobody does for a while, the result is lost.

There is no task and no future per goal, only what the client of a service keeps for a call: results are awaited for as
long as goals run, also while plain code lets no event loop run. Source: protocol.md 8.3, 8.5.
"""

from __future__ import annotations

import asyncio
import math
from collections import deque
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.actions.client_goal import ActionServerLostError
from rosidl_py_gen.runtime.endpoints.client import Client
from rosidl_py_gen.runtime.endpoints.header import ForeignServiceError, message_begin, split_header
from rosidl_py_gen.runtime.endpoints.scope import request_numbers
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import ServiceType
    from rosidl_py_gen.runtime.transport.interface import Sample

_LOOK_S = 0.5
"""How often the presence of the server is looked at while a result is awaited."""
_RETRY_S = 0.001
_BURST_PAUSE_S = 0.01


class Question:
    """One request under way; stands where a client keeps the future of a call, and is used like one.

    Attributes:
        request: the encoded get_result request.
        servers: reply writers of the servers that may know the goal.
    """

    __slots__ = ("_fail", "_tell", "is_done", "request", "sequence", "servers")

    def __init__(self, request: bytes, tell: Callable[[Any], None], fail: Callable[[BaseException], None]) -> None:
        self.request = request
        self.sequence = 0
        self.servers: set[bytes] = set()
        self.is_done = False
        self._tell = tell
        self._fail = fail

    def done(self) -> bool:
        """Whether it was answered, or failed."""
        return self.is_done

    def set_result(self, response: Any) -> None:
        """The answer."""
        self.is_done = True
        self._tell(response)

    def set_exception(self, error: BaseException) -> None:
        """There will be no answer."""
        self.is_done = True
        self._fail(error)


class ResultClient(Client[Any, Any]):
    """The get_result client of one action client."""

    def __init__(
        self,
        scope: Scope,
        service_type: ServiceType[Any, Any],
        name: str,
        run: Callable[[Coroutine[Any, Any, Any]], Any],
        lost_after_ns: int | None,
    ) -> None:
        self._lost_after_s = math.inf if lost_after_ns is None else lost_after_ns / 1e9
        self._unsent: deque[Question] = deque()
        self._retry: asyncio.TimerHandle | None = None
        self._look_timer: asyncio.TimerHandle | None = None
        self._seen_s = 0.0
        self._window_s = 0.0
        self._sent_in_window = 0
        super().__init__(scope, service_type, name, SERVICES_DEFAULT, run)

    def ask(self, request: Any, tell: Callable[[Any], None], fail: Callable[[BaseException], None]) -> None:
        """Send a request; one of the functions will be called, on the loop's thread or by `close`.

        Args:
            tell: gets the response.
            fail: gets `ActionServerLostError`, `ForeignServiceError`, `DecodeError` or `ClosedError`.
        """
        loop = self._scope.bridge.running_loop()
        self._put(Question(self._type.request.encode(request), tell, fail))
        if self._look_timer is None:
            self._seen_s = loop.time()
            self._look_timer = loop.call_later(_LOOK_S, self._look)

    def _put(self, question: Question) -> None:
        self._pending.pop(question.sequence, None)
        question.sequence = next(request_numbers)
        self._pending[question.sequence] = question  # type: ignore[assignment]  # has what is used of a future
        question.servers = self._present()
        if question.servers:
            self._unsent.append(question)
            if self._retry is None:
                self._send_unsent()

    def _present(self) -> set[bytes]:
        """The reply writers of all servers; empty when none can be talked to."""
        try:
            if not self._is_available():
                return set()
        except ForeignServiceError:
            return set()
        return set(self._reader.matched_writers())

    # ----------------------------------------------------------------------------------------------------- sending

    def _send_unsent(self) -> None:
        """Send what DDS takes; to a server that keeps only some requests, not more than that at once."""
        self._retry = None
        while self._unsent and not self._closed:
            question = self._unsent[0]
            if not question.is_done and question.sequence in self._pending:
                pause_s = self._turn_s()
                if pause_s <= 0:
                    if self._send(question.request, question.sequence):
                        self._sent_in_window += 1
                    else:
                        pause_s = _RETRY_S
                if pause_s > 0:
                    self._retry = self._scope.bridge.running_loop().call_later(pause_s, self._send_unsent)
                    return
            self._unsent.popleft()

    def _turn_s(self) -> float:
        """How long the next request has to wait."""
        if not self._burst:
            return 0
        now_s = self._scope.bridge.running_loop().time()
        if now_s - self._window_s >= _BURST_PAUSE_S:
            self._window_s, self._sent_in_window = now_s, 0
        return 0 if self._sent_in_window < self._burst else self._window_s + _BURST_PAUSE_S - now_s

    # --------------------------------------------------------------------------------------------------- answers

    def _on_replies(self) -> None:
        """Drop what other servers do not know, then go on as every client."""
        items = self._reader.queue.items
        for _ in range(len(items)):
            item = items.popleft()
            status_at = message_begin(item[0])
            if len(item[0]) <= status_at or item[0][status_at] != 0 or not self._means_nothing(item):
                items.append(item)
        super()._on_replies()

    def _means_nothing(self, item: Sample) -> bool:
        """Whether an answer UNKNOWN comes from one server while another one may know the goal."""
        client, sequence, _ = split_header(item[0])
        number = self._own_number(client, sequence, item[2])
        question = None if number is None else self._pending.get(number)
        if not isinstance(question, Question):
            return False
        question.servers.discard(self._reader.writer_guid(item[2]) or b"")
        return not question.servers.isdisjoint(self._present())

    # ------------------------------------------------------------------------------------------------ lost servers

    def _look(self) -> None:
        """While results are awaited, look at the servers from time to time; one timer for all goals."""
        self._look_timer = None
        if self._closed or not self._pending:
            return
        loop = self._scope.bridge.running_loop()
        present, now_s = self._present(), loop.time()
        if present:
            self._seen_s = now_s
        for question in list(self._pending.values()):
            if not isinstance(question, Question) or not question.servers.isdisjoint(present):
                continue
            if present:
                self._put(question)
            elif now_s - self._seen_s >= self._lost_after_s:
                del self._pending[question.sequence]
                question.set_exception(
                    ActionServerLostError(
                        f"the server of {self.name} went away and did not come back in {self._lost_after_s} s; "
                        "the goal's result is lost"
                    )
                )
        self._look_timer = loop.call_later(_LOOK_S, self._look)

    def close(self) -> None:
        """See `Client.close`."""
        super().close()
        for timer in (self._retry, self._look_timer):
            if timer is not None:
                timer.cancel()
        self._unsent.clear()
