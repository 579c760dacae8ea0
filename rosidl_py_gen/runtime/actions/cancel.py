"""Who decides whether a goal may be cancelled: a callback, a stream, or the default.

The default accepts when the handler looks at `cancel_requested` (its code mentions it, or it has read it already), and
refuses otherwise: a goal that nobody would stop must not be shown as CANCELING. Goals served as a stream, and goals not
started yet, are always cancelled.

What an `on_cancel` callback answers counts as in Python: whatever is false refuses. Only None, which functions without
a return statement answer, accepts.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Generic

from rosidl_py_gen.runtime.actions.server_goal import CancelRequest, ServerGoal, agrees
from rosidl_py_gen.runtime.actions.types import ActionT_co
from rosidl_py_gen.runtime.loop.callbacks import is_own_cancel, mentions_cancel, result_of
from rosidl_py_gen.runtime.loop.stream import Stream

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.endpoints.scope import Scope


class CancelDesk(Generic[ActionT_co]):
    """Answers for one action server."""

    def __init__(
        self,
        scope: Scope,
        action: str,
        execute: Callable[..., Any] | None,
        on_cancel: Callable[[ServerGoal[ActionT_co]], Any] | None,
    ) -> None:
        self._scope = scope
        self._action = action
        self._on_cancel = on_cancel
        self._may_be_ignored = execute is not None and not mentions_cancel(execute)
        self._stream: Stream[CancelRequest[ActionT_co]] | None = None
        self._pending: dict[bytes, list[asyncio.Future[bool]]] = {}
        self._closed = False

    def stream(self) -> Stream[CancelRequest[ActionT_co]]:
        """Let every cancel wait for an answer from now on."""
        if self._on_cancel is not None:
            raise TypeError(f"action {self._action} has an on_cancel callback; its cancels cannot be iterated over too")
        if self._stream is None:
            self._stream = Stream()
        return self._stream

    async def decide(self, goal: ServerGoal[ActionT_co], *, started: bool) -> bool:
        """True when the goal may be cancelled; a callback that fails refuses."""
        if self._on_cancel is not None:
            try:
                return agrees(await result_of(self._on_cancel, goal))
            except (Exception, asyncio.CancelledError):
                if self._closed or is_own_cancel():
                    raise
                self._scope.report_failure(f"the on_cancel callback of action {self._action}")
                return False
        if self._stream is not None:
            answer: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
            self._pending.setdefault(goal.goal_id, []).append(answer)
            self._stream.push(CancelRequest(goal, answer))
            return await answer
        return not (started and self._may_be_ignored) or goal.looked_for_cancel

    def goal_ended(self, goal_id: bytes) -> None:
        """Cancels of this goal that nobody answered are refused."""
        for answer in self._pending.pop(goal_id, ()):
            if not answer.done():
                answer.set_result(False)

    def close(self) -> None:
        """End the stream; whoever waits for an answer is cancelled."""
        self._closed = True
        if self._stream is not None:
            self._stream.close()
        for answers in self._pending.values():
            for answer in answers:
                if not answer.get_loop().is_closed():
                    answer.cancel()
