"""One goal as the handler of an action server sees it.

Decides what a handler may do with it; the rules are `goal.py`'s, the server does what crosses the wire. Every method
of `ServerGoal` and `GoalRequest` may be called from any thread, except the coroutines: a plain `execute` function runs
in a thread of its own.
"""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from rosidl_py_gen.runtime.actions.states import GoalEvent, GoalStatus
from rosidl_py_gen.runtime.actions.types import ActionT_co
from rosidl_py_gen.runtime.endpoints.server import AlreadyRespondedError
from rosidl_py_gen.runtime.loop.latch import Latch

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.types import FeedbackT, GoalT, ResultT

T = TypeVar("T")


class GoalDecision(Enum):
    """What an `accept` callback may answer. None means ACCEPT; of anything else counts whether it is true."""

    ACCEPT = "accept and start"
    REJECT = "reject"
    DEFER = "accept; `goal.execute()` starts it later"


def decision_of(answer: object) -> GoalDecision:
    """What an `accept` callback meant."""
    if isinstance(answer, GoalDecision):
        return answer
    return GoalDecision.ACCEPT if agrees(answer) else GoalDecision.REJECT


def agrees(answer: object) -> bool:
    """Whether a callback that was asked for permission gave it: None does, as callbacks without return say it."""
    return answer is None or bool(answer)


class Finished:
    """What `succeed`, `abort` and `canceled` return, so that a handler can say ``return goal.canceled(...)``."""

    __slots__ = ()


FINISHED = Finished()


class GoalServer(Protocol):
    """What a goal needs of its server."""

    def finish(self, goal_id: bytes, event: GoalEvent, result: object | None) -> None:
        """End a goal; None stands for a default result. Raises `GoalTransitionError`, `UnknownGoalError`."""

    def start(self, goal_id: bytes) -> None:
        """Start a deferred goal, or let it stand in line."""

    def publish_feedback(self, goal_id: bytes, feedback: object) -> None:
        """Send feedback."""

    def status_of(self, goal_id: bytes) -> GoalStatus:
        """UNKNOWN when it is forgotten."""

    def admit(self, goal: ServerGoal[Any], *, start: bool) -> None:
        """Accept a goal that waits for an answer. Raises `AlreadyRespondedError`."""

    def refuse(self, goal: ServerGoal[Any]) -> None:
        """Reject a goal that waits for an answer. Raises `AlreadyRespondedError`."""

    def on_loop(self, function: Callable[[], T]) -> T:
        """Run `function` on the loop's thread and return what it returns."""


