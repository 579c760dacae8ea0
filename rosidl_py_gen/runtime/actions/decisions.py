"""Who decides about goals and cancels: a callback, or whoever iterates over the requests; else all are accepted.

Of what a callback answers counts what Python takes for true or false; only None, which functions without a return
statement answer, accepts too. A callback that fails refuses. A goal request that the program lets go of unanswered is
rejected with a warning, so that its client hears of it and a server of one goal at a time is not taken for ever. A
cancel request is refused at the latest when its goal ends.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Generic

from rosidl_py_gen.runtime.actions.states import GoalDecision
from rosidl_py_gen.runtime.actions.types import ActionT_co
from rosidl_py_gen.runtime.endpoints.server import AlreadyRespondedError
from rosidl_py_gen.runtime.loop.callbacks import settle
from rosidl_py_gen.runtime.loop.stream import Stream
from rosidl_py_gen.runtime.loop.user_function import UserFunction

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.server_goal import ServerGoal, ServerGoals
    from rosidl_py_gen.runtime.actions.states import GoalInfo
    from rosidl_py_gen.runtime.actions.types import GoalT
    from rosidl_py_gen.runtime.endpoints.scope import Scope


class Permission:
    """The `accept` or `on_cancel` of an action server: a callback, or the answer to everything."""

    def __init__(self, scope: Scope, what: str, callback: Callable[[Any], Any] | bool) -> None:
        self._function = UserFunction(scope, callback if callable(callback) else lambda _: callback, what)

    def ask(self, subject: object) -> GoalDecision | Callable[[], Awaitable[GoalDecision]]:
        """The decision; a function to wait for it when the callback does not answer at once."""
        decisions = [GoalDecision.REJECT]  # stays the only one when the callback fails
        task = self._function.call(subject, then=lambda answer: decisions.append(decision_of(answer)))
        if task is None:
            return decisions[-1]
        asked = task

        async def wait() -> GoalDecision:
            await asked
            return decisions[-1]

        return wait


def decision_of(answer: object) -> GoalDecision:
    """What the answer of a callback means."""
    if isinstance(answer, GoalDecision):
        return answer
    return GoalDecision.ACCEPT if answer is None or answer else GoalDecision.REJECT


class GoalRequests:
    """The goals that wait for whoever iterates over an action server."""

    def __init__(self, scope: Scope, action: str, goals: ServerGoals) -> None:
        self.stream: Stream[Any] = Stream()
        """What the program iterates over."""
        self._scope = scope
        self._action = action
        self._goals = goals
        self._answers: dict[bytes, asyncio.Future[GoalInfo | None]] = {}

    async def ask(self, goal: ServerGoal[Any]) -> GoalInfo | None:
        """Hand a request out and wait for its answer; None is a rejection."""
        answer: asyncio.Future[GoalInfo | None] = asyncio.get_running_loop().create_future()
        self._answers[goal.goal_id] = answer
        try:
            self.stream.push(GoalRequest(self, goal))
            return await answer
        finally:
            del self._answers[goal.goal_id]

    def decide(self, goal: ServerGoal[Any], decision: GoalDecision) -> None:
        """The program's answer, from any thread; raises `AlreadyRespondedError`."""
        self._goals.on_loop(lambda: self._decide(goal, decision))

    def _decide(self, goal: ServerGoal[Any], decision: GoalDecision) -> None:
        answer = self._answers.get(goal.goal_id)
        if answer is None or answer.done():
            raise AlreadyRespondedError(f"goal {goal.goal_id.hex()} was answered already, or its server is closed")
        answer.set_result(self._goals.enter(goal, decision))
        if answer.result() is None and decision is not GoalDecision.REJECT:
            raise AlreadyRespondedError(
                f"goal {goal.goal_id.hex()} is rejected: another one was accepted meanwhile, and the policy is 'reject'"
            )

    def let_go(self, goal: ServerGoal[Any]) -> None:
        """The request object is gone; called wherever the garbage collector runs."""
        if goal.goal_id in self._answers:
            self._scope.bridge.call_soon(lambda: self._reject_forgotten(goal))

    def _reject_forgotten(self, goal: ServerGoal[Any]) -> None:
        answer = self._answers.get(goal.goal_id)
        if answer is not None and not answer.done():
            self._scope.logger.warning(
                f"a goal request of action {self._action} was neither accepted nor rejected; it is rejected"
            )
            settle(answer, None)

    def close(self) -> None:
        """Reject what waits for an answer, and end the iterator."""
        for answer in self._answers.values():
            settle(answer, None)
        self.stream.close()


class GoalRequest(Generic[ActionT_co]):
    """A goal that waits for `accept`, `defer` or `reject`, from iterating over an action server; from any thread.

    One that the program drops without an answer is rejected with a warning.
    """

    def __init__(self, requests: GoalRequests, goal: ServerGoal[ActionT_co]) -> None:
        self._requests = requests
        self._goal = goal

    def __del__(self) -> None:
        self._requests.let_go(self._goal)

    @property
    def goal_id(self) -> bytes:
        """16 bytes."""
        return self._goal.goal_id

    @property
    def goal(self: GoalRequest[Action[GoalT, Any, Any]]) -> GoalT:
        """What the client asks for."""
        return self._goal.request

    def accept(self) -> ServerGoal[ActionT_co]:
        """Accept and begin: the goal is EXECUTING, and it is up to the caller to end it.

        With the policies ``"queue"`` and ``"preempt"`` it may have to wait its turn, and is ACCEPTED until
        ``await goal.started()`` returns.

        Raises:
            AlreadyRespondedError: also when the policy is ``"reject"`` and another goal was accepted meanwhile.
        """
        self._requests.decide(self._goal, GoalDecision.ACCEPT)
        return self._goal

    def defer(self) -> ServerGoal[ActionT_co]:
        """Accept; the goal stays ACCEPTED until its `execute` is called."""
        self._requests.decide(self._goal, GoalDecision.DEFER)
        return self._goal

    def reject(self) -> None:
        """Refuse."""
        self._requests.decide(self._goal, GoalDecision.REJECT)


class CancelRequest(Generic[ActionT_co]):
    """A wish to cancel one goal, from `ActionServer.cancel_requests`."""

    def __init__(self, goal: ServerGoal[ActionT_co], answer: asyncio.Future[bool]) -> None:
        self.goal = goal
        """The goal it is about."""
        self._answer = answer

    def accept(self) -> None:
        """The goal becomes CANCELING; end it with `goal.canceled`, or otherwise. One not started ends by itself."""
        self._decide(True)

    def reject(self) -> None:
        """The goal goes on."""
        self._decide(False)

    def _decide(self, accepted: bool) -> None:
        if self._answer.done():
            raise AlreadyRespondedError("this cancel request was answered already, or its goal has ended")
        self._answer.set_result(accepted)
