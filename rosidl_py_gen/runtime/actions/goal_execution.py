"""Execution of goals: waits until clients receive feedback, then calls `execute` once for each goal.

The value that `execute` returns is the result of its goal, also if it has ended the goal without a result before. If it
raises, its own CancelledError included, or returns without a result, its goal ends as ABORTED. A plain function runs in
a daemon thread of its own: any number of goals run at once, and one that never returns does not keep the program alive.
"""

from __future__ import annotations

import asyncio
import inspect
from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.actions.server_goal import FINISHED, GoalResult, ServerGoal, current_task_or_thread
from rosidl_py_gen.runtime.loop.user_callback import UserCallback, in_thread, is_async

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.publisher import Publisher
    from rosidl_py_gen.runtime.entities.server import ServiceServer

_MATCH_GRACE_S = 0.1
"""Time for completely discovered nodes to match their feedback subscription. They need some milliseconds; a larger
value delays the first goal of a client that never subscribes."""
_DISCOVERY_TIMEOUT_S = 2.0
"""The same for nodes whose endpoints are not all discovered yet: endpoints of Fast DDS may be 1.2 s late
(docs/internals/dds.md 6)."""
_FIRST_HEARTBEAT_S = 0.01
"""Time for the first heartbeat to a new reader, which comes some milliseconds after the match. Without it the first
feedback of every tenth new client was lost (measured)."""


class FeedbackReadiness:
    """Waits until the feedback subscriptions of all clients are matched, before the first goal after they changed.

    A new client may be matched at the goal service before the feedback topic, and feedback that is published in between
    is lost. So is a sample that a reliable DDS writer sends before the first heartbeat of a new reader. Participants
    that have not subscribed in time are not waited for again. While the clients stay the same, goals do not wait.
    """

    def __init__(self, scope: EntityScope, goals: ServiceServer[Any, Any], feedback: Publisher[Any]) -> None:
        self._scope = scope
        self._goals = goals
        self._feedback = feedback
        self._ready_clients: list[bytes] = []
        self._unreachable: set[bytes] = set()

    def is_satisfied(self) -> bool:
        """Return True if the clients are the same as after the last `wait`."""
        return self._goals.matched_clients() == self._ready_clients

    async def wait(self) -> None:
        """Wait until every client has matched the feedback topic, or its time is over."""
        graph, time = self._scope.graph, asyncio.get_running_loop().time
        grace_end_s, clients = time() + _MATCH_GRACE_S, self._goals.matched_clients()

        def is_ready() -> bool:
            missing = self._missing(clients)
            return not missing or (
                time() >= grace_end_s
                and all(graph.node_names_complete(guid) and graph.endpoints_complete(guid) for guid in missing)
            )

        await self._scope.wait_until(is_ready, _DISCOVERY_TIMEOUT_S, lambda: False, poll_s=_FIRST_HEARTBEAT_S)
        self._unreachable |= self._missing(clients)
        await asyncio.sleep(_FIRST_HEARTBEAT_S)
        self._ready_clients = clients

    def _missing(self, clients: list[bytes]) -> set[bytes]:
        """Return the participants of these clients without a matched feedback subscription."""
        participant_of, matched = self._scope.graph.participant_of, self._goals.matched_clients()
        self._unreachable &= {participant_of(guid) or guid for guid in matched}
        participants = {participant_of(guid) or guid for guid in matched if guid in clients}
        subscribed = {participant_of(guid) for guid in self._feedback.matched_subscriptions()}
        return participants - subscribed - self._unreachable


class ExecuteFunction:
    """The execute function of one action server, with its calls; `complete` is `ServerGoals.complete`."""

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
        """Call the function for a goal that is EXECUTING or CANCELING."""
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
