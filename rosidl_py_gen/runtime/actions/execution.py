"""Runs the `execute` function of an action server, one call for each goal.

Decides how the end of a handler becomes the end of its goal: what it returns is the result, an exception (its own
CancelledError too) is ABORTED, and so is an end that says nothing. A plain function runs in a daemon thread of its own:
any number of goals at once, and one that never returns does not keep the program alive.
"""

from __future__ import annotations

import asyncio
import inspect
from typing import TYPE_CHECKING, Any, Protocol

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.actions.server_goal import Finished, ServerGoal
from rosidl_py_gen.runtime.actions.states import GoalEvent
from rosidl_py_gen.runtime.endpoints.scope import is_async
from rosidl_py_gen.runtime.loop.callbacks import in_thread, is_own_cancel

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.actions.readiness import Hearing
    from rosidl_py_gen.runtime.endpoints.scope import Scope


class GoalEnder(Protocol):
    """What ends a goal: the action server."""

    def finish(self, goal_id: bytes, event: GoalEvent, result: object | None) -> None:
        """See `GoalServer`."""


class HandlerRunner:
    """The running handlers of one action server."""

    def __init__(
        self, scope: Scope, server: GoalEnder, action: str, execute: Callable[..., Any], hearing: Hearing
    ) -> None:
        self._scope = scope
        self._server = server
        self._action = action
        self._execute = execute
        self._hearing = hearing
        self._is_async = is_async(execute)
        self._tasks: set[asyncio.Task[None]] = set()
        self._closed = False

    def start(self, goal: ServerGoal[Any]) -> None:
        """Run the handler on a goal that is EXECUTING or CANCELING."""
        task = self._scope.start(self._run(goal))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _run(self, goal: ServerGoal[Any]) -> None:
        try:
            outcome = await self._call(goal)
            if goal.is_active and outcome is not None and not isinstance(outcome, Finished):
                self._server.finish(goal.goal_id, GoalEvent.SUCCEED, outcome)
            elif goal.is_active:
                self._scope.logger.warning(
                    f"the handler of action {self._action} returned without ending goal {goal.goal_id.hex()}; "
                    "aborting it"
                )
        except asyncio.CancelledError:
            goal.request_cancel()  # a plain function may still run in its thread
            if self._closed or is_own_cancel():
                raise
            self._scope.logger.warning(
                f"the handler of action {self._action} was cancelled, or awaited something that was; "
                f"goal {goal.goal_id.hex()} is aborted"
            )
        except Exception as error:
            if not (self._closed and isinstance(error, ClosedError)):
                self._scope.report_failure(f"the handler of action {self._action}")
        finally:
            if goal.is_active and not self._closed:
                self._server.finish(goal.goal_id, GoalEvent.ABORT, None)

    async def _call(self, goal: ServerGoal[Any]) -> Any:
        if not self._hearing.is_settled():
            await self._hearing.settle()
        if self._is_async:
            return await self._execute(goal)
        outcome = await in_thread(f"action handler {self._action}", self._execute, goal)
        return await outcome if inspect.isawaitable(outcome) else outcome

    def close(self) -> None:
        """Cancel what awaits something. A plain function goes on until it looks at `cancel_requested`."""
        self._closed = True
        for task in self._tasks:
            if not task.get_loop().is_closed():
                task.cancel()
