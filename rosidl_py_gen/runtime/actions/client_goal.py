"""One goal as the action client that sent it sees it, and what can go wrong with it.

Decides that a status never goes back, and that a goal which cannot get a result any more ends with an error for all who
wait: for its result and its feedback.
"""

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
"""The status of each number."""


class GoalRejectedError(ActionError):
    """The server does not want this goal."""


class ActionTimeoutError(ActionError, TimeoutError):
    """The server did not answer in time; the goal may go on."""


class ActionServerLostError(ActionError):
    """The server went away before it answered, or before the result was in."""


class CancelError(ActionError):
    """A cancel request was not granted."""


class CancelRejectedError(CancelError):
    """The server refused to cancel."""


class AlreadyTerminatedError(CancelError):
    """The goal has ended, or is being cancelled already."""


class GoalProgress:
    """What an action client has heard of one goal; all on the loop's thread."""

    def __init__(self, goal_id: bytes, feedback_depth: int) -> None:
        self.goal_id = goal_id
        self.status = GoalStatus.UNKNOWN
        self.accepted_stamp: Time | None = None
        self.accepted_s: float | None = None
        self.feedback: AsyncQueue[Any] = AsyncQueue(feedback_depth)
        self.outcome: tuple[GoalStatus, Any] | None = None
        self.error: BaseException | None = None
        self.waiters = Waiters()

    @property
    def is_done(self) -> bool:
        """Whether the result is in, or will never be."""
        return self.outcome is not None or self.error is not None

    def on_accepted(self, stamp: Time | None, now_s: float) -> None:
        """Record the acceptance, at `stamp` by the server's clock and at `now_s` by the event loop's."""
        self.accepted_stamp, self.accepted_s = stamp, now_s
        if self.status is GoalStatus.UNKNOWN:
            self.status = GoalStatus.ACCEPTED

    def on_status(self, number: int) -> None:
        """The status topic mentions the goal. Never goes back: the topic may lag behind the answers."""
        status = STATUSES.get(number)
        if status is not None and status > self.status:
            self.status = status

    def on_result(self, status: GoalStatus, result: object) -> None:
        """The result is in."""
        if not self.is_done:
            self.status, self.outcome = status, (status, result)
            self.feedback.close()
            self.waiters.wake()

    def on_error(self, error: BaseException) -> None:
        """There will be no result."""
        if not self.is_done:
            self.error = error
            self.feedback.close(error)
            self.waiters.wake()


class ClientGoal(Generic[ActionT_co]):
    """A goal that was accepted; made by `ActionClient.send_goal`. `ClientGoal[Fibonacci]` to a type checker."""

    def __init__(
        self,
        progress: GoalProgress,
        goal: object,
        cancel: Callable[[bytes, float | None], Coroutine[Any, Any, None]],
        run_sync: Callable[[Coroutine[Any, Any, Any]], Any],
    ) -> None:
        self._cancel = cancel
        self._run_sync = run_sync
        self._goal: Any = goal
        self._progress = progress
        self.goal_id = progress.goal_id
        """16 bytes."""

    @property
    def goal(self: ClientGoal[Action[GoalT, Any, Any]]) -> GoalT:
        """What was asked for."""
        goal: GoalT = self._goal
        return goal

    @property
    def status(self) -> GoalStatus:
        """The newest status that was heard of."""
        return self._progress.status

    @property
    def accepted_stamp(self) -> Time | None:
        """When the server accepted it, by the server's clock; None where the server sent a negative time."""
        return self._progress.accepted_stamp

    @property
    def is_done(self) -> bool:
        """True once `result` returns or raises at once."""
        return self._progress.is_done

    @property
    def feedback_dropped(self) -> int:
        """How many feedback messages were lost because nobody took them in time: the oldest ones."""
        return self._progress.feedback.dropped

    def feedback(self: ClientGoal[Action[Any, Any, FeedbackT]]) -> AsyncQueue[FeedbackT]:
        """Iterate over the feedback, from the first one on; ends when the result is in.

        Ends with an error when there will be no result: `ActionServerLostError`, `ClosedError`.
        """
        return self._progress.feedback

    async def result(
        self: ClientGoal[Action[Any, ResultT, Any]], timeout_s: float | None = None
    ) -> tuple[GoalStatus, ResultT]:
        """Wait for the end of the goal; may be called any number of times, from any number of tasks.

        Raises:
            ActionTimeoutError: not ended in `timeout_s` seconds; the goal goes on. TypeError, ValueError: no seconds.
            ActionServerLostError: the server went away. UnknownGoalError: it came back without knowing the goal.
            ActionError: the server sent a result with a status that does not end a goal, or that is not known.
            ClosedError: the client was closed.
        """
        progress = self._progress
        if not await progress.waiters.wait(lambda: progress.is_done, Deadline(timeout_s).remaining_s()):
            raise ActionTimeoutError(
                f"no result of goal {self.goal_id.hex()} in {timeout_s} s; it is {progress.status.name}"
            )
        if progress.error is not None:
            raise progress.error
        assert progress.outcome is not None
        return progress.outcome

    async def cancel(self, timeout_s: float | None = None) -> None:
        """Ask the server to cancel; returns when it agreed. The goal ends some time later, see `result`.

        Raises:
            CancelRejectedError, AlreadyTerminatedError, UnknownGoalError: the server's answer.
            ActionTimeoutError: no answer in `timeout_s` seconds. ActionServerLostError: the server went away.
            ClosedError: the client is closed.
        """
        await self._cancel(self.goal_id, timeout_s)

    def result_sync(
        self: ClientGoal[Action[Any, ResultT, Any]], timeout_s: float | None = None
    ) -> tuple[GoalStatus, ResultT]:
        """`result` for plain code; see `ActionClient.send_goal_sync`."""
        ended: tuple[GoalStatus, ResultT] = self._run_sync(self.result(timeout_s))
        return ended

    def cancel_sync(self, timeout_s: float | None = None) -> None:
        """`cancel` for plain code; see `ActionClient.send_goal_sync`."""
        self._run_sync(self.cancel(timeout_s))

    def __repr__(self) -> str:
        return f"ClientGoal({self.goal_id.hex()}, {self.status.name})"