class ServerGoal(Generic[ActionT_co]):
    """A goal that was accepted; `ServerGoal[Fibonacci]` to a type checker."""

    def __init__(self, server: GoalServer, goal_id: bytes, request: object) -> None:
        self._server = server
        self._request: Any = request
        self._cancel = Latch()
        self._start_known = Latch()
        self.looked_for_cancel = False
        self.has_started = False
        """True since it began to execute, also after its end."""
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
        return self._server.status_of(self.goal_id)

    @property
    def is_active(self) -> bool:
        """False once it has ended."""
        return self.status.is_active

    @property
    def cancel_requested(self) -> bool:
        """True once a cancel request was accepted: finish soon, with `canceled`, or otherwise.

        Also true when the server closes; then nothing can be told to the client any more, and it is time to return.
        """
        self.looked_for_cancel = True
        return self._cancel.is_set

    async def wait_for_cancel(self) -> None:
        """Return when `cancel_requested` becomes true."""
        self.looked_for_cancel = True
        await self._cancel.wait()

    async def started(self) -> bool:
        """Wait until a goal that stands in line, or was deferred, is EXECUTING.

        Returns:
            False when it will never be: it was cancelled before, and has ended, or the server was closed.
        """
        await self._start_known.wait()
        return self.has_started

    def request_cancel(self) -> None:
        """Set `cancel_requested`; the server does this, after the status has changed, and when it closes."""
        self._cancel.set()

    def settle_start(self, *, started: bool) -> None:
        """Say that it starts now, or never will; the server does this."""
        self.has_started = self.has_started or started
        self._start_known.set()

    def publish_feedback(self: ServerGoal[Action[Any, Any, FeedbackT]], feedback: FeedbackT) -> None:
        """Tell the client how it goes; from any thread.

        Raises:
            EncodeError, TypeError: `feedback` does not fit. ClosedError: the server is closed.
        """
        self._server.publish_feedback(self.goal_id, feedback)

    def execute(self) -> None:
        """Start a deferred goal; with the policies ``"queue"`` and ``"preempt"`` it may have to stand in line first.

        Without effect when it has started or ended: a deferred goal that is cancelled ends as CANCELED by itself.
        """
        self._server.on_loop(lambda: self._server.start(self.goal_id))

    def succeed(self: ServerGoal[Action[Any, ResultT, Any]], result: ResultT | None = None) -> Finished:
        """End the goal as SUCCEEDED; None is a default result. It is sent as it is now: later changes have no effect.

        Raises:
            GoalTransitionError: it has ended already, or has not been started (see `started`).
            EncodeError, TypeError: the result does not fit; the goal goes on. ClosedError: the server is closed.
        """
        return self._finish(GoalEvent.SUCCEED, result)

    def abort(self: ServerGoal[Action[Any, ResultT, Any]], result: ResultT | None = None) -> Finished:
        """End the goal as ABORTED; errors as `succeed`."""
        return self._finish(GoalEvent.ABORT, result)

    def canceled(self: ServerGoal[Action[Any, ResultT, Any]], result: ResultT | None = None) -> Finished:
        """End the goal as CANCELED.

        Raises:
            GoalTransitionError: nobody asked for a cancel (see `cancel_requested`), or it has ended already.
        """
        return self._finish(GoalEvent.CANCELED, result)

    def _finish(self, event: GoalEvent, result: object | None) -> Finished:
        self._server.on_loop(lambda: self._server.finish(self.goal_id, event, result))
        return FINISHED

    def __repr__(self) -> str:
        return f"ServerGoal({self.goal_id.hex()}, {self.status.name})"


class GoalRequest(Generic[ActionT_co]):
    """A goal that waits for `accept` or `reject`, from iterating over an action server.

    One that the program drops without an answer is rejected with a warning.
    """

    def __init__(self, server: GoalServer, goal: ServerGoal[ActionT_co], let_go: Callable[[bytes], None]) -> None:
        self._server = server
        self._goal = goal
        self._let_go = let_go

    def __del__(self) -> None:
        self._let_go(self._goal.goal_id)

    @property
    def goal_id(self) -> bytes:
        """16 bytes."""
        return self._goal.goal_id

    @property
    def goal(self: GoalRequest[Action[GoalT, Any, Any]]) -> GoalT:
        """What the client asks for."""
        return self._goal.request

    def accept(self) -> ServerGoal[ActionT_co]:
        """Accept and begin: the goal is EXECUTING, and it is up to the caller to end it.

        With the policies ``"queue"`` and ``"preempt"`` it may have to stand in line, and is ACCEPTED until
        ``await goal.started()`` returns.

        Raises:
            AlreadyRespondedError: also when the policy is ``"reject"`` and another goal was accepted meanwhile.
        """
        self._server.on_loop(lambda: self._server.admit(self._goal, start=True))
        return self._goal

    def defer(self) -> ServerGoal[ActionT_co]:
        """Accept; the goal stays ACCEPTED until its `execute` is called."""
        self._server.on_loop(lambda: self._server.admit(self._goal, start=False))
        return self._goal

    def reject(self) -> None:
        """Refuse."""
        self._server.on_loop(lambda: self._server.refuse(self._goal))


class CancelRequest(Generic[ActionT_co]):
    """A wish to cancel one goal, from `ActionServer.cancel_requests`."""

    def __init__(self, goal: ServerGoal[ActionT_co], answer: asyncio.Future[bool]) -> None:
        self.goal = goal
        """The goal it is about."""
        self._answer = answer

    def accept(self) -> None:
        """The goal becomes CANCELING; end it with `goal.canceled`, or otherwise. One not started ends by itself."""
        self._decide(True)

    def reject(self) -> None:
        """The goal goes on."""
        self._decide(False)

    def _decide(self, accepted: bool) -> None:
        if self._answer.done():
            raise AlreadyRespondedError("this cancel request was answered already, or its goal has ended")
        self._answer.set_result(accepted)
