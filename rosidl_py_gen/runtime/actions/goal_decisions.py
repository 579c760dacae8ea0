"""Who decides about goals and cancels: a callback, or whoever iterates over the requests; else all are accepted.

Of what a callback answers counts what Python takes for true or false; only None, which functions without a return
statement answer, accepts too. A callback that fails refuses. A goal request that the program lets go of unanswered is
rejected with a warning, so that its client hears of it and a server of one goal at a time is not taken for ever. A
cancel request is refused at the latest when its goal ends.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.base.waiters import set_result_if_pending
from rosidl_py_gen.runtime.actions.states import GoalDecision
from rosidl_py_gen.runtime.actions.types import ActionT_co
from rosidl_py_gen.runtime.entities.server import AlreadyRespondedError

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.server_goal import ServerGoal, ServerGoals
    from rosidl_py_gen.runtime.actions.states import GoalInfo
    from rosidl_py_gen.runtime.actions.types import GoalT
    from rosidl_py_gen.runtime.loop.user_callback import UserCallback

T = TypeVar("T")


def request_decision(
    callback: UserCallback, subject: object, answer: asyncio.Future[T], then: Callable[[GoalDecision], T], refusal: T
) -> None:
    """Let a callback decide, now or in a task; `answer` gets what `then` makes of the decision."""
    task = callback.call(subject, on_result=lambda said: set_result_if_pending(answer, then(decision_of(said))))
    if task is None:
        set_result_if_pending(answer, refusal)
    else:
        task.add_done_callback(lambda _: set_result_if_pending(answer, refusal))


def decision_of(value: object) -> GoalDecision:
    """What the answer of a callback means."""
    if isinstance(value, GoalDecision):
        return value
    return GoalDecision.ACCEPT if value is None or value else GoalDecision.REJECT


class GoalRequest(Generic[ActionT_co]):
    """A goal that waits for `accept`, `defer` or `reject`, from iterating over an action server; from any thread.

    One that the program drops without an answer is rejected with a warning.
    """

    def __init__(
        self, goals: ServerGoals, goal: ServerGoal[ActionT_co], answer: asyncio.Future[GoalInfo | None]
    ) -> None:
        self._goals = goals
        self._goal = goal
        self._answer = answer

    def __del__(self) -> None:
        if not self._answer.done():
            self._goals.reject_garbage_collected(self._answer)

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
        return self._decide(GoalDecision.ACCEPT)

    def defer(self) -> ServerGoal[ActionT_co]:
        """Accept; the goal stays ACCEPTED until its `execute` is called."""
        return self._decide(GoalDecision.DEFER)

    def reject(self) -> None:
        """Refuse."""
        self._decide(GoalDecision.REJECT)

    def _decide(self, decision: GoalDecision) -> ServerGoal[ActionT_co]:
        self._goals.on_loop(lambda: self._answer_with(decision))
        return self._goal

    def _answer_with(self, decision: GoalDecision) -> None:
        if self._answer.done():
            raise AlreadyRespondedError(f"goal {self.goal_id.hex()} was answered already, or its server is closed")
        info = self._goals.accept_goal(self._goal, decision)
        self._answer.set_result(info)
        if info is None and decision is not GoalDecision.REJECT:
            raise AlreadyRespondedError(
                f"goal {self.goal_id.hex()} is rejected: another one was accepted meanwhile, and the policy is 'reject'"
            )


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
