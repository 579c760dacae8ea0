"""User functions of an action server, which decide about goals and cancel requests, and execute goals.

A program that iterates over the requests decides without callbacks. A callback accepts by returning None, as functions
without a return statement do, or a true value. A callback that raises refuses. A goal request that the program drops
without a decision is rejected with a warning, so that its client gets a reply and the server can accept other goals. A
cancel request is refused at the latest when its goal ends.

A goal is executed as soon as clients can receive feedback, by calling `execute` once. The value that `execute` returns
is the result of its goal, also if `execute` has ended the goal without a result before. If `execute` raises, its own
CancelledError included, or returns without a result, its goal ends as ABORTED. A plain function runs in a daemon thread
of its own: any number of goals run at once, and a function that never returns does not keep the program alive.
"""

from __future__ import annotations

import asyncio
import inspect
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.base.waiters import set_result_if_pending
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.actions.server_goal import FINISHED, GoalResult, ServerGoal, current_task_or_thread
from rosidl_py_gen.runtime.actions.states import GoalDecision
from rosidl_py_gen.runtime.actions.types import ActionT_co
from rosidl_py_gen.runtime.entities.server import AlreadyRespondedError
from rosidl_py_gen.runtime.loop.user_callback import UserCallback, in_thread, is_async

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.server_goal import ServerGoals
    from rosidl_py_gen.runtime.actions.states import GoalInfo
    from rosidl_py_gen.runtime.actions.types import GoalT
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.publisher import Publisher
    from rosidl_py_gen.runtime.entities.server import ServiceServer

T = TypeVar("T")


def request_decision(
    callback: UserCallback, argument: object, reply: asyncio.Future[T], apply: Callable[[GoalDecision], T], refusal: T
) -> None:
    """Call a goal or cancel callback, and set the future `reply` when the callback has decided.

    Args:
        callback: user's function.
        argument: argument of the callback.
        reply: future, which may be done already; then it keeps its result.
        apply: applies the decision, and returns the result of `reply`.
        refusal: result of `reply` if the callback raises.
    """

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
    """Goal that a client has sent, from iterating over an action server: `accept`, `defer` or `reject` it. Thread: any.

    If the program drops the request without a decision, the goal is rejected with a warning.
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
        """UUID of the goal, 16 bytes."""
        return self._goal.goal_id

    @property
    def goal(self: GoalRequest[Action[GoalT, Any, Any]]) -> GoalT:
        """Goal message of the client."""
        return self._goal.request

    def accept(self) -> ServerGoal[ActionT_co]:
        """Accept and start the goal, and return it: the goal is EXECUTING, and the caller must end it.

        With the policies ``"queue"`` and ``"preempt"`` the goal may be queued, and is ACCEPTED until
        ``await goal.started()`` returns.

        Raises:
            AlreadyRespondedError: a decision was made already, or another goal was accepted and the policy is
                ``"reject"``.
        """
        return self._decide(GoalDecision.ACCEPT)

    def defer(self) -> ServerGoal[ActionT_co]:
        """Accept the goal, and return it; the goal stays ACCEPTED until its `execute` is called.

        Raises:
            AlreadyRespondedError: a decision was made already, or another goal was accepted and the policy is
                ``"reject"``.
        """
        return self._decide(GoalDecision.DEFER)

    def reject(self) -> None:
        """Reject the goal.

        Raises:
            AlreadyRespondedError: a decision was made already.
        """
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
    """Request of a client to cancel one goal, from iterating over `ActionServer.cancel_requests`."""

    def __init__(self, goal: ServerGoal[ActionT_co], reply: asyncio.Future[bool]) -> None:
        self.goal: ServerGoal[ActionT_co] = goal
        """Goal that the client wants to cancel."""
        self._reply = reply

    def accept(self) -> None:
        """Accept the request: the goal becomes CANCELING, and its execute function ends the goal, for example with
        `goal.canceled`.

        A goal that has not started ends as CANCELED.

        Raises:
            AlreadyRespondedError: a decision was made already, or the goal has ended.
        """
        self._decide(True)

    def reject(self) -> None:
        """Refuse to cancel the goal, which continues.

        Raises:
            AlreadyRespondedError: a decision was made already, or the goal has ended.
        """
        self._decide(False)

    def _decide(self, accepted: bool) -> None:
        if self._reply.done():
            raise AlreadyRespondedError("this cancel request is decided already, or its goal has ended")
        self._reply.set_result(accepted)


_MATCH_GRACE_S = 0.1
"""Time in seconds for completely discovered client nodes to match their feedback subscription, before the first goal
runs.

Nodes need some milliseconds; a larger value delays the first goal of a client that never subscribes.
"""
_DISCOVERY_TIMEOUT_S = 2.0
"""Time in seconds for client nodes that are not completely discovered to match their feedback subscription.

Endpoints of Fast DDS may be discovered 1.2 s late (docs/internals/dds.md 6).
"""
_FIRST_HEARTBEAT_S = 0.01
"""Time in seconds for the first DDS heartbeat to a new reader, which arrives some milliseconds after the match.

