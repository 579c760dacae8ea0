"""Action servers: the three services of a `ServerGoals`.

Decides which requests are answered at once and which wait: for somebody's decision, or for a result. What becomes of
accepted goals is `server_goal.py`'s, who decides about requests `decisions.py`'s, how a handler runs `execution.py`'s.

Source: docs/internals/protocol.md 8.
"""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Generic

from rosidl_py_gen.base.stamps import set_stamp, stamp_ns
from rosidl_py_gen.base.waiters import complete_threadsafe
from rosidl_py_gen.msgs.action_msgs.msg import GoalInfo as GoalInfoMessage
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal_Request, CancelGoal_Response
from rosidl_py_gen.runtime.actions.argument_checks import require_server_options
from rosidl_py_gen.runtime.actions.goal_decisions import CancelRequest, GoalRequest, request_decision
from rosidl_py_gen.runtime.actions.goal_execution import ExecuteRunner, FeedbackReadiness
from rosidl_py_gen.runtime.actions.server_goal import ServerGoal, ServerGoals
from rosidl_py_gen.runtime.actions.states import GoalDecision, GoalInfo, GoalStatus
from rosidl_py_gen.runtime.actions.types import ActionT_co, goal_id_of, set_goal_id
from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity, entity_repr, pluralize
from rosidl_py_gen.runtime.entities.message_types import raw_type
from rosidl_py_gen.runtime.entities.server import ServiceServer
from rosidl_py_gen.runtime.loop.async_queue import AsyncQueue
from rosidl_py_gen.runtime.loop.user_callback import UserCallback
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime.actions.argument_checks import Policy
    from rosidl_py_gen.runtime.actions.types import ActionNames, ActionType
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.time.clock import Clock


