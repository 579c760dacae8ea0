"""Action servers: three services and two topics around a `GoalBook`.

Decides when a goal starts; which state may follow which is `states.py`'s, who accepts it `accept.py`'s, whether it
may be cancelled `cancel.py`'s, how a handler runs `execution.py`'s. Status is published at every transition
(`status.py` says when). A result is encoded when its goal ends, once, and kept as bytes.

Source: protocol.md 8.
"""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from rosidl_py_gen.msgs.action_msgs.msg import GoalInfo as GoalInfoMessage
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal_Request, CancelGoal_Response
from rosidl_py_gen.runtime.actions.accept import AcceptDesk
from rosidl_py_gen.runtime.actions.cancel import CancelDesk
from rosidl_py_gen.runtime.actions.checks import require_server_options
from rosidl_py_gen.runtime.actions.execution import HandlerRunner
from rosidl_py_gen.runtime.actions.readiness import Hearing
from rosidl_py_gen.runtime.actions.requests import GoalRequests
from rosidl_py_gen.runtime.actions.server_goal import (
    CancelRequest,
    GoalAlreadyAnsweredError,
    GoalDecision,
    GoalRequest,
    ServerGoal,
)
from rosidl_py_gen.runtime.actions.states import GoalBook, GoalEvent, GoalInfo, GoalStatus, ResultAnswer
from rosidl_py_gen.runtime.actions.status import StatusTopic
from rosidl_py_gen.runtime.actions.types import ActionT_co, goal_id_of, set_stamp, stamp_ns_of
from rosidl_py_gen.runtime.endpoints.publisher import Publisher
from rosidl_py_gen.runtime.endpoints.server import ServiceServer
from rosidl_py_gen.runtime.endpoints.types import raw_type
from rosidl_py_gen.runtime.loop.callbacks import on_loop
from rosidl_py_gen.runtime.loop.stream import Stream
from rosidl_py_gen.runtime.time.values import ClockType, Duration, limit_to_ns
from rosidl_py_gen.runtime.transport.qos import DEFAULT, SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Coroutine

    from rosidl_py_gen.runtime.actions.types import ActionNames, ActionType
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.time.clock import Clock

T = TypeVar("T")

Policy = Literal["parallel", "reject", "preempt", "queue"]
_LONGEST_SLEEP_S = 3600.0
_ENDS = {
    GoalEvent.SUCCEED: GoalStatus.SUCCEEDED,
    GoalEvent.ABORT: GoalStatus.ABORTED,
    GoalEvent.CANCELED: GoalStatus.CANCELED,
}


