"""Accepted goals of an action server: their start, end, cancellation and expiry.

`states.py` decides which transitions are possible; `ServerGoals` publishes each of them, in order. The status message
is sent after the service response, because the caller waits for the response, and writing either message takes equally
long. Execute functions and callbacks run after both. A result is encoded once, when its goal ends, and retained as
bytes.

An execute function may end its goal first and return the result afterwards, like execute functions written for rclpy.
So a goal that its own execute function ends without a result has its new status at once, and its result when the
function returns.
"""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import Waiters, complete_threadsafe, current_loop
from rosidl_py_gen.runtime.actions.states import (
    MIN_RESULT_RETENTION_NS,
    TERMINAL_STATUS_OF,
    GoalDecision,
    GoalEvent,
    GoalInfo,
    GoalStatus,
    GoalTable,
)
from rosidl_py_gen.runtime.actions.types import ActionT_co, set_goal_id
from rosidl_py_gen.runtime.entities.message_types import raw_type
from rosidl_py_gen.runtime.entities.topics import Publisher
from rosidl_py_gen.runtime.loop.queues import DeferredSender
from rosidl_py_gen.runtime.time_values import Duration, Time, timeout_to_ns
from rosidl_py_gen.runtime.transport.qos import ACTION_STATUS, DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.states import CancelCode, CancelSelection
    from rosidl_py_gen.runtime.actions.types import ActionNames, ActionType, FeedbackT, GoalT, Policy, ResultT
    from rosidl_py_gen.runtime.clocks import Clock
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope

T = TypeVar("T")


class GoalResult:
    """Return value of `ServerGoal.succeed`, `abort`, `canceled`: `execute` may ``return goal.canceled(...)``."""

    __slots__ = ()


FINISHED = GoalResult()


def current_task_or_thread() -> object:
    """Return the running asyncio task, or the id of the thread if the thread runs no event loop."""
    return threading.get_ident() if current_loop() is None else asyncio.current_task()


class GoalRecord:
    """Internal state of a `ServerGoal`. Its status is not included; it is stored in the server's `GoalTable`.

    Attributes:
        accepted_ns: time of acceptance by the server's clock; None until the goal is accepted.
        cancel_requested: a cancel request was accepted, or the server is closing.
        has_started: the goal has started to execute; stays true after its end.
        executed_by: `current_task_or_thread()` of the execute function while it runs.
        result: encoded get_result response once the goal has ended; empty if the server was closed before.
        cancel_replies: replies to cancel requests that wait for the program's decision.
        changed: tasks that wait for a change of another attribute.
    """

    def __init__(self) -> None:
        self.accepted_ns: int | None = None
        self.cancel_requested = False
        self.has_started = False
        self.executed_by: object = None
        self.result: bytes | None = None
        self.cancel_replies: set[asyncio.Future[bool]] = set()
        self.changed = Waiters()

    def request_cancel(self) -> None:
        """Record that a cancel request was accepted, after the status has changed, or that the server is closing."""
        self.cancel_requested = True
        self.changed.wake()

    def start(self) -> None:
        """Record that the goal has started to execute."""
        self.has_started = True
        self.changed.wake()

    def end(self, result: bytes) -> None:
        """Record the encoded get_result response when the goal has ended, or ``b""`` when the server closes."""
        self.result = result
        self.changed.wake()
        self.refuse_cancels()

    def refuse_cancels(self) -> None:
        """Refuse the cancel requests for the goal that the program has not decided yet."""
        for reply in tuple(self.cancel_replies):  # another thread may close while a cancel arrives
            complete_threadsafe(reply, False)

    async def wait_result(self) -> bytes:
        """Wait for the end of the goal, and return the encoded get_result response."""
        await self.changed.wait(lambda: self.result is not None)
        return self.result or b""


