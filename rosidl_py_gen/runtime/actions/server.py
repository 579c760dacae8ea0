"""Action servers: the three services (send_goal, cancel_goal, get_result) that change and read a `ServerGoals`.

Source: docs/internals/protocol.md 8.
"""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Generic

from rosidl_py_gen.base.stamps import set_stamp, stamp_ns
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.base.waiters import complete_threadsafe
from rosidl_py_gen.msgs.action_msgs.msg import GoalInfo as GoalInfoMessage
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal_Request, CancelGoal_Response
from rosidl_py_gen.runtime.actions.goal_callbacks import (
    CancelRequest,
    ExecuteFunction,
    FeedbackReadiness,
    GoalRequest,
    request_decision,
)
from rosidl_py_gen.runtime.actions.server_goal import ServerGoal, ServerGoals
from rosidl_py_gen.runtime.actions.states import GoalDecision, GoalInfo, GoalStatus
from rosidl_py_gen.runtime.actions.types import ActionEntity, ActionT_co, goal_id_of, server_callbacks, set_goal_id
from rosidl_py_gen.runtime.entities.entity_scope import entity_repr
from rosidl_py_gen.runtime.entities.message_types import raw_type
from rosidl_py_gen.runtime.entities.server import ServiceServer
from rosidl_py_gen.runtime.loop.async_queue import AsyncQueue
from rosidl_py_gen.runtime.loop.user_callback import UserCallback
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime.actions.types import ActionNames, ActionType, Policy
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.time.clock import Clock


