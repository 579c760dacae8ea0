"""The goals of an action server: what a handler may do with one, and when each starts, ends and is forgotten.

Which state may follow which is `states.py`'s; here every change of state goes to the status topic. A result is encoded
when its goal ends, once, and kept as bytes. Every method of `ServerGoal` may be called from any thread, except the
coroutines: a plain `execute` function runs in a thread of its own.

A handler may end its goal first and return the result then, as those written for rclpy do. So a goal that its own
handler ends without a result has its new status at once, and its result when the handler returns.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import current_loop, set_result_if_pending
from rosidl_py_gen.runtime.actions.goal_record import GoalRecord
from rosidl_py_gen.runtime.actions.states import (
    TERMINAL_STATUS_OF,
    GoalDecision,
    GoalEvent,
    GoalInfo,
    GoalStatus,
    GoalTable,
)
from rosidl_py_gen.runtime.actions.status import StatusTopic
from rosidl_py_gen.runtime.actions.types import ActionT_co, set_goal_id
from rosidl_py_gen.runtime.entities.publisher import Publisher
from rosidl_py_gen.runtime.time.values import Duration, Time, timeout_to_ns
from rosidl_py_gen.runtime.transport.qos import DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.argument_checks import Policy
    from rosidl_py_gen.runtime.actions.states import CancelCode, CancelSelection
    from rosidl_py_gen.runtime.actions.types import ActionNames, ActionType, FeedbackT, GoalT, ResultT
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.time.clock import Clock

T = TypeVar("T")


class GoalResult:
    """What `succeed`, `abort` and `canceled` return, so that a handler can say ``return goal.canceled(...)``."""

    __slots__ = ()


FINISHED = GoalResult()


def current_task_or_thread() -> object:
    """Who calls: a task of this thread's loop, or else the thread."""
    return threading.get_ident() if current_loop() is None else asyncio.current_task()


class ServerGoal(Generic[ActionT_co]):
    """A goal that was accepted; `ServerGoal[Fibonacci]` to a type checker."""

    def __init__(self, goals: ServerGoals, goal_id: bytes, request: object) -> None:
        self._goals = goals
        self._request: Any = request
        self._record = GoalRecord()
        self.goal_id = goal_id
        """16 bytes."""

    @property
    def request(self: ServerGoal[Action[GoalT, Any, Any]]) -> GoalT:
        """What the client asked for."""
        goal: GoalT = self._request
        return goal

    @property
    def status(self) -> GoalStatus:
        """Where the goal is now; UNKNOWN once its result has expired."""
        return self._goals.book.status(self.goal_id)

    @property
    def accepted_stamp(self) -> Time:
        """When it was accepted, by the server's clock; also once its result has expired."""
        stamp = self._record.accepted_stamp
        assert stamp is not None, "nobody gets a goal before it is accepted"
        return stamp

    @property
    def is_active(self) -> bool:
        """False once it has ended."""
        return self.status.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """True once a cancel request was accepted: finish soon, with `canceled`, or otherwise.

        Also true when the server closes; then nothing can be told to the client any more, and it is time to return.
        """
        return self._record.cancel_requested

    async def wait_for_cancel(self) -> None:
        """Return when `is_cancel_requested` becomes true."""
        await self._record.changed.wait(lambda: self._record.cancel_requested)

    async def started(self) -> bool:
        """Wait until a goal that waits its turn, or was deferred, is EXECUTING.

        Returns:
            False when it will never be: it was cancelled before, and has ended, or the server was closed.
        """
        record = self._record
        await record.changed.wait(lambda: record.has_started or record.result is not None)
        return record.has_started

    def publish_feedback(self: ServerGoal[Action[Any, Any, FeedbackT]], feedback: FeedbackT) -> None:
        """Tell the client how it goes; from any thread.

        Raises:
            EncodeError, TypeError: `feedback` does not fit. ClosedError: the server is closed.
        """
        self._goals.publish_feedback(self.goal_id, feedback)

    def execute(self) -> None:
        """Start a deferred goal; with the policies ``"queue"`` and ``"preempt"`` it may have to wait its turn.

        Without effect when it has started or ended: a deferred goal that is cancelled ends as CANCELED by itself.
        """
        self._goals.on_loop(lambda: self._goals.start_deferred(self))

    def succeed(self: ServerGoal[Action[Any, ResultT, Any]], result: ResultT | None = None) -> GoalResult:
        """End the goal as SUCCEEDED. The result is sent as it is now: later changes have no effect.

        Without one, the handler's own call leaves that to what the handler returns; any other call sends a default
        result.

        Raises:
            GoalTransitionError: it has ended already, or has not been started (see `started`).
            EncodeError, TypeError: the result does not fit; the goal goes on. ClosedError: the server is closed.
        """
        return self._finish(GoalEvent.SUCCEED, result)

    def abort(self: ServerGoal[Action[Any, ResultT, Any]], result: ResultT | None = None) -> GoalResult:
        """End the goal as ABORTED; errors as `succeed`."""
        return self._finish(GoalEvent.ABORT, result)

    def canceled(self: ServerGoal[Action[Any, ResultT, Any]], result: ResultT | None = None) -> GoalResult:
        """End the goal as CANCELED.

        Raises:
            GoalTransitionError: nobody asked for a cancel (see `is_cancel_requested`), or it has ended already.
        """
        return self._finish(GoalEvent.CANCELED, result)

    def _finish(self, event: GoalEvent, result: object | None) -> GoalResult:
        handler = self._record.handler
        awaits_return = result is None and handler is not None and handler == current_task_or_thread()
        self._goals.on_loop(lambda: self._goals.finish(self.goal_id, event, result, awaits_return=awaits_return))
        return FINISHED

    def __repr__(self) -> str:
        return f"ServerGoal({self.goal_id.hex()}, {self.status.name})"