class ServerGoal(Generic[ActionT_co]):
    """Goal that an action server has accepted; type checkers see `ServerGoal[Fibonacci]`.

    Thread: any, except for the coroutines.
    """

    def __init__(self, goals: ServerGoals, goal_id: bytes, request: object) -> None:
        self._goals = goals
        self._request: Any = request
        self._record = GoalRecord()
        self.goal_id: bytes = goal_id
        """UUID of the goal, 16 bytes."""

    @property
    def request(self: ServerGoal[Action[GoalT, Any, Any]]) -> GoalT:
        """Goal message of the client."""
        goal: GoalT = self._request
        return goal

    @property
    def status(self) -> GoalStatus:
        """Current status; UNKNOWN once the result has expired."""
        return self._goals.table.status(self.goal_id)

    @property
    def accepted_stamp(self) -> Time:
        """Time of acceptance by the server's clock; available even after the result has expired."""
        accepted_ns = self._record.accepted_ns
        assert accepted_ns is not None, "callers get a goal only once it is accepted"
        return Time(nanoseconds=accepted_ns, clock_type=self._goals.clock_type)

    @property
    def is_active(self) -> bool:
        """True until the goal has ended."""
        return self.goal_id in self._goals.active

    @property
    def is_cancel_requested(self) -> bool:
        """True once a cancel request was accepted, or the server was closed: the execute function should end soon."""
        return self._record.cancel_requested

    async def wait_for_cancel(self) -> None:
        """Wait until a cancel request for the goal was accepted, or the server was closed.

        There is no blocking form: a plain execute function checks `is_cancel_requested` between two steps of its work.
        """
        await self._record.changed.wait(lambda: self._record.cancel_requested)

    async def started(self) -> bool:
        """Wait until a queued or deferred goal is EXECUTING, and return True.

        There is no blocking form, because goals start on the event loop; an execute function runs only after the start.

        Returns:
            False if the goal was cancelled before it started, or the server was closed.
        """
        record = self._record
        await record.changed.wait(lambda: record.has_started or record.result is not None)
        return record.has_started

    def publish_feedback(self: ServerGoal[Action[Any, Any, FeedbackT]], feedback: FeedbackT) -> None:
        """Send feedback to the client.

        Raises:
            EncodeError, TypeError: `feedback` does not fit its type.
            ClosedError: the server is closed.
        """
        self._goals.publish_feedback(self.goal_id, feedback)

    def execute(self) -> None:
        """Start a deferred goal, or queue it with the policies ``"queue"`` and ``"preempt"``.

        The method has no effect if the goal has started or ended. A deferred goal that is cancelled ends as CANCELED.
        """
        self._goals.on_loop(lambda: self._goals.start_deferred(self))

    def succeed(self: ServerGoal[Action[Any, ResultT, Any]], result: ResultT | None = None) -> GoalResult:
        """End the goal as SUCCEEDED. The result is encoded at once: later changes of the result have no effect.

        Args:
            result: result message. Without `result`, a call from the execute function sends the value that the function
                returns. Any other call sends a default result.

        Raises:
            GoalTransitionError: the goal has ended, or has not started (see `started`).
            EncodeError, TypeError: the result does not fit its type; the goal continues.
            ClosedError: the server is closed.
        """
        return self._finish(GoalEvent.SUCCEED, result)

    def abort(self: ServerGoal[Action[Any, ResultT, Any]], result: ResultT | None = None) -> GoalResult:
        """End the goal as ABORTED. The result is encoded at once: later changes of the result have no effect.

        Args:
            result: result message. Without `result`, a call from the execute function sends the value that the function
                returns. Any other call sends a default result.

        Raises:
            GoalTransitionError: the goal has ended, or has not started (see `started`).
            EncodeError, TypeError: the result does not fit its type; the goal continues.
            ClosedError: the server is closed.
        """
        return self._finish(GoalEvent.ABORT, result)

    def canceled(self: ServerGoal[Action[Any, ResultT, Any]], result: ResultT | None = None) -> GoalResult:
        """End the goal as CANCELED. The result is encoded at once: later changes of the result have no effect.

        Args:
            result: result message. Without `result`, a call from the execute function sends the value that the function
                returns. Any other call sends a default result.

        Raises:
            GoalTransitionError: no cancel was requested (see `is_cancel_requested`), or the goal has ended.
            EncodeError, TypeError: the result does not fit its type; the goal continues.
            ClosedError: the server is closed.
        """
        return self._finish(GoalEvent.CANCELED, result)

    def _finish(self, event: GoalEvent, result: object | None) -> GoalResult:
        executed_by = self._record.executed_by
        awaits_return = result is None and executed_by is not None and executed_by == current_task_or_thread()
        goals = self._goals
        goals.on_loop(partial(goals.finish, self.goal_id, event, result, awaits_return=awaits_return))
        return FINISHED

    def __repr__(self) -> str:
        return f"ServerGoal({self.goal_id.hex()}, {self.status.name})"


def record_of(goal: ServerGoal[Any]) -> GoalRecord:
    """Return the internal state of a goal, which programs do not see."""
    return goal._record