class ActionServer(ActionEntity, Generic[ActionT_co]):
    """Server of an action, created by `Node.create_action_server`.

    Without `execute`, the server is an async iterator of `GoalRequest`.
    """

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
        super().__init__(scope, action_type, names, type_hash_check)
        self._goal_callback, self._cancel_callback = server_callbacks(
            self._parts, self.name, execute, goal_callback, cancel_callback, goal_policy
        )
        self._policy = goal_policy
        self._unknown = action_type.encode_result(GoalStatus.UNKNOWN, None)
        self._undecided: dict[bytes, asyncio.Future[GoalInfo | None]] = {}
        """Futures of the replies to goal requests for which the program has not decided yet, by goal id."""
        parts = self._parts
        self._goals = ServerGoals(
            parts, clock, action_type, names, self._run, result_timeout_s=result_timeout_s, policy=goal_policy
        )
        self._requests: AsyncQueue[GoalRequest[ActionT_co]] = AsyncQueue()
        self._cancels: AsyncQueue[CancelRequest[ActionT_co]] | None = None
        get_result = replace(action_type.get_result, response=raw_type(action_type.get_result.response))
        parts.register(self._requests)
        self._send_goal: ServiceServer[Any, Any] = ServiceServer(
            parts, action_type.send_goal, names.send_goal, self._on_send_goal, SERVICES_DEFAULT
        )
        ServiceServer(parts, action_type.cancel, names.cancel_goal, self._on_cancel_goal, SERVICES_DEFAULT)
        ServiceServer(parts, get_result, names.get_result, self._on_get_result, SERVICES_DEFAULT)
        readiness = FeedbackReadiness(parts, self._send_goal, self._goals.feedback)
        self._runner = (
            None if execute is None else ExecuteFunction(parts, self.name, execute, readiness, self._goals.complete)
        )
        scope.register(self)

    def _run(self, goal: ServerGoal[Any]) -> None:
        if self._runner is not None:
            self._runner.run(goal)

    def __aiter__(self) -> AsyncQueue[GoalRequest[ActionT_co]]:
        if self._runner is not None:
            raise TypeError(f"action {self.name} has execute=; its goals cannot be iterated over")
        return self._requests

    def cancel_requests(self) -> AsyncQueue[CancelRequest[ActionT_co]]:
        """Return a queue of cancel requests; from now on each request waits until the program accepts or rejects it.

        Raises:
            TypeError: the server has a `cancel_callback`.
        """
        if self._cancel_callback is not True:
            raise TypeError(f"action {self.name} has cancel_callback=; its cancel requests cannot be iterated over")
        if self._cancels is None:
            self._cancels = AsyncQueue()
            self._parts.register(self._cancels)
        return self._cancels

    @property
    def goals(self) -> list[ServerGoal[ActionT_co]]:
        """Goals that have not ended, in the order of acceptance."""
        return list(self._goals.active.values())

    @property
    def feedback_dropped(self) -> int:
        """Number of feedback messages that were not sent, because a client received them too slowly."""
        return self._goals.feedback.dropped

    def _on_send_goal(self, request: Any) -> Any:
        """Return the response to a goal request, or a coroutine that awaits the decision and returns the response."""
        goal_id = goal_id_of(request)
        self._goals.expire()
        if goal_id in self._goals.table or goal_id in self._undecided:
            return self._response(None)
        # Undecided requests count only with `execute`: a program that iterates over requests may never decide.
        if self._policy == "reject" and (self._goals.active or (self._undecided and self._runner is not None)):
            return self._response(None)
        goal: ServerGoal[ActionT_co] = ServerGoal(self._goals, goal_id, self._type.goal.to_value(request.goal))
        if self._runner is not None and self._goal_callback is None:
            return self._response(self._goals.accept_goal(goal, GoalDecision.ACCEPT))
        reply: asyncio.Future[GoalInfo | None] = self._scope.loop_binding.running_loop().create_future()
        if self._goal_callback is None:
            self._requests._push(GoalRequest(self._goals, goal, reply))
        else:
            request_decision(
                self._goal_callback, goal.request, reply, lambda decision: self._goals.accept_goal(goal, decision), None
            )
        if reply.done():
            return self._response(reply.result())
        self._undecided[goal_id] = reply  # now, because the next request is handled before the coroutine starts
        return self._respond_later(goal_id, reply)

    async def _respond_later(self, goal_id: bytes, reply: asyncio.Future[GoalInfo | None]) -> Any:
        try:
            return self._response(await reply)
        finally:
            self._undecided.pop(goal_id, None)

    def _response(self, info: GoalInfo | None) -> Any:
        response = self._type.cls.SendGoal.Response()
        if info is not None:
            response.accepted = True
            set_stamp(response.stamp, info.stamp_ns)
        return response

    async def _on_cancel_goal(self, request: CancelGoal_Request) -> CancelGoal_Response:
        self._goals.expire()
        selection = self._goals.table.select_for_cancel(
            goal_id_of(request.goal_info), stamp_ns(request.goal_info.stamp)
        )
        decisions = await asyncio.gather(*(self._may_cancel(info.goal_id) for info in selection.goals))
        if self._closed:
            return CancelGoal_Response()
        agreed = [info for info, is_agreed in zip(selection.goals, decisions, strict=True) if is_agreed]
        code, canceled = self._goals.cancel(selection, agreed)
        response = CancelGoal_Response(return_code=int(code))
        for info in canceled:
            message = GoalInfoMessage()
            set_goal_id(message, info.goal_id)
            set_stamp(message.stamp, info.stamp_ns)
            response.goals_canceling.append(message)
        return response

    async def _may_cancel(self, goal_id: bytes) -> bool:
        goal = self._goals.active.get(goal_id)
        if goal is None:  # it has just ended; `GoalTable.cancel_code` handles that
            return False
        if self._cancels is None and isinstance(self._cancel_callback, bool):
            return self._cancel_callback
        reply: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        goal._record.cancel_replies.add(reply)
        reply.add_done_callback(goal._record.cancel_replies.discard)
        if self._cancels is not None:
            self._cancels._push(CancelRequest(goal, reply))
        elif isinstance(self._cancel_callback, UserCallback):
            request_decision(
                self._cancel_callback, goal, reply, lambda decision: decision is not GoalDecision.REJECT, False
            )
        return await reply

    def _on_get_result(self, request: Any) -> bytes | Coroutine[Any, Any, bytes]:
        self._goals.expire()
        goal_id = goal_id_of(request)
        goal, _ = self._goals.returning.get(goal_id, (self._goals.active.get(goal_id), None))
        return goal._record.wait_result() if goal is not None else self._goals.table.result(goal_id) or self._unknown

    def _described(self) -> str:
        return f"action {self.name}"

    def __repr__(self) -> str:
        goals = pluralize(len(self.goals), "active goal")
        peers = lambda: len(self._send_goal.matched_clients())  # noqa: E731
        return entity_repr(self, self.name, self.action_type, goals, peers=peers, peer="client")

    def close(self) -> None:
        """Stop serving; may be called twice.

        `is_cancel_requested` of every goal becomes true, execute functions that await something are cancelled, and
        iterations over the server and its cancel requests end.
        """
        super().close()
        for reply in list(self._undecided.values()):
            complete_threadsafe(reply, None)
