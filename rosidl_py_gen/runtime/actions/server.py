"""Action servers: the services that change and read a `ServerGoals`, and the user functions that decide and execute.

The services are send_goal, cancel_goal and get_result. A program that iterates over the requests decides without
callbacks. A callback accepts by returning None, as functions without a return statement do, or a true value. A callback
that raises refuses. A goal request that the program drops without a decision is rejected with a warning, so that its
client gets a reply and the server can accept other goals. A cancel request is refused at the latest when its goal ends.

A goal is executed as soon as clients can receive feedback, by calling `execute` once. The value that `execute` returns
is the result of its goal, also if `execute` has ended the goal without a result before. If `execute` raises, its own
CancelledError included, or returns without a result, its goal ends as ABORTED. A plain function runs in a daemon thread
of its own: any number of goals run at once, and a function that never returns does not keep the program alive.
Source: docs/internals/protocol.md 8.
"""

from __future__ import annotations

import asyncio
import inspect
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.base.stamps import set_stamp, stamp_ns
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.base.waiters import complete_threadsafe
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.msgs.action_msgs import msg
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal
from rosidl_py_gen.runtime.actions.server_goal import (
    FINISHED,
    GoalResult,
    ServerGoal,
    ServerGoals,
    current_task_or_thread,
    record_of,
)
from rosidl_py_gen.runtime.actions.states import GoalDecision, GoalInfo, GoalStatus
from rosidl_py_gen.runtime.actions.types import ActionEntity, ActionT_co, goal_id_of, server_callbacks, set_goal_id
from rosidl_py_gen.runtime.entities.entity_scope import entity_repr
from rosidl_py_gen.runtime.entities.message_types import raw_type
from rosidl_py_gen.runtime.entities.services import AlreadyRespondedError, ServiceServer
from rosidl_py_gen.runtime.loop.callbacks import UserCallback, in_thread, is_async
from rosidl_py_gen.runtime.loop.queues import AsyncQueue
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.types import ActionNames, ActionType, GoalT, Policy
    from rosidl_py_gen.runtime.clocks import Clock
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.topics import Publisher
    from rosidl_py_gen.runtime.graph import TypeCheck


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

    async def _on_cancel_goal(self, request: CancelGoal.Request) -> CancelGoal.Response:
        self._goals.expire()
        selection = self._goals.table.select_for_cancel(
            goal_id_of(request.goal_info), stamp_ns(request.goal_info.stamp)
        )
        decisions = await asyncio.gather(*(self._may_cancel(info.goal_id) for info in selection.goals))
        if self._closed:
            return CancelGoal.Response()
        agreed = [info for info, is_agreed in zip(selection.goals, decisions, strict=True) if is_agreed]
        code, canceled = self._goals.cancel(selection, agreed)
        response = CancelGoal.Response(return_code=int(code))
        for info in canceled:
            message = msg.GoalInfo()
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
        record_of(goal).cancel_replies.add(reply)
        reply.add_done_callback(record_of(goal).cancel_replies.discard)
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
        return record_of(goal).wait_result() if goal is not None else self._goals.table.result(goal_id) or self._unknown

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


# ---------------------------------------------------------------------------------------------- decisions and execution

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
        complete_threadsafe(reply, apply(value))

    task = callback.call(argument, on_result=on_result)
    if task is None:
        complete_threadsafe(reply, refusal)
    else:
        task.add_done_callback(lambda _: complete_threadsafe(reply, refusal))


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
        record_of(goal).executed_by = None
        if self._scope.closed:
            return
        if goal.is_active:
            goal.abort()
        else:
            self._complete(goal, None, failed=True)

    async def _call(self, goal: ServerGoal[Any]) -> Any:
        record_of(goal).executed_by = current_task_or_thread()
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
            record_of(goal).executed_by = current_task_or_thread()
            return self._execute(goal)

        try:
            result = await in_thread(f"execute {self._action}", execute)
            record_of(goal).executed_by = current_task_or_thread()
            return await result if inspect.isawaitable(result) else result
        except asyncio.CancelledError:
            record_of(goal).request_cancel()  # the function may still run in its thread
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
