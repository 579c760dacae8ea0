"""Decisions about goals and cancels, by a callback or by a program that iterates over the requests.

A callback accepts with None, which functions without a return statement return, or with a true value. A callback that
raises refuses. A goal request that the program drops without a decision is rejected with a warning, so that its client
gets a reply and the server can accept other goals. A cancel request is refused at the latest when its goal ends.
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
    callback: UserCallback, argument: object, reply: asyncio.Future[T], apply: Callable[[GoalDecision], T], refusal: T
) -> None:
    """Call a callback and set `reply` to what `apply` makes of its decision, or to `refusal` if it fails."""

    def on_result(value: object) -> None:
        if not isinstance(value, GoalDecision):
            value = GoalDecision.ACCEPT if value is None or value else GoalDecision.REJECT
        set_result_if_pending(reply, apply(value))

    task = callback.call(argument, on_result=on_result)
    if task is None:
        set_result_if_pending(reply, refusal)
    else:
        task.add_done_callback(lambda _: set_result_if_pending(reply, refusal))


class GoalRequest(Generic[ActionT_co]):
    """Goal that waits for `accept`, `defer` or `reject`, from iterating over an action server. Thread: any.

    If the program drops it without a decision, it is rejected with a warning.
    """

    def __init__(
        self, goals: ServerGoals, goal: ServerGoal[ActionT_co], reply: asyncio.Future[GoalInfo | None]
    ) -> None:
        self._goals = goals
        self._goal = goal
        self._reply = reply

    def __del__(self) -> None:
        if not self._reply.done():
            self._goals.reject_garbage_collected(self._reply)

    @property
    def goal_id(self) -> bytes:
        """16 bytes."""
        return self._goal.goal_id

    @property
    def goal(self: GoalRequest[Action[GoalT, Any, Any]]) -> GoalT:
        """Goal message of the client."""
        return self._goal.request

    def accept(self) -> ServerGoal[ActionT_co]:
        """Accept and start the goal: it is EXECUTING, and the caller must end it.

        With the policies ``"queue"`` and ``"preempt"`` it may be queued, and is ACCEPTED until
        ``await goal.started()`` returns.

        Raises:
            AlreadyRespondedError: a decision was made already, or another goal was accepted and the policy is
                ``"reject"``.
        """
        return self._decide(GoalDecision.ACCEPT)

    def defer(self) -> ServerGoal[ActionT_co]:
        """Accept the goal; it stays ACCEPTED until its `execute` is called. Raises as `accept`."""
        return self._decide(GoalDecision.DEFER)

    def reject(self) -> None:
        """Reject the goal."""
        self._decide(GoalDecision.REJECT)

    def _decide(self, decision: GoalDecision) -> ServerGoal[ActionT_co]:
        def respond() -> None:
            if self._reply.done():
                raise AlreadyRespondedError(f"goal {self.goal_id.hex()} is decided already, or its server is closed")
            info = self._goals.accept_goal(self._goal, decision)
            self._reply.set_result(info)
            if info is None and decision is not GoalDecision.REJECT:
                raise AlreadyRespondedError(
                    f"goal {self.goal_id.hex()} is rejected: another goal is active, and the policy is 'reject'"
                )

        self._goals.on_loop(respond)
        return self._goal


class CancelRequest(Generic[ActionT_co]):
    """Request to cancel one goal, from `ActionServer.cancel_requests`."""

    def __init__(self, goal: ServerGoal[ActionT_co], reply: asyncio.Future[bool]) -> None:
        self.goal: ServerGoal[ActionT_co] = goal
        """Goal that the client wants to cancel."""
        self._reply = reply

    def accept(self) -> None:
        """Make the goal CANCELING; its execute function ends it, for example with `goal.canceled`.

        A goal that has not started ends as CANCELED.
        """
        self._decide(True)

    def reject(self) -> None:
        """Refuse; the goal continues."""
        self._decide(False)

    def _decide(self, accepted: bool) -> None:
        if self._reply.done():
            raise AlreadyRespondedError("this cancel request is decided already, or its goal has ended")
        self._reply.set_result(accepted)