class ServerGoals:
    """The accepted goals of one action server, with the topics that tell of them. All on the loop's thread.

    Args:
        run: called with each goal when it starts.
    """

    def __init__(
        self,
        scope: EntityScope,
        clock: Clock,
        action_type: ActionType,
        names: ActionNames,
        run: Callable[[ServerGoal[Any]], None],
        *,
        result_timeout_s: float,
        policy: Policy,
    ) -> None:
        self._scope = scope
        self._clock = clock
        self._type = action_type
        self._name = names.action
        self._run = run
        self._policy = policy
        self.book: GoalTable[bytes] = GoalTable(timeout_to_ns("result_timeout_s", result_timeout_s))
        self.active: dict[bytes, ServerGoal[Any]] = {}
        """Goals that have not ended, in the order of acceptance."""
        self.returning: dict[bytes, tuple[ServerGoal[Any], GoalEvent]] = {}
        """Goals that have ended, but for the result that their handlers are to return."""
        self._running: set[bytes] = set()
        self._queue: deque[ServerGoal[Any]] = deque()
        self._expiry: asyncio.TimerHandle | None = None
        self.feedback: Publisher[Any] = Publisher(scope, action_type.feedback_message, names.feedback, DEFAULT)
        self._status = StatusTopic(scope, action_type.status, names.status)
        scope.register(self)
        jumped = clock.create_jump_callback(
            post=lambda jump: self.expire(), on_clock_change=True, min_forward=Duration(nanoseconds=1)
        )
        scope.register(jumped)

    def on_loop(self, function: Callable[[], T]) -> T:
        """Run `function` on the loop's thread; to other threads it returns when the status is published."""
        if self._scope.bridge.in_loop_thread():
            return function()

        def call() -> T:
            try:
                return function()
            finally:
                self._status.flush()

        return self._scope.bridge.run_on_loop(call)

    # -------------------------------------------------------------------------------------------- start and end

    def accept_goal(self, goal: ServerGoal[Any], decision: GoalDecision) -> GoalInfo | None:
        """Do with a new goal what was decided; None when it is rejected, by the policy or a closed server too."""
        if decision is GoalDecision.REJECT or self._scope.closed or (self._policy == "reject" and self.active):
            return None
        info = self.book.accept(goal.goal_id, self._clock.now_ns())
        assert info is not None, "a known id was refused before"
        goal._record.accepted_stamp = Time(nanoseconds=info.stamp_ns, clock_type=self._clock.clock_type)
        self._status.rows.add(goal.goal_id, info.stamp_ns, GoalStatus.ACCEPTED)
        self.active[goal.goal_id] = goal
        if decision is GoalDecision.ACCEPT:
            self._start_in_turn(goal)
        else:
            self._status.publish()
        return info

    def reject_garbage_collected(self, answer: asyncio.Future[GoalInfo | None]) -> None:
        """The program let go of a request without an answer; called wherever the garbage collector runs."""

        def reject() -> None:
            if not answer.done():
                self._scope.logger.warning(
                    f"a goal request of action {self._name} was neither accepted nor rejected; it is rejected"
                )
                set_result_if_pending(answer, None)

        self._scope.bridge.call_soon(reject)

    def start_deferred(self, goal: ServerGoal[Any]) -> None:
        """Start it in its turn; without effect when it has one already."""
        if goal.goal_id in self.active and not goal._record.has_started and goal not in self._queue:
            self._start_in_turn(goal)

    def _start_in_turn(self, goal: ServerGoal[Any]) -> None:
        if not self._running or self._policy not in ("queue", "preempt"):
            self._start(goal)
            return
        if self._policy == "preempt":
            for waiting in list(self._queue):
                self._cancel(waiting)
            for running in self._running:
                if self.book.status(running).is_cancelable:
                    self._cancel(self.active[running])
        self._queue.append(goal)
        self._status.publish()

    def _start(self, goal: ServerGoal[Any]) -> None:
        self._running.add(goal.goal_id)
        self._change(goal.goal_id, GoalEvent.EXECUTE)
        goal._record.start()
        self._run(goal)

    def finish(self, goal_id: bytes, event: GoalEvent, result: object | None, *, awaits_return: bool = False) -> None:
        """End a goal; None stands for a default result. One that cannot be sent fails here, where its author sees it.

        With `awaits_return` the result is what `complete` is called with.

        Raises:
            GoalTransitionError, UnknownGoalError, EncodeError, TypeError, ClosedError: as their names say.
        """
        self._scope.require_open(False, f"action server {self._name}")
        data = self._type.encode_result(TERMINAL_STATUS_OF[event], result)
        self.book.finish(goal_id, event, data, self._clock.now_ns())
        self._status.rows.set_status(goal_id, TERMINAL_STATUS_OF[event])
        self._running.discard(goal_id)
        goal = self.active.pop(goal_id)
        if awaits_return:
            self.returning[goal_id] = (goal, event)
            goal._record.refuse_cancels()
        else:
            goal._record.end(data)
        self._status.publish()
        if self._queue and not self._running:
            self._start(self._queue.popleft())
        self.expire()

    def complete(self, goal: ServerGoal[Any], result: object | None, *, failed: bool = False) -> bool:
        """The handler of a goal that has ended returned this; False when another result was sent before.

        When it `failed` instead, no result comes any more, and the end that it told of was wrong: ABORTED.
        """
        _, event = self.returning.get(goal.goal_id, (goal, None))
        if event is None:
            status = self.book.status(goal.goal_id)
            sent = self.book.result(goal.goal_id)
            return result is None or sent is None or sent == self._type.encode_result(status, result)
        status = GoalStatus.ABORTED if failed else TERMINAL_STATUS_OF[event]
        data = self._type.encode_result(status, result)
        del self.returning[goal.goal_id]
        self.book.replace_result(goal.goal_id, data, status)
        goal._record.end(data)
        if failed:
            self._status.rows.set_status(goal.goal_id, status)
            self._status.publish()
        return True

    def publish_feedback(self, goal_id: bytes, feedback: object) -> None:
        """From any thread."""
        self._status.flush_if_in_loop()  # it became EXECUTING before
        message = self._type.cls.FeedbackMessage()
        set_goal_id(message, goal_id)
        message.feedback = self._type.feedback.to_message(feedback)
        self.feedback.publish(message)

    # ------------------------------------------------------------------------------------------------------ cancel

    def cancel(
        self, selection: CancelSelection, agreed: Collection[GoalInfo]
    ) -> tuple[CancelCode, tuple[GoalInfo, ...]]:
        """Cancel those of the selected goals that were agreed to; returns as `GoalTable.answer_cancel`."""
        code, canceled = self.book.answer_cancel(selection, agreed)
        for info in canceled:
            self._cancel(self.active[info.goal_id])
        return code, canceled

    def _cancel(self, goal: ServerGoal[Any]) -> None:
        """Let the handler of a goal end it; one that has not started ends here: nobody else would."""
        if goal in self._queue:
            self._queue.remove(goal)
        self._change(goal.goal_id, GoalEvent.CANCEL_GOAL)
        goal._record.request_cancel()
        if not goal._record.has_started:
            self.finish(goal.goal_id, GoalEvent.CANCELED, None)

    def _change(self, goal_id: bytes, event: GoalEvent) -> None:
        self._status.rows.set_status(goal_id, self.book.apply(goal_id, event))
        self._status.publish()

    # ------------------------------------------------------------------------------------------------------ expiry

    def expire(self) -> None:
        """Forget the goals whose results were kept long enough, and come back for the next one."""
        if self._scope.closed:
            return
        now_ns = self._clock.now_ns()
        self._status.rows.remove(self.book.expire(now_ns))
        # A timer that runs already is never too late: the next end to expire only moves away.
        if self._expiry is None and not self._clock.ros_time_is_active:
            due_ns, loop = self.book.next_expiry_ns(), self._scope.bridge.loop
            if due_ns is not None and loop is not None:
                left_s = max(0.001, (due_ns - now_ns) / NS_PER_S)
                self._expiry = loop.call_later(left_s, self._expire_later)

    def _expire_later(self) -> None:
        self._expiry = None
        self.expire()

    def close(self) -> None:
        """Ask all handlers to end. The services, which are newer, are closed by then: nobody is answered any more."""
        if self._expiry is not None:
            self._expiry.cancel()
        for goal in self.active.values():
            goal._record.request_cancel()
            goal._record.end(b"")
        for goal, _ in self.returning.values():
            goal._record.end(b"")
