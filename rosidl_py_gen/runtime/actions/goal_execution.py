"""Runs the `execute` function of an action server, one call for each goal.

Decides how the end of a handler becomes the end of its goal: what it returns is the result, also of a goal that it
ended before without one; an exception (its own CancelledError too) is ABORTED, and so is an end that says nothing. A
plain function runs in a daemon thread of its own: any number of goals at once, and one that never returns does not keep
the program alive.

Decides too how long the first handler after a change among the clients waits until their feedback would arrive.
"""

from __future__ import annotations

import asyncio
import inspect
from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.actions.server_goal import FINISHED, GoalResult, ServerGoal, current_task_or_thread
from rosidl_py_gen.runtime.loop.callable_checks import in_thread, is_async
from rosidl_py_gen.runtime.loop.user_callback import UserCallback

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.publisher import Publisher
    from rosidl_py_gen.runtime.entities.server import ServiceServer

_MATCH_GRACE_S, _DISCOVERY_TIMEOUT_S = 0.1, 2.0
_FIRST_HEARTBEAT_S = 0.01


class FeedbackReadiness:
    """Whether the clients that may send goals would receive feedback yet.

    A client that has just appeared may be connected with the goal service before it is with the feedback topic, and
    what is published until then is lost. So is what a reliable DDS writer sends before a new reader has had its first
    heartbeat, which comes a few milliseconds after they were connected (measured: the first feedback of every tenth
    new client). So 100 ms are given to connections, up to 2 s to those of nodes that are not wholly known, as endpoints
    of Fast DDS may be 1.2 s late (docs/internals/dds.md 6), and 10 ms to the heartbeat. While all clients are known,
    goals wait for nothing.
    """

    def __init__(self, scope: EntityScope, goals: ServiceServer[Any, Any], feedback: Publisher[Any]) -> None:
        self._scope = scope
        self._goals = goals
        self._feedback = feedback
        self._known: list[bytes] = []
        self._unreachable: set[bytes] = set()

    def is_satisfied(self) -> bool:
        """Whether the clients are those of last time."""
        return self._goals.matched_clients() == self._known

    async def wait(self) -> None:
        """Return when every client is connected, or those who are not have had their time.

        Clients that come meanwhile have theirs with the next goal.
        """
        graph, time = self._scope.graph, asyncio.get_running_loop().time
        soon_s, known = time() + _MATCH_GRACE_S, self._goals.matched_clients()

        def is_ready() -> bool:
            missing = self._missing(known)
            return not missing or (
                time() >= soon_s
                and all(graph.node_names_complete(one) and graph.endpoints_complete(one) for one in missing)
            )

        await self._scope.wait_until(is_ready, _DISCOVERY_TIMEOUT_S, lambda: False, poll_s=_FIRST_HEARTBEAT_S)
        self._unreachable |= self._missing(known)
        await asyncio.sleep(_FIRST_HEARTBEAT_S)
        self._known = known

    def _missing(self, among: list[bytes]) -> set[bytes]:
        """The participants that have some of these clients, but no subscription to feedback."""
        participant_of, matched = self._scope.graph.participant_of, self._goals.matched_clients()
        self._unreachable &= {participant_of(guid) or guid for guid in matched}
        clients = {participant_of(guid) or guid for guid in matched if guid in among}
        return clients - {participant_of(guid) for guid in self._feedback.matched_subscriptions()} - self._unreachable


class ExecuteRunner:
    """Calls the handler of one action server; `scope` is the server's."""

    def __init__(
        self,
        scope: EntityScope,
        action: str,
        execute: Callable[..., Any],
        readiness: FeedbackReadiness,
        complete: Callable[..., bool],
    ) -> None:
        """`complete` is that of the server's `ServerGoals`."""
        self._scope = scope
        self._complete = complete
        self._action = action
        self._execute = execute
        self._is_async = is_async(execute)
        self._handler = UserCallback(scope, self._call, f"the handler of action {action}")
        self._readiness = readiness

    def run(self, goal: ServerGoal[Any]) -> None:
        """Run the handler on a goal that is EXECUTING or CANCELING."""
        task = self._handler.call(goal, on_result=partial(self._returned, goal))
        if task is not None:
            task.add_done_callback(lambda _: self._ended(goal))

    def _ended(self, goal: ServerGoal[Any]) -> None:
        goal._record.handler = None
        if self._scope.closed:
            return
        if goal.is_active:
            goal.abort()
        else:
            self._complete(goal, None, failed=True)

    async def _call(self, goal: ServerGoal[Any]) -> Any:
        goal._record.handler = current_task_or_thread()
        try:
            if not self._readiness.is_satisfied():
                await self._readiness.wait()
            return await (self._execute if self._is_async else self._in_thread)(goal)
        except ClosedError:
            if self._scope.closed:  # a goal that cannot be ended any more is no failure of its handler
                return FINISHED
            raise

    async def _in_thread(self, goal: ServerGoal[Any]) -> Any:
        try:
            outcome = await in_thread(f"action handler {self._action}", self._begin, goal)
            goal._record.handler = current_task_or_thread()
            return await outcome if inspect.isawaitable(outcome) else outcome
        except asyncio.CancelledError:
            goal._record.request_cancel()  # the function may still run in its thread
            raise

    def _begin(self, goal: ServerGoal[Any]) -> Any:
        goal._record.handler = current_task_or_thread()
        return self._execute(goal)

    def _returned(self, goal: ServerGoal[Any], outcome: object) -> None:
        result = None if isinstance(outcome, GoalResult) else outcome
        if self._scope.closed:
            return
        if not goal.is_active:
            if not self._complete(goal, result):
                self._scope.logger.warning(
                    f"the handler of action {self._action} returned a result for goal {goal.goal_id.hex()}, which had "
                    "ended with another one; what it returned is not sent"
                )
        elif result is not None:
            goal.succeed(result)
        else:
            self._scope.logger.warning(
                f"the handler of action {self._action} returned without ending goal {goal.goal_id.hex()}; aborting it"
            )