class ActionServer(Generic[ActionT_co]):
    """Made by `create_action_server`; without `execute` it is an async iterator of `GoalRequest`."""

    def __init__(
        self,
        scope: Scope,
        clock: Clock,
        action_type: ActionType,
        names: ActionNames,
        execute: Callable[[ServerGoal[ActionT_co]], Any] | None,
        *,
        accept: Callable[[Any], Any] | None,
        on_cancel: Callable[[ServerGoal[ActionT_co]], Any] | None,
        result_timeout_s: float,
        policy: Policy,
    ) -> None:
        require_server_options(names.action, execute, accept, on_cancel, policy)
        kept_ns = limit_to_ns("result_timeout_s", result_timeout_s)
        self.name = names.action
        """Fully qualified name of the action."""
        self.action_type = action_type.ros_name
        """``pkg/action/Name``."""
        self.action_class = action_type.cls
        self._scope = scope
        self._clock = clock
        self._type = action_type
        self._accept = AcceptDesk(scope, names.action, accept)
        self._desk: CancelDesk[ActionT_co] = CancelDesk(scope, names.action, execute, on_cancel)
        self._policy = policy
        self._closed = False
        self._book: GoalBook[bytes, asyncio.Future[bytes]] = GoalBook(kept_ns)
        self._unknown = action_type.encode_result(GoalStatus.UNKNOWN, None)
        self._goals: dict[bytes, ServerGoal[ActionT_co]] = {}
        self._running: set[bytes] = set()
        self._line: deque[bytes] = deque()
        self._undecided: set[bytes] = set()
        self._requests = GoalRequests(scope, names.action)
        self._expiry: asyncio.TimerHandle | None = None
        self._jumps = (
            clock.create_jump_callback(
                post=lambda jump: self._expire(), on_clock_change=True, min_forward=Duration(nanoseconds=1)
            )
            if clock.clock_type is ClockType.ROS_TIME
            else None
        )
        get_result = replace(action_type.get_result, response=raw_type(action_type.get_result.response))
        self._feedback: Publisher[Any] = Publisher(scope, action_type.feedback_message, names.feedback, DEFAULT)
        self._status = StatusTopic(scope, action_type.status, names.status)
        self._rows = self._status.rows
        self._services: list[ServiceServer[Any, Any]] = [
            ServiceServer(scope, action_type.send_goal, names.send_goal, self._on_send_goal, SERVICES_DEFAULT),
            ServiceServer(scope, action_type.cancel, names.cancel_goal, self._on_cancel_goal, SERVICES_DEFAULT),
            ServiceServer(scope, get_result, names.get_result, self._on_get_result, SERVICES_DEFAULT),
        ]
        hearing = Hearing(self._services[0], self._feedback)
        self._runner = None if execute is None else HandlerRunner(scope, self, names.action, execute, hearing)

    # ------------------------------------------------------------------------------------------------ stream style

    def __aiter__(self) -> Stream[GoalRequest[ActionT_co]]:
        if self._runner is not None:
            raise TypeError(f"action {self.name} has callbacks; its goals cannot be iterated over too")
        return self._requests.stream

    def cancel_requests(self) -> Stream[CancelRequest[ActionT_co]]:
        """Decide about cancels yourself: from now on each one waits until it is accepted or rejected."""
        return self._desk.stream()

    @property
    def goals(self) -> list[ServerGoal[ActionT_co]]:
        """The goals that have not ended, in the order of acceptance."""
        return list(self._goals.values())

    @property
    def feedback_dropped(self) -> int:
        """How many feedback messages were never sent because a client was too slow to take them."""
        return self._feedback.dropped

    # -------------------------------------------------------------------------------------------------- send_goal

    def _on_send_goal(self, request: Any) -> Any:
        """The response, or a coroutine when somebody has to be waited for."""
        goal_id = goal_id_of(request)
        self._expire()
        if goal_id in self._book or goal_id in self._undecided:
            return self._response(None)
        # Requests that a program iterates over may stay undecided for ever; those do not stand in the way.
        if self._policy == "reject" and (self._goals or (self._undecided and self._runner is not None)):
            return self._response(None)
        goal: ServerGoal[ActionT_co] = ServerGoal(self, goal_id, self._type.goal.to_value(request.goal))
        if self._runner is None:
            return self._await_answer(goal_id, lambda: self._requests.ask(self, goal))
        self._undecided.add(goal_id)
        decision = self._accept.ask(goal._request)
        if not isinstance(decision, GoalDecision):
            decide = decision
            return self._await_answer(goal_id, lambda: self._ask_callback(goal, decide))
        self._undecided.discard(goal_id)
        return self._response(self._decided(goal, decision))

    def _await_answer(self, goal_id: bytes, ask: Callable[[], Awaitable[GoalInfo | None]]) -> Coroutine[Any, Any, Any]:
        self._undecided.add(goal_id)  # before the next request is looked at
        return self._respond_later(goal_id, ask)

    async def _respond_later(self, goal_id: bytes, ask: Callable[[], Awaitable[GoalInfo | None]]) -> Any:
        try:
            return self._response(await ask())
        finally:
            self._undecided.discard(goal_id)

    async def _ask_callback(
        self, goal: ServerGoal[ActionT_co], decide: Callable[[], Awaitable[GoalDecision]]
    ) -> GoalInfo | None:
        return self._decided(goal, await decide())

    def _decided(self, goal: ServerGoal[ActionT_co], decision: GoalDecision) -> GoalInfo | None:
        if self._closed or decision is GoalDecision.REJECT:
            return None
        return self._enter(goal, start=decision is GoalDecision.ACCEPT)

    def _response(self, info: GoalInfo | None) -> Any:
        response = self._type.cls.SendGoal.Response()
        if info is not None:
            response.accepted = True
            set_stamp(response, info.stamp_ns)
        return response

    def admit(self, goal: ServerGoal[Any], *, start: bool) -> None:
        """See `GoalServer`."""
        answer = self._requests.answer_to(goal)
        if self._policy == "reject" and self._goals:
            answer.set_result(None)
            raise GoalAlreadyAnsweredError(
                f"goal {goal.goal_id.hex()} is rejected: another one was accepted meanwhile, and the policy is 'reject'"
            )
        answer.set_result(self._enter(goal, start=start))

    def refuse(self, goal: ServerGoal[Any]) -> None:
        """See `GoalServer`."""
        self._requests.answer_to(goal).set_result(None)

    def _enter(self, goal: ServerGoal[Any], *, start: bool) -> GoalInfo:
        info = self._book.accept(goal.goal_id, self._clock.now_ns())
        assert info is not None, "a known id was refused before"
        self._rows.add(goal.goal_id, info.stamp_ns, GoalStatus.ACCEPTED)
        self._goals[goal.goal_id] = goal
        if start:
            self._start_in_turn(goal)
        else:
            self._status.publish()
        return info

    # --------------------------------------------------------------------------------------------------- execution

    def start(self, goal_id: bytes) -> None:
        """See `GoalServer`."""
        goal = self._goals.get(goal_id)
        if goal is not None and not goal.has_started and goal_id not in self._line:
            self._start_in_turn(goal)

    def _start_in_turn(self, goal: ServerGoal[Any]) -> None:
        if not self._running or self._policy not in ("queue", "preempt"):
            self._start(goal)
            return
        if self._policy == "preempt":
            for waiting in list(self._line):
                self._cancel_unstarted(waiting)
            for running in self._running:
                if self._book.status(running).is_cancelable:
                    self._mark_canceling(running)
        self._line.append(goal.goal_id)
        self._status.publish()

    def _start(self, goal: ServerGoal[Any]) -> None:
        self._running.add(goal.goal_id)
        self._change(goal.goal_id, GoalEvent.EXECUTE)
        goal.settle_start(started=True)
        if self._runner is not None:
            self._runner.start(goal)

    def finish(self, goal_id: bytes, event: GoalEvent, result: object | None) -> None:
        """See `GoalServer`. A result that cannot be sent fails here, where its author sees it."""
        self._scope.require_open(self._closed, f"action server {self.name}")
        status = _ENDS[event]
        data = self._type.encode_result(status, result)
        waiting = self._book.finish(goal_id, event, data, self._clock.now_ns())
        self._rows.set_status(goal_id, status)
        goal = self._goals.pop(goal_id)
        self._running.discard(goal_id)
        goal.settle_start(started=False)
        for answer in waiting:
            if not answer.done():
                answer.set_result(data)
        self._desk.goal_ended(goal_id)
        self._status.publish()
        if self._line and not self._running:
            self._start(self._goals[self._line.popleft()])
        self._expire()

    def publish_feedback(self, goal_id: bytes, feedback: object) -> None:
        """See `GoalServer`."""
        self._status.flush_here()  # it became EXECUTING before
        message = self._type.cls.FeedbackMessage()
        message.goal_id.uuid = goal_id
        message.feedback = self._type.feedback.to_message(feedback)
        self._feedback.publish(message)

    def status_of(self, goal_id: bytes) -> GoalStatus:
        """See `GoalServer`."""
        return self._book.status(goal_id)

    def on_loop(self, function: Callable[[], T]) -> T:
        """See `GoalServer`. To other threads it returns when the status is published."""
        if self._scope.bridge.in_loop_thread():
            return function()

        def call() -> T:
            try:
                return function()
            finally:
                self._status.flush()

        return on_loop(self._scope.bridge, call)

    # ------------------------------------------------------------------------------------------------------ cancel

    async def _on_cancel_goal(self, request: CancelGoal_Request) -> CancelGoal_Response:
        self._expire()
        selection = self._book.select_for_cancel(goal_id_of(request.goal_info), stamp_ns_of(request.goal_info))
        decisions = await asyncio.gather(*(self._may_cancel(info.goal_id) for info in selection.goals))
        if self._closed:
            return CancelGoal_Response()
        agreed = [info for info, yes in zip(selection.goals, decisions, strict=True) if yes]
        answer = self._book.answer_cancel(selection, agreed)
        response = CancelGoal_Response(return_code=int(answer.code))
        for info in answer.goals:
            found = GoalInfoMessage()
            found.goal_id.uuid = info.goal_id  # type: ignore[assignment]
            set_stamp(found, info.stamp_ns)
            response.goals_canceling.append(found)
        for info in answer.goals:
            if info.goal_id in self._running:
                self._mark_canceling(info.goal_id)
            else:
                self._cancel_unstarted(info.goal_id)
        return response

    async def _may_cancel(self, goal_id: bytes) -> bool:
        goal = self._goals.get(goal_id)
        # One that is gone has just ended; whoever answers will see that.
        return goal is not None and await self._desk.decide(goal, started=goal.has_started)

    def _mark_canceling(self, goal_id: bytes) -> None:
        self._change(goal_id, GoalEvent.CANCEL_GOAL)
        self._goals[goal_id].request_cancel()

    def _cancel_unstarted(self, goal_id: bytes) -> None:
        """End a goal that stands in line or was deferred: nobody else would."""
        if goal_id in self._line:
            self._line.remove(goal_id)
        self._mark_canceling(goal_id)
        self.finish(goal_id, GoalEvent.CANCELED, None)

    # ------------------------------------------------------------------------------------------------------ result

    def _on_get_result(self, request: Any) -> bytes | Coroutine[Any, Any, bytes]:
        self._expire()
        goal_id = goal_id_of(request)
        answer, data = self._book.request_result(goal_id)
        if answer is not ResultAnswer.WAIT:
            return self._unknown if data is None else data
        end: asyncio.Future[bytes] = self._scope.bridge.running_loop().create_future()
        self._book.wait_for_result(goal_id, end)
        return self._await_result(goal_id, end)

    async def _await_result(self, goal_id: bytes, end: asyncio.Future[bytes]) -> bytes:
        try:
            return await end
        except asyncio.CancelledError:
            self._book.forget_waiting(goal_id, end)
            raise

    # ------------------------------------------------------------------------------------------------------ status

    def _change(self, goal_id: bytes, event: GoalEvent) -> None:
        self._rows.set_status(goal_id, self._book.apply(goal_id, event))
        self._status.publish()

    def _expire(self) -> None:
        """Forget what is over, and come back when the next one will be."""
        if self._closed:
            return
        now_ns = self._clock.now_ns()
        gone = self._book.expire(now_ns)
        if gone:
            self._rows.remove(gone)
        # A timer that runs already is never too late: the next end to expire only moves away.
        if self._expiry is None and not self._clock.ros_time_is_active:
            due_ns = self._book.next_expiry_ns()
            loop = self._scope.bridge.loop
            if due_ns is not None and loop is not None:
                left_s = min(max(0.001, (due_ns - now_ns) / 1e9), _LONGEST_SLEEP_S)
                self._expiry = loop.call_later(left_s, self._expire_later)

    def _expire_later(self) -> None:
        self._expiry = None
        self._expire()

    def close(self) -> None:
        """Stop serving. May be called twice.

        `cancel_requested` of every goal becomes true, handlers that await something are cancelled, iterators end.
        """
        if self._closed:
            return
        self._closed = True
        self._scope.disown(self)
        if self._jumps is not None:
            self._jumps.close()
        if self._expiry is not None:
            self._expiry.cancel()
        for goal in self._goals.values():
            goal.request_cancel()
            goal.settle_start(started=False)
        if self._runner is not None:
            self._runner.close()
        for pending in self._book.waiting():
            if not pending.get_loop().is_closed():
                pending.cancel()
        self._accept.close()
        self._requests.close()
        self._desk.close()
        for service in self._services:
            service.close()
        self._feedback.close()
        self._status.close()
