"""Action servers: three services and two topics around a `GoalBook`.

Decides who is asked about a goal and when it starts; which state may follow which is `goal.py`'s, whether a goal may be
cancelled is `action_cancel.py`'s. Status is published at every transition. A plain `execute` function runs in a thread,
so that it may take its time.

Source: protocol.md 8.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias, TypeVar

from rosidl_py_gen.msgs.action_msgs.msg import GoalInfo as GoalInfoMessage
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal_Request, CancelGoal_Response
from rosidl_py_gen.runtime.action_cancel import CancelDesk
from rosidl_py_gen.runtime.action_goal import (
    CancelRequest,
    Finished,
    GoalAlreadyAnsweredError,
    GoalDecision,
    GoalRequest,
    ServerGoal,
)
from rosidl_py_gen.runtime.action_types import goal_id_of, set_stamp, stamp_ns_of
from rosidl_py_gen.runtime.callbacks import on_loop, result_of
from rosidl_py_gen.runtime.clock import ClockType
from rosidl_py_gen.runtime.goal import (
    CancelCode,
    CancelSelection,
    GoalBook,
    GoalEvent,
    GoalInfo,
    GoalStatus,
    ResultAnswer,
    cancel_answer,
)
from rosidl_py_gen.runtime.publisher import Publisher
from rosidl_py_gen.runtime.qos import ACTION_STATUS, DEFAULT, SERVICES_DEFAULT
from rosidl_py_gen.runtime.scope import is_async
from rosidl_py_gen.runtime.service import ServiceServer
from rosidl_py_gen.runtime.status_rows import StatusRows
from rosidl_py_gen.runtime.stream import Stream
from rosidl_py_gen.runtime.time_values import Duration

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime.action_types import ActionNames, ActionType
    from rosidl_py_gen.runtime.clock import Clock
    from rosidl_py_gen.runtime.scope import Scope

GoalT = TypeVar("GoalT")
ResultT = TypeVar("ResultT")
FeedbackT = TypeVar("FeedbackT")
T = TypeVar("T")

Policy = Literal["parallel", "reject", "preempt", "queue"]
_POLICIES = ("parallel", "reject", "preempt", "queue")
_LONGEST_SLEEP_S = 3600.0
_Unanswered: TypeAlias = "tuple[ServerGoal[GoalT, ResultT, FeedbackT], asyncio.Future[GoalInfo | None]]"


class ActionServer(Generic[GoalT, ResultT, FeedbackT]):
    """Made by `create_action_server`; without `execute` it is an async iterator of `GoalRequest`."""

    def __init__(
        self,
        scope: Scope,
        clock: Clock,
        action_type: ActionType[GoalT, ResultT, FeedbackT],
        names: ActionNames,
        execute: Callable[[ServerGoal[GoalT, ResultT, FeedbackT]], Any] | None,
        *,
        accept: Callable[[GoalT], Any] | None,
        on_cancel: Callable[[ServerGoal[GoalT, ResultT, FeedbackT]], Any] | None,
        result_timeout_s: float,
        policy: Policy,
    ) -> None:
        if policy not in _POLICIES:
            raise ValueError(f"policy must be one of {', '.join(_POLICIES)}, got {policy!r}")
        self.name = names.action
        """Fully qualified name of the action."""
        self.action_type = action_type.ros_name
        """``pkg/action/Name``."""
        self._scope = scope
        self._clock = clock
        self._type = action_type
        self._execute = execute
        self._accept = accept
        self._desk: CancelDesk[GoalT, ResultT, FeedbackT] = CancelDesk(scope, names.action, execute, on_cancel)
        self._policy = policy
        self._closed = False
        self._book: GoalBook[Message, asyncio.Future[tuple[GoalStatus, Message]]] = GoalBook(
            round(result_timeout_s * 1e9)
        )
        self._goals: dict[bytes, ServerGoal[GoalT, ResultT, FeedbackT]] = {}
        self._rows = StatusRows()
        self._started: set[bytes] = set()
        self._unanswered: dict[bytes, _Unanswered[GoalT, ResultT, FeedbackT]] = {}
        self._line: deque[bytes] = deque()
        self._tasks: set[asyncio.Task[None]] = set()
        self._waiting: set[asyncio.Future[Any]] = set()
        self._requests: Stream[GoalRequest[GoalT, ResultT, FeedbackT]] = Stream()
        self._expiry: asyncio.TimerHandle | None = None
        self._jumps = (
            clock.create_jump_callback(
                post=lambda jump: self._expire(), on_clock_change=True, min_forward=Duration(nanoseconds=1)
            )
            if clock.clock_type is ClockType.ROS_TIME
            else None
        )
        self._feedback: Publisher[Any] = Publisher(scope, action_type.feedback_message, names.feedback, DEFAULT)
        self._status: Publisher[Any] = Publisher(scope, action_type.status, names.status, ACTION_STATUS)
        self._services: list[ServiceServer[Any, Any]] = [
            ServiceServer(scope, action_type.send_goal, names.send_goal, self._on_send_goal, SERVICES_DEFAULT),
            ServiceServer(scope, action_type.cancel, names.cancel_goal, self._on_cancel_goal, SERVICES_DEFAULT),
            ServiceServer(scope, action_type.get_result, names.get_result, self._on_get_result, SERVICES_DEFAULT),
        ]

    # ------------------------------------------------------------------------------------------------ stream style

    def __aiter__(self) -> Stream[GoalRequest[GoalT, ResultT, FeedbackT]]:
        if self._execute is not None or self._accept is not None:
            raise TypeError(f"action {self.name} has callbacks; its goals cannot be iterated over too")
        return self._requests

    def cancel_requests(self) -> Stream[CancelRequest[GoalT, ResultT, FeedbackT]]:
        """Decide about cancels yourself: from now on each one waits until it is accepted or rejected."""
        return self._desk.stream()

    @property
    def goals(self) -> list[ServerGoal[GoalT, ResultT, FeedbackT]]:
        """The goals that have not ended, in the order of acceptance."""
        return list(self._goals.values())

    # -------------------------------------------------------------------------------------------------- send_goal

    async def _on_send_goal(self, request: Any) -> Any:
        response = self._type.cls.SendGoal.Response()
        goal_id = goal_id_of(request)
        self._expire()
        if goal_id in self._book or goal_id in self._unanswered:
            return response
        if self._policy == "reject" and (self._goals or self._unanswered):
            return response
        goal: ServerGoal[GoalT, ResultT, FeedbackT] = ServerGoal(self, goal_id, self._type.goal.to_value(request.goal))
        answer: asyncio.Future[GoalInfo | None] = self._future()
        self._unanswered[goal_id] = (goal, answer)
        try:
            info = await self._ask(goal, answer)
        finally:
            del self._unanswered[goal_id]
        if info is not None:
            response.accepted = True
            set_stamp(response, info.stamp_ns)
        return response

    async def _ask(
        self, goal: ServerGoal[GoalT, ResultT, FeedbackT], answer: asyncio.Future[GoalInfo | None]
    ) -> GoalInfo | None:
        if self._execute is None and self._accept is None:
            self._requests.push(GoalRequest(self, goal))
            return await answer
        decision: Any = GoalDecision.ACCEPT
        if self._accept is not None:
            try:
                decision = await result_of(self._accept, goal.request)
            except Exception:
                self._scope.report_failure(f"the accept callback of action {self.name}")
                decision = GoalDecision.REJECT
        if self._closed or decision is False or decision is GoalDecision.REJECT:
            return None
        self.admit(goal.goal_id, start=decision is not GoalDecision.DEFER)
        return answer.result()

    def admit(self, goal_id: bytes, *, start: bool) -> None:
        """See `GoalServer`."""
        goal, answer = self._take_unanswered(goal_id)
        info = self._book.accept(goal_id, self._clock.now_ns())
        assert info is not None, "a known id was refused before"
        answer.set_result(info)
        self._rows.add(goal_id, info.stamp_ns, GoalStatus.ACCEPTED)
        others = [other for other in self._goals if other not in self._line]
        self._goals[goal_id] = goal
        if start and self._policy in ("queue", "preempt") and (others or self._line):
            self._stand_in_line(goal_id, others)
        elif start:
            self.start(goal_id)
        else:
            self._publish_status()

    def refuse(self, goal_id: bytes) -> None:
        """See `GoalServer`."""
        self._take_unanswered(goal_id)[1].set_result(None)

    def _take_unanswered(self, goal_id: bytes) -> _Unanswered[GoalT, ResultT, FeedbackT]:
        found = self._unanswered.get(goal_id)
        if found is None or found[1].done():
            raise GoalAlreadyAnsweredError(f"goal {goal_id.hex()} was answered already, or its server is closed")
        return found

    def _stand_in_line(self, goal_id: bytes, running: list[bytes]) -> None:
        if self._policy == "preempt":
            for waiting in list(self._line):
                self._cancel_unstarted(waiting)
            for other in running:
                if self._book.status(other).is_cancelable:
                    self._mark_canceling(other)
        self._line.append(goal_id)
        self._publish_status()

    # --------------------------------------------------------------------------------------------------- execution

    def start(self, goal_id: bytes) -> None:
        """See `GoalServer`."""
        goal = self._goals.get(goal_id)
        status = self._book.status(goal_id)
        if goal is None or goal_id in self._started:
            return
        self._started.add(goal_id)
        if goal_id in self._line:
            self._line.remove(goal_id)
        if status is GoalStatus.ACCEPTED:
            self._change(goal_id, GoalEvent.EXECUTE)
        if self._execute is not None:
            task = self._scope.start(self._run(self._execute, goal))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _run(
        self,
        execute: Callable[[ServerGoal[GoalT, ResultT, FeedbackT]], Any],
        goal: ServerGoal[GoalT, ResultT, FeedbackT],
    ) -> None:
        try:
            outcome = await execute(goal) if is_async(execute) else await asyncio.to_thread(execute, goal)
            if goal.is_active and outcome is not None and not isinstance(outcome, Finished):
                self.finish(goal.goal_id, GoalEvent.SUCCEED, outcome)
        except Exception:
            self._scope.report_failure(f"the handler of action {self.name}")
        else:
            if goal.is_active:
                self._scope.logger.warning(
                    f"the handler of action {self.name} returned without ending goal {goal.goal_id.hex()}; aborting it"
                )
        if goal.is_active and not self._closed:
            self.finish(goal.goal_id, GoalEvent.ABORT, None)

    def finish(self, goal_id: bytes, event: GoalEvent, result: object | None) -> None:
        """See `GoalServer`."""
        self._scope.require_open(self._closed, f"action server {self.name}")
        message = self._type.default_result() if result is None else self._type.result.to_message(result)
        message._encode()  # A result that cannot be sent must fail here, where its author sees it.
        waiting = self._book.finish(goal_id, event, message, self._clock.now_ns())
        status = self._book.status(goal_id)
        self._rows.set_status(goal_id, status)
        self._goals.pop(goal_id, None)
        self._started.discard(goal_id)
        for answer in waiting:
            if not answer.done():
                answer.set_result((status, message))
        self._desk.goal_ended(goal_id)
        self._publish_status()
        self._start_next()
        self._expire()

    def _start_next(self) -> None:
        if self._line and all(goal_id in self._line for goal_id in self._goals):
            self.start(self._line[0])

    def publish_feedback(self, goal_id: bytes, feedback: object) -> None:
        """See `GoalServer`."""
        message = self._type.cls.FeedbackMessage()
        message.goal_id.uuid = goal_id
        message.feedback = self._type.feedback.to_message(feedback)
        self._feedback.publish(message)

    def status_of(self, goal_id: bytes) -> GoalStatus:
        """See `GoalServer`."""
        return self._book.status(goal_id)

    def on_loop(self, function: Callable[[], T]) -> T:
        """See `GoalServer`."""
        return on_loop(self._scope.bridge, function)

    # ------------------------------------------------------------------------------------------------------ cancel

    async def _on_cancel_goal(self, request: CancelGoal_Request) -> CancelGoal_Response:
        self._expire()
        selection = self._book.select_for_cancel(goal_id_of(request.goal_info), stamp_ns_of(request.goal_info))
        answers = await asyncio.gather(*(self._may_cancel(info.goal_id) for info in selection.goals))
        agreed = [info for info, yes in zip(selection.goals, answers, strict=True) if yes]
        canceled = tuple(info for info in agreed if self._book.status(info.goal_id).is_cancelable)
        if agreed and not canceled:
            # They ended while somebody decided.
            selection = CancelSelection(CancelCode.GOAL_TERMINATED)
        response = CancelGoal_Response(return_code=int(cancel_answer(selection, canceled)))
        for info in canceled:
            found = GoalInfoMessage()
            found.goal_id.uuid = info.goal_id  # type: ignore[assignment]
            set_stamp(found, info.stamp_ns)
            response.goals_canceling.append(found)
            if info.goal_id in self._line:
                self._cancel_unstarted(info.goal_id)
            else:
                self._mark_canceling(info.goal_id)
        return response

    async def _may_cancel(self, goal_id: bytes) -> bool:
        goal = self._goals.get(goal_id)
        if goal is None:
            return True  # It has just ended; the caller will see that.
        return await self._desk.decide(goal, started=goal_id in self._started)

    def _mark_canceling(self, goal_id: bytes) -> None:
        self._change(goal_id, GoalEvent.CANCEL_GOAL)
        self._goals[goal_id].request_cancel()

    def _cancel_unstarted(self, goal_id: bytes) -> None:
        self._line.remove(goal_id)
        self._mark_canceling(goal_id)
        self.finish(goal_id, GoalEvent.CANCELED, None)

    # ------------------------------------------------------------------------------------------------------ result

    async def _on_get_result(self, request: Any) -> Any:
        self._expire()
        waiting: asyncio.Future[tuple[GoalStatus, Message]] = self._future()
        answer, status, result = self._book.request_result(goal_id_of(request), waiting)
        if answer is ResultAnswer.WAIT:
            try:
                status, result = await waiting
            finally:
                self._book.forget_waiting(waiting)
        response = self._type.cls.GetResult.Response()
        response.status = int(status)
        if result is not None:
            response.result = result
        return response

    def _future(self) -> asyncio.Future[Any]:
        """One that `close` cancels, and with it the service handler that waits for it."""
        future: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._waiting.add(future)
        future.add_done_callback(self._waiting.discard)
        return future

    # ------------------------------------------------------------------------------------------------------ status

    def _change(self, goal_id: bytes, event: GoalEvent) -> None:
        self._rows.set_status(goal_id, self._book.apply(goal_id, event))
        self._publish_status()

    def _publish_status(self) -> None:
        if not self._closed:
            self._status.publish_raw(self._rows.message())

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
        """Stop serving; handlers are cancelled, iterators end. May be called twice."""
        if self._closed:
            return
        self._closed = True
        self._scope.disown(self)
        if self._jumps is not None:
            self._jumps.close()
        if self._expiry is not None:
            self._expiry.cancel()
        for pending in (*self._waiting, *self._tasks):
            if not pending.get_loop().is_closed():
                pending.cancel()
        self._requests.close()
        self._desk.close()
        for service in self._services:
            service.close()
        self._feedback.close()
        self._status.close()