class ActionServer(CompositeEntity, Generic[ActionT_co]):
    """Made by `create_action_server`; without `execute` it is an async iterator of `GoalRequest`."""

    def __init__(
        self,
        scope: EntityScope,
        clock: Clock,
        action_type: ActionType,
        names: ActionNames,
        execute: Callable[[ServerGoal[ActionT_co]], Any] | None,
        *,
        goal_callback: Callable[[Any], Any] | None,
        cancel_callback: Callable[[ServerGoal[ActionT_co]], Any] | bool,
        result_timeout_s: float,
        goal_policy: Policy,
        type_hash_check: TypeCheck | None = None,
    ) -> None:
        require_server_options(names.action, execute, goal_callback, cancel_callback, goal_policy)
        self.name = names.action
        """Fully qualified name of the action."""
        self.action_type = action_type.ros_name
        """``pkg/action/Name``."""
        self.action_class = action_type.cls
        """The generated class, with `Goal`, `Result` and `Feedback`."""
        super().__init__(scope, type_hash_check=type_hash_check)
        self._type = action_type
        self._policy = goal_policy
        self._unknown = action_type.encode_result(GoalStatus.UNKNOWN, None)
        self._undecided: dict[bytes, asyncio.Future[GoalInfo | None]] = {}
        parts = self._parts
        self._goals = ServerGoals(
            parts, clock, action_type, names, self._run, result_timeout_s=result_timeout_s, policy=goal_policy
        )
        self._accept = (
            None if goal_callback is None else UserCallback(parts, goal_callback, f"the accept callback of {self.name}")
        )
        self._on_cancel: UserCallback | bool = (
            cancel_callback
            if isinstance(cancel_callback, bool)
            else UserCallback(parts, cancel_callback, f"the on_cancel callback of {self.name}")
        )
        self._requests: AsyncQueue[GoalRequest[ActionT_co]] = AsyncQueue()
        self._cancels: AsyncQueue[CancelRequest[ActionT_co]] | None = None
        get_result = replace(action_type.get_result, response=raw_type(action_type.get_result.response))
        parts.register(self._requests)
        send_goal: ServiceServer[Any, Any] = ServiceServer(
            parts, action_type.send_goal, names.send_goal, self._on_send_goal, SERVICES_DEFAULT
        )
        ServiceServer(parts, action_type.cancel, names.cancel_goal, self._on_cancel_goal, SERVICES_DEFAULT)
        ServiceServer(parts, get_result, names.get_result, self._on_get_result, SERVICES_DEFAULT)
        self._send_goal = send_goal
        readiness = FeedbackReadiness(parts, send_goal, self._goals.feedback)
        self._runner = (
            None if execute is None else ExecuteRunner(parts, self.name, execute, readiness, self._goals.complete)
        )
        scope.register(self)

    def _run(self, goal: ServerGoal[Any]) -> None:
        if self._runner is not None:
            self._runner.run(goal)

    # ------------------------------------------------------------------------------------------------ stream style

    def __aiter__(self) -> AsyncQueue[GoalRequest[ActionT_co]]:
        if self._runner is not None:
            raise TypeError(f"action {self.name} has callbacks; its goals cannot be iterated over too")
        return self._requests

    def cancel_requests(self) -> AsyncQueue[CancelRequest[ActionT_co]]:
        """Decide about cancels yourself: from now on each one waits until it is accepted or rejected."""
        if self._on_cancel is not True:
            raise TypeError(f"action {self.name} has on_cancel; its cancels cannot be iterated over too")
        if self._cancels is None:
            self._cancels = AsyncQueue()
            self._parts.register(self._cancels)
        return self._cancels

    @property
    def goals(self) -> list[ServerGoal[ActionT_co]]:
        """The goals that have not ended, in the order of acceptance."""
        return list(self._goals.active.values())

    @property
    def feedback_dropped(self) -> int:
        """How many feedback messages were never sent because a client was too slow to take them."""
        return self._goals.feedback.dropped

    # -------------------------------------------------------------------------------------------------- send_goal

    def _on_send_goal(self, request: Any) -> Any:
        """The response, or a coroutine when somebody has to be waited for."""
        goal_id = goal_id_of(request)
        self._goals.expire()
        if goal_id in self._goals.book or goal_id in self._undecided:
            return self._response(None)
        # Requests that a program iterates over may stay undecided for ever; those do not stand in the way.
        if self._policy == "reject" and (self._goals.active or (self._undecided and self._runner is not None)):
            return self._response(None)
        goal: ServerGoal[ActionT_co] = ServerGoal(self._goals, goal_id, self._type.goal.to_value(request.goal))
        if self._runner is not None and self._accept is None:
            return self._response(self._goals.accept_goal(goal, GoalDecision.ACCEPT))
        answer: asyncio.Future[GoalInfo | None] = self._scope.bridge.running_loop().create_future()
        if self._accept is None:
            self._requests._push(GoalRequest(self._goals, goal, answer))
        else:
            request_decision(
                self._accept, goal.request, answer, lambda decision: self._goals.accept_goal(goal, decision), None
            )
        if answer.done():
            return self._response(answer.result())
        self._undecided[goal_id] = answer  # before the next request is looked at
        return self._respond_later(goal_id, answer)

    async def _respond_later(self, goal_id: bytes, answer: asyncio.Future[GoalInfo | None]) -> Any:
        try:
            return self._response(await answer)
        finally:
            self._undecided.pop(goal_id, None)

    def _response(self, info: GoalInfo | None) -> Any:
        response = self._type.cls.SendGoal.Response()
        if info is not None:
            response.accepted = True
            set_stamp(response.stamp, info.stamp_ns)
        return response

    # ------------------------------------------------------------------------------------------------------ cancel

    async def _on_cancel_goal(self, request: CancelGoal_Request) -> CancelGoal_Response:
        self._goals.expire()
        wanted = goal_id_of(request.goal_info), stamp_ns(request.goal_info.stamp)
        selection = self._goals.book.select_for_cancel(*wanted)
        decisions = await asyncio.gather(*(self._may_cancel(info.goal_id) for info in selection.goals))
        if self._closed:
            return CancelGoal_Response()
        agreed = [info for info, yes in zip(selection.goals, decisions, strict=True) if yes]
        code, canceled = self._goals.cancel(selection, agreed)
        response = CancelGoal_Response(return_code=int(code))
        for info in canceled:
            found = GoalInfoMessage()
            set_goal_id(found, info.goal_id)
            set_stamp(found.stamp, info.stamp_ns)
            response.goals_canceling.append(found)
        return response

    async def _may_cancel(self, goal_id: bytes) -> bool:
        goal = self._goals.active.get(goal_id)
        if goal is None:  # it has just ended; whoever answers will see that
            return False
        if self._cancels is None and isinstance(self._on_cancel, bool):
            return self._on_cancel
        answer: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        goal._record.cancel_answers.add(answer)
        answer.add_done_callback(goal._record.cancel_answers.discard)
        if self._cancels is not None:
            self._cancels._push(CancelRequest(goal, answer))
        elif isinstance(self._on_cancel, UserCallback):
            request_decision(self._on_cancel, goal, answer, lambda decision: decision is not GoalDecision.REJECT, False)
        return await answer

    # ------------------------------------------------------------------------------------------------------ result

    def _on_get_result(self, request: Any) -> bytes | Coroutine[Any, Any, bytes]:
        self._goals.expire()
        goal_id = goal_id_of(request)
        goal, _ = self._goals.returning.get(goal_id, (self._goals.active.get(goal_id), None))
        return goal._record.result_bytes() if goal is not None else self._goals.book.result(goal_id) or self._unknown

    def __repr__(self) -> str:
        goals = pluralize(len(self.goals), "active goal")
        peers = lambda: len(self._send_goal.matched_clients())  # noqa: E731
        return entity_repr(self, self.name, self.action_type, goals, peers=peers, peer="client")

    def close(self) -> None:
        """Stop serving. May be called twice.

        `cancel_requested` of every goal becomes true, functions that await something are cancelled, iterators end.
        """
        super().close()
        for answer in list(self._undecided.values()):
            complete_threadsafe(answer, None)
