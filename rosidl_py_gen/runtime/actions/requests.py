"""Goals that wait for whoever iterates over an action server to accept or reject them.

Decides what becomes of a request that nobody answers: when the program lets go of it, it is rejected with a warning, so
that its client hears of it and a server of one goal at a time is not taken for ever.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.actions.server_goal import GoalRequest, ServerGoal
from rosidl_py_gen.runtime.endpoints.server import AlreadyRespondedError
from rosidl_py_gen.runtime.loop.stream import Stream

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.actions.server_goal import GoalServer
    from rosidl_py_gen.runtime.actions.states import GoalInfo
    from rosidl_py_gen.runtime.endpoints.scope import Scope


class GoalRequests:
    """The open requests of one action server."""

    def __init__(self, scope: Scope, action: str) -> None:
        self.stream: Stream[Any] = Stream()
        """What the program iterates over."""
        self._scope = scope
        self._action = action
        self._answers: dict[bytes, asyncio.Future[GoalInfo | None]] = {}

    async def ask(self, server: GoalServer, goal: ServerGoal[Any]) -> GoalInfo | None:
        """Hand a request out and wait for its answer; None is a rejection."""
        answer: asyncio.Future[GoalInfo | None] = asyncio.get_running_loop().create_future()
        self._answers[goal.goal_id] = answer
        try:
            self.stream.push(GoalRequest(server, goal, self._let_go))
            return await answer
        finally:
            del self._answers[goal.goal_id]

    def answer_to(self, goal: ServerGoal[Any]) -> asyncio.Future[GoalInfo | None]:
        """Where the answer goes; raises `AlreadyRespondedError`."""
        answer = self._answers.get(goal.goal_id)
        if answer is None or answer.done():
            raise AlreadyRespondedError(f"goal {goal.goal_id.hex()} was answered already, or its server is closed")
        return answer

    def _let_go(self, goal_id: bytes) -> None:
        """The request object is gone; called wherever the garbage collector runs."""
        if goal_id in self._answers:
            self._scope.bridge.call_soon(lambda: self._reject_forgotten(goal_id))

    def _reject_forgotten(self, goal_id: bytes) -> None:
        answer = self._answers.get(goal_id)
        if answer is not None and not answer.done():
            self._scope.logger.warning(
                f"a goal request of action {self._action} was neither accepted nor rejected; it is rejected"
            )
            answer.set_result(None)

    def close(self) -> None:
        """Cancel whoever waits for an answer, and end the iterator."""
        for answer in self._answers.values():
            if not answer.get_loop().is_closed():
                answer.cancel()
        self.stream.close()