Without this time the first feedback of every tenth new client was lost (measured).
"""


class FeedbackReadiness:
    """Check that the feedback subscriptions of all clients are matched, for which the first goal after a change of
    clients waits.

    A new client may be matched at the goal service before the feedback topic, and feedback that is published in between
    is lost. A sample that a reliable DDS writer sends before the first heartbeat of a new reader is lost, too.
    Participants that have not subscribed in time are not waited for again. While the clients stay the same, goals do
    not wait.
    """

    def __init__(self, scope: EntityScope, goals: ServiceServer[Any, Any], feedback: Publisher[Any]) -> None:
        self._scope = scope
        self._goals = goals
        self._feedback = feedback
        self._ready_clients: list[bytes] = []
        self._unreachable: set[bytes] = set()

    def is_satisfied(self) -> bool:
        """Return True if the clients of the action are the same as after the last `wait`."""
        return self._goals.matched_clients() == self._ready_clients

    async def wait(self) -> None:
        """Wait until every client of the action has matched the feedback topic, or the time to do so is over."""
        graph, time = self._scope.graph, asyncio.get_running_loop().time
        grace_end_s, clients = time() + _MATCH_GRACE_S, self._goals.matched_clients()

        def is_ready() -> bool:
            missing = self._missing(clients)
            return not missing or (
                time() >= grace_end_s
                and all(graph.node_names_complete(guid) and graph.endpoints_complete(guid) for guid in missing)
            )

        await self._scope.wait_until(is_ready, _DISCOVERY_TIMEOUT_S, poll_s=_FIRST_HEARTBEAT_S)
        self._unreachable |= self._missing(clients)
        await asyncio.sleep(_FIRST_HEARTBEAT_S)
        self._ready_clients = clients

    def _missing(self, clients: list[bytes]) -> set[bytes]:
        """Return the participants of clients without a matched feedback subscription.

        Participants that did not subscribe in time before are left out.

        Args:
            clients: endpoints of the clients; clients that have disappeared do not count.
        """
        participant_of, matched = self._scope.graph.participant_of, self._goals.matched_clients()
        self._unreachable &= {participant_of(guid) or guid for guid in matched}
        participants = {participant_of(guid) or guid for guid in matched if guid in clients}
        subscribed = {participant_of(guid) for guid in self._feedback.matched_subscriptions()}
        return participants - subscribed - self._unreachable


class ExecuteFunction:
    """Execute function (user's function that executes a goal) of one action server, with its running calls.

    Args:
        complete: `ServerGoals.complete`, which gets the returned results.
    """

    def __init__(
        self,
        scope: EntityScope,
        action: str,
        execute: Callable[..., Any],
        readiness: FeedbackReadiness,
        complete: Callable[..., bool],
    ) -> None:
        self._scope = scope
        self._complete = complete
        self._action = action
        self._execute = execute
        self._is_async = is_async(execute)
        self._callback = UserCallback(scope, self._call, f"the execute function of action {action}")
        self._readiness = readiness

    def run(self, goal: ServerGoal[Any]) -> None:
        """Call the execute function for a goal that is EXECUTING or CANCELING."""
        task = self._callback.call(goal, on_result=partial(self._on_return, goal))
        if task is not None:
            task.add_done_callback(lambda _: self._on_end(goal))

    def _on_end(self, goal: ServerGoal[Any]) -> None:
        goal._record.executed_by = None
        if self._scope.closed:
            return
        if goal.is_active:
            goal.abort()
        else:
            self._complete(goal, None, failed=True)

    async def _call(self, goal: ServerGoal[Any]) -> Any:
        goal._record.executed_by = current_task_or_thread()
        try:
            if not self._readiness.is_satisfied():
                await self._readiness.wait()
            return await (self._execute if self._is_async else self._in_thread)(goal)
        except ClosedError:
            if self._scope.closed:  # the function cannot end its goal, which is not a failure
                return FINISHED
            raise

    async def _in_thread(self, goal: ServerGoal[Any]) -> Any:
        def execute() -> Any:
            goal._record.executed_by = current_task_or_thread()
            return self._execute(goal)

        try:
            result = await in_thread(f"execute {self._action}", execute)
            goal._record.executed_by = current_task_or_thread()
            return await result if inspect.isawaitable(result) else result
        except asyncio.CancelledError:
            goal._record.request_cancel()  # the function may still run in its thread
            raise

    def _on_return(self, goal: ServerGoal[Any], value: object) -> None:
        result = None if isinstance(value, GoalResult) else value
        if self._scope.closed:
            return
        if not goal.is_active:
            if not self._complete(goal, result):
                self._scope.logger.warning(
                    f"execute function of action {self._action}: its result for goal {goal.goal_id.hex()} is ignored, "
                    "because the goal had ended with another result"
                )
        elif result is not None:
            goal.succeed(result)
        else:
            self._scope.logger.warning(
                f"execute function of action {self._action}: returned without ending goal {goal.goal_id.hex()}; the "
                "goal is aborted"
            )
