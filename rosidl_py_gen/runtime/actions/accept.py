"""The `accept` callback of an action server.

Decides that a plain callback is called at once, so that its goal needs no task, and an async one inside a task. One
that fails rejects.
"""

from __future__ import annotations

import asyncio
import inspect
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.actions.server_goal import GoalDecision, decision_of
from rosidl_py_gen.runtime.endpoints.scope import is_async
from rosidl_py_gen.runtime.loop.callbacks import is_own_cancel

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.runtime.endpoints.scope import Scope


class AcceptDesk:
    """Asks for one action server; without a callback every goal is accepted."""

    def __init__(self, scope: Scope, action: str, accept: Callable[[Any], Any] | None) -> None:
        self._scope = scope
        self._action = action
        self._accept = accept
        self._is_async = is_async(accept)
        self._closed = False

    def ask(self, request: object) -> GoalDecision | Callable[[], Awaitable[GoalDecision]]:
        """The decision, or a function to get it from inside a task."""
        accept = self._accept
        if accept is None:
            return GoalDecision.ACCEPT
        if self._is_async:
            return lambda: self._wait(lambda: accept(request))
        try:
            answer = accept(request)
            if inspect.isawaitable(answer):  # of a lambda, for example
                return lambda: self._wait(lambda: answer)
            return decision_of(answer)
        except (Exception, asyncio.CancelledError):
            return self._failed()

    async def _wait(self, start: Callable[[], Awaitable[object]]) -> GoalDecision:
        try:
            return decision_of(await start())
        except (Exception, asyncio.CancelledError):
            if self._closed or is_own_cancel():
                raise
            return self._failed()

    def _failed(self) -> GoalDecision:
        self._scope.report_failure(f"the accept callback of action {self._action}")
        return GoalDecision.REJECT

    def close(self) -> None:
        """Failures are not reported any more: their cause is the end."""
        self._closed = True
