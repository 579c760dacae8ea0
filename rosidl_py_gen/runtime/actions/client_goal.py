"""Goal of an action client, and the errors of action clients."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Generic

from rosidl_py_gen.base.waiters import Waiters
from rosidl_py_gen.runtime.actions.states import ActionError, GoalStatus
from rosidl_py_gen.runtime.actions.types import ActionT_co
from rosidl_py_gen.runtime.loop.async_queue import AsyncQueue
from rosidl_py_gen.runtime.time.deadline import Deadline

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.types import FeedbackT, GoalT, ResultT
    from rosidl_py_gen.runtime.time.values import Time

STATUSES = {int(status): status for status in GoalStatus}
"""`GoalStatus` for each number."""


class GoalRejectedError(ActionError):
    """Raised if the server rejects a goal."""


class ActionTimeoutError(ActionError, TimeoutError):
    """Raised if the server does not reply in time; the goal may continue."""


class ActionServerLostError(ActionError):
    """Raised if the server disappears before it replies, or before it sends the result."""


class CancelError(ActionError):
    """Raised if a cancel request fails."""


class CancelRejectedError(CancelError):
    """Raised if the server refuses to cancel."""


class AlreadyTerminatedError(CancelError):
    """Raised if the goal has ended, or is being cancelled already."""


class ClientGoal(Generic[ActionT_co]):
    """Accepted goal, from `ActionClient.send_goal`. Type checkers see `ClientGoal[Fibonacci]`."""

    def __init__(
        self,
        goal_id: bytes,
        goal: object,
        feedback_depth: int,
        cancel: Callable[[bytes, float | None], Coroutine[Any, Any, None]],
        run_sync: Callable[[Coroutine[Any, Any, Any]], Any],
    ) -> None:
        self.goal_id = goal_id
        """16 bytes."""
        self._goal: Any = goal
        self._cancel = cancel
        self._run_sync = run_sync
        self._status = GoalStatus.UNKNOWN
        self._accepted_stamp: Time | None = None
        self._accepted_s: float | None = None
        """Time of acceptance by the event loop's clock."""
        self._feedback: AsyncQueue[Any] = AsyncQueue(feedback_depth)
        self._outcome: tuple[GoalStatus, Any] | None = None
        self._error: BaseException | None = None
        self._waiters = Waiters()

    def _on_accepted(self, stamp: Time | None, now_s: float) -> None:
        self._accepted_stamp, self._accepted_s = stamp, now_s
        if self._status is GoalStatus.UNKNOWN:
            self._status = GoalStatus.ACCEPTED

    def _on_status(self, number: int) -> None:
        """Record a status of the status topic. It may lag behind the replies, so the status never goes back."""
        status = STATUSES.get(number)
        if status is not None and status > self._status:
            self._status = status

    def _on_result(self, status: GoalStatus, result: object) -> None:
        if not self.is_done:
            self._status, self._outcome = status, (status, result)
            self._feedback.close()
            self._waiters.wake()

    def _on_error(self, error: BaseException) -> None:
        """Record that no result will arrive: waiters for the result or feedback get the error."""
        if not self.is_done:
            self._error = error
            self._feedback.close(error)
            self._waiters.wake()

    @property
    def goal(self: ClientGoal[Action[GoalT, Any, Any]]) -> GoalT:
        """Goal message that was sent."""
        goal: GoalT = self._goal
        return goal

    @property
    def status(self) -> GoalStatus:
        """Newest status that was received."""
        return self._status

    @property
    def accepted_stamp(self) -> Time | None:
        """Time of acceptance by the server's clock; None if the server sent a negative time."""
        return self._accepted_stamp

    @property
    def is_done(self) -> bool:
        """True once `result` returns or raises without waiting."""
        return self._outcome is not None or self._error is not None

    @property
    def feedback_dropped(self) -> int:
        """Number of feedback messages that were dropped, oldest first, because the queue was full."""
        return self._feedback.dropped

    def feedback(self: ClientGoal[Action[Any, Any, FeedbackT]]) -> AsyncQueue[FeedbackT]:
        """Return the queue of all feedback; the iteration ends when the result arrives.

        The iteration raises `ActionServerLostError` or `ClosedError` if no result will arrive.
        """
        return self._feedback

    async def result(
        self: ClientGoal[Action[Any, ResultT, Any]], timeout_s: float | None = None
    ) -> tuple[GoalStatus, ResultT]:
        """Wait for the end of the goal; may be called repeatedly, and by several tasks.

        Raises:
            ActionTimeoutError: the goal has not ended within `timeout_s`; it continues.
            TypeError, ValueError: `timeout_s` is not a number of seconds.
            ActionServerLostError: the server disappeared.
            UnknownGoalError: the server was restarted and does not know the goal.
            ActionError: the server sent a result with a status that does not end a goal.
            ClosedError: the client was closed.
        """
        if not await self._waiters.wait(lambda: self.is_done, Deadline(timeout_s).remaining_s()):
            raise ActionTimeoutError(
                f"no result of goal {self.goal_id.hex()} in {timeout_s} s; it is {self.status.name}"
            )
        if self._error is not None:
            raise self._error
        assert self._outcome is not None
        return self._outcome

    async def cancel(self, timeout_s: float | None = None) -> None:
        """Request to cancel the goal, and wait for the server's consent. The goal ends later, see `result`.

        Raises:
            CancelRejectedError, AlreadyTerminatedError, UnknownGoalError: the server refused.
            ActionTimeoutError: no reply arrived within `timeout_s`.
            ActionServerLostError: the server disappeared.
            ClosedError: the client is closed.
        """
        await self._cancel(self.goal_id, timeout_s)

    def result_sync(
        self: ClientGoal[Action[Any, ResultT, Any]], timeout_s: float | None = None
    ) -> tuple[GoalStatus, ResultT]:
        """Return `result()` in plain code; see `ActionClient.send_goal_sync`."""
        result: tuple[GoalStatus, ResultT] = self._run_sync(self.result(timeout_s))
        return result

    def cancel_sync(self, timeout_s: float | None = None) -> None:
        """Call `cancel()` in plain code; see `ActionClient.send_goal_sync`."""
        self._run_sync(self.cancel(timeout_s))

    def __repr__(self) -> str:
        return f"ClientGoal({self.goal_id.hex()}, {self.status.name})"