class ServerGoals:
    """Accepted goals of one action server, and its feedback and status topics. Thread: loop.

    Args:
        run: called with each goal when it starts.

    Attributes:
        table: status and result of each goal, until the result expires.
        active: goals that have not ended, in the order of acceptance.
        returning: goals that have ended, but whose execute functions have not returned the result yet.
        feedback: publisher of the feedback topic.
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
        self.clock_type = clock.clock_type
        self._type = action_type
        self._name = names.action
        self._run = run
        self._policy = policy
        timeout_ns = timeout_to_ns("result_timeout_s", result_timeout_s)
        self.table: GoalTable[bytes] = GoalTable(
            None if timeout_ns is None else max(timeout_ns, MIN_RESULT_RETENTION_NS)
        )
        self.active: dict[bytes, ServerGoal[Any]] = {}
        self.returning: dict[bytes, tuple[ServerGoal[Any], GoalEvent]] = {}
        self._running: set[bytes] = set()
        self._queue: deque[ServerGoal[Any]] = deque()
        self._expiry: asyncio.TimerHandle | None = None
        self.feedback: Publisher[Any] = Publisher(scope, action_type.feedback_message, names.feedback, DEFAULT)
        self._status: Publisher[bytes] = Publisher(scope, raw_type(action_type.status), names.status, ACTION_STATUS)
        self._status_sender = DeferredSender(scope.loop_binding, self._status._publish_without_waiting)
        scope.register(self._status_sender)
        scope.register(self)
        scope.register(
            clock.create_jump_callback(
                post=lambda jump: self.expire(), on_clock_change=True, min_forward=Duration(nanoseconds=1)
            )
        )

    def on_loop(self, function: Callable[[], T]) -> T:
        """Run `function` on the thread that runs the event loop, and return its result. Thread: any.

        In other threads the method returns only after a changed goal status is published.
        """
        if self._scope.loop_binding.in_loop_thread():
            return function()

        def call() -> T:
            try:
                return function()
            finally:
                self._status_sender.flush()

        return self._scope.loop_binding.run_on_loop(call)

    def _publish_statuses(self) -> None:
        self._status_sender.add(self.table.status_message())

    # ---------------------------------------------------------------------------------------------- start and end

    def accept_goal(self, goal: ServerGoal[Any], decision: GoalDecision) -> GoalInfo | None:
        """Apply the program's decision to a new goal.

        Returns:
            None if the goal is rejected, by the decision, the policy ``"reject"`` or a closed server.
        """
        if decision is GoalDecision.REJECT or self._scope.closed or (self._policy == "reject" and self.active):
            return None
        info = self.table.accept(goal.goal_id, self._clock.now_ns())
        assert info is not None, "the caller has rejected ids that are in use"
        goal._record.accepted_ns = info.stamp_ns
        self.active[goal.goal_id] = goal
        if decision is GoalDecision.ACCEPT:
            self._start_or_queue(goal)
        else:
            self._publish_statuses()
        return info

    def reject_garbage_collected(self, reply: asyncio.Future[GoalInfo | None]) -> None:
        """Reject a goal request that the program has dropped without a decision, which its garbage collection shows.

        Thread: any.
        """

        def reject() -> None:
            if not reply.done():
                self._scope.logger.warning(
                    f"goal request of action {self._name}: dropped without accept(), defer() or reject(); rejected"
                )
                complete_threadsafe(reply, None)

        self._scope.loop_binding.call_soon(reject)

    def start_deferred(self, goal: ServerGoal[Any]) -> None:
        """Start or queue a deferred goal; has no effect if the goal was started or queued before."""
        if goal.goal_id in self.active and not goal._record.has_started and goal not in self._queue:
            self._start_or_queue(goal)

    def _start_or_queue(self, goal: ServerGoal[Any]) -> None:
        if not self._running or self._policy not in ("queue", "preempt"):
            self._start(goal)
            return
        if self._policy == "preempt":
            for waiting in list(self._queue):
                self._cancel(waiting)
            for running in self._running:
                if self.table.status(running).is_cancelable:
                    self._cancel(self.active[running])
        self._queue.append(goal)
        self._publish_statuses()

    def _start(self, goal: ServerGoal[Any]) -> None:
        self._running.add(goal.goal_id)
        self._change(goal.goal_id, GoalEvent.EXECUTE)
        goal._record.start()
        self._run(goal)

    def finish(self, goal_id: bytes, event: GoalEvent, result: object | None, *, awaits_return: bool = False) -> None:
        """End a goal.

        Args:
            goal_id: id of the goal.
            event: event that ends a goal.
            result: result message; None is a default result.
            awaits_return: `complete` will set the result, because the execute function returns it later.

        Raises:
            GoalTransitionError, UnknownGoalError: the goal cannot end by the event, or its result has expired.
            EncodeError, TypeError: the result does not fit its type; the goal continues.
            ClosedError: the server is closed.
        """
        if self._scope.closed:
            self._scope.require_open(True, f"action server {self._name}")
        data = self._type.encode_result(TERMINAL_STATUS_OF[event], result)
        self.table.apply(goal_id, event)
        self._running.discard(goal_id)
        goal = self.active.pop(goal_id)
        if awaits_return:
            self.returning[goal_id] = (goal, event)
            goal._record.refuse_cancels()
        else:
            self.table.retain(goal_id, data, self._clock.now_ns())
            goal._record.end(data)
        self._publish_statuses()
        if self._queue and not self._running:
            self._start(self._queue.popleft())
        self.expire()

    def complete(self, goal: ServerGoal[Any], result: object | None, *, failed: bool = False) -> bool:
        """Set the result that the execute function has returned for a goal that had ended before.

        If the function `failed` instead, the status changes to ABORTED.

        Returns:
            False if the goal ended with another result, which has been sent.
        """
        _, event = self.returning.get(goal.goal_id, (goal, None))
        if event is None:
            sent = None if result is None else self.table.result(goal.goal_id)
            return sent is None or sent == self._type.encode_result(self.table.status(goal.goal_id), result)
        status = GoalStatus.ABORTED if failed else TERMINAL_STATUS_OF[event]
        data = self._type.encode_result(status, result)
        del self.returning[goal.goal_id]
        self.table.retain(goal.goal_id, data, self._clock.now_ns(), failed=failed)
        goal._record.end(data)
        if failed:
            self._publish_statuses()
        self.expire()
        return True

    def publish_feedback(self, goal_id: bytes, feedback: object) -> None:
        """Publish feedback of a goal. Thread: any."""
        if self._scope.loop_binding.in_loop_thread():
            self._status_sender.flush()  # EXECUTING must be published before
        message = self._type.cls.FeedbackMessage()
        set_goal_id(message, goal_id)
        message.feedback = self._type.feedback.to_message(feedback)
        self.feedback.publish(message)

    # ------------------------------------------------------------------------------------------------------ cancel

    def cancel(self, selection: CancelSelection, agreed: Collection[GoalInfo]) -> tuple[CancelCode, list[GoalInfo]]:
        """Cancel those selected goals whose cancellation the program has accepted.

        Args:
            selection: goals that the cancel request selects.
            agreed: goals whose cancellation the program has accepted.

        Returns:
            return code for the client, and the goals that are being cancelled.
        """
        canceled = [
            info for info in selection.goals if info in agreed and self.table.status(info.goal_id).is_cancelable
        ]
        for info in canceled:
            self._cancel(self.active[info.goal_id])
        return self.table.cancel_code(selection, any_canceled=bool(canceled)), canceled

    def _cancel(self, goal: ServerGoal[Any]) -> None:
        """Make a goal CANCELING and notify its execute function, which ends it; end a goal that has not started."""
        if goal in self._queue:
            self._queue.remove(goal)
        self._change(goal.goal_id, GoalEvent.CANCEL_GOAL)
        goal._record.request_cancel()
        if not goal._record.has_started:
            self.finish(goal.goal_id, GoalEvent.CANCELED, None)

    def _change(self, goal_id: bytes, event: GoalEvent) -> None:
        self.table.apply(goal_id, event)
        self._publish_statuses()

    # ------------------------------------------------------------------------------------------------------ expiry

    def expire(self) -> None:
        """Remove goals whose result timeout is over, and schedule the next removal."""
        if self._scope.closed:
            return
        now_ns = self._clock.now_ns()
        self.table.expire(now_ns)
        # A running timer is never too late, because the time of the next expiry only increases.
        if self._expiry is None and not self._clock.ros_time_is_active:
            due_ns, loop = self.table.next_expiry_ns(), self._scope.loop_binding.loop
            if due_ns is not None and loop is not None:
                delay_s = max(0.001, (due_ns - now_ns) / NS_PER_S)
                self._expiry = loop.call_later(delay_s, self._on_expiry_timer)

    def _on_expiry_timer(self) -> None:
        self._expiry = None
        self.expire()

    def close(self) -> None:
        """Request all execute functions to end.

        No reply is sent: entities close in the reverse order of their creation, so the services are closed already.
        """
        if self._expiry is not None:
            self._expiry.cancel()
        for goal in self.active.values():
            goal._record.request_cancel()
            goal._record.end(b"")
        for goal, _ in self.returning.values():
            goal._record.end(b"")
