"""One goal as the handler of an action server sees it.

Decides what a handler may do with it; the rules are `goal.py`'s, the server does what crosses the wire. Every method
may be called from any thread: a plain `execute` function runs in a thread of its own.
"""

from __future__ import annotations

import asyncio
from enum import Enum
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.goal import GoalEvent, GoalStatus

if TYPE_CHECKING:
    from collections.abc import Callable

GoalT = TypeVar("GoalT")
ResultT = TypeVar("ResultT")
FeedbackT = TypeVar("FeedbackT")
T = TypeVar("T")


class GoalDecision(Enum):
    """What an `accept` callback may answer; True and None mean ACCEPT, False means REJECT."""

    ACCEPT = "accept and start"
    REJECT = "reject"
    DEFER = "accept; `goal.execute()` starts it later"


class Finished:
    """What `succeed`, `abort` and `canceled` return, so that a handler can say ``return goal.canceled(...)``."""

    __slots__ = ()


FINISHED = Finished()


class GoalServer(Protocol):
    """What a goal needs of its server."""

    def finish(self, goal_id: bytes, event: GoalEvent, result: object | None) -> None:
        """End a goal; None stands for a default result. Raises `GoalTransitionError`, `UnknownGoalError`."""

    def start(self, goal_id: bytes) -> None:
        """Start a deferred goal."""

    def publish_feedback(self, goal_id: bytes, feedback: object) -> None:
        """Send feedback."""

    def status_of(self, goal_id: bytes) -> GoalStatus:
        """UNKNOWN when it is forgotten."""

    def admit(self, goal_id: bytes, *, start: bool) -> None:
        """Accept a goal that waits for an answer. Raises `GoalAlreadyAnsweredError`."""

    def refuse(self, goal_id: bytes) -> None:
        """Reject a goal that waits for an answer. Raises `GoalAlreadyAnsweredError`."""

    def on_loop(self, function: Callable[[], T]) -> T:
        """Run `function` on the loop's thread and return what it returns."""


class ServerGoal(Generic[GoalT, ResultT, FeedbackT]):
    """A goal that was accepted."""

    def __init__(self, server: GoalServer, goal_id: bytes, request: GoalT) -> None:
        self._server = server
        self._cancel_requested = asyncio.Event()
        self.looked_for_cancel = False
        self.goal_id = goal_id
        """16 bytes."""
        self.request = request
        """What the client asked for."""

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
        """True once a cancel request was accepted: finish soon, with `canceled`, or otherwise."""
        self.looked_for_cancel = True
        return self._cancel_requested.is_set()

    async def wait_for_cancel(self) -> None:
        """Return when `cancel_requested` becomes true."""
        self.looked_for_cancel = True
        await self._cancel_requested.wait()

    def request_cancel(self) -> None:
        """Set `cancel_requested`; the server does this, after the status has changed."""
        self._cancel_requested.set()

    def publish_feedback(self, feedback: FeedbackT) -> None:
        """Tell the client how it goes; from any thread.

        Raises:
            EncodeError, TypeError: `feedback` does not fit. ClosedError: the server is closed.
        """
        self._server.publish_feedback(self.goal_id, feedback)

    def execute(self) -> None:
        """Start a deferred goal; without effect when it runs already. Raises `UnknownGoalError`."""
        self._server.on_loop(lambda: self._server.start(self.goal_id))

    def succeed(self, result: ResultT | None = None) -> Finished:
        """End the goal as SUCCEEDED; None is a default result.

        Raises:
            GoalTransitionError: it has ended already, or was never started.
        """
        return self._finish(GoalEvent.SUCCEED, result)

    def abort(self, result: ResultT | None = None) -> Finished:
        """End the goal as ABORTED; errors as `succeed`."""
        return self._finish(GoalEvent.ABORT, result)

    def canceled(self, result: ResultT | None = None) -> Finished:
        """End the goal as CANCELED.

        Raises:
            GoalTransitionError: nobody asked for a cancel (see `cancel_requested`), or it has ended already.
        """
        return self._finish(GoalEvent.CANCELED, result)

    def _finish(self, event: GoalEvent, result: ResultT | None) -> Finished:
        self._server.on_loop(lambda: self._server.finish(self.goal_id, event, result))
        return FINISHED

    def __repr__(self) -> str:
        return f"ServerGoal({self.goal_id.hex()}, {self.status.name})"


class GoalAlreadyAnsweredError(RosidlError, RuntimeError):
    """The caller accepted or rejected one request twice, or its server is closed."""


class GoalRequest(Generic[GoalT, ResultT, FeedbackT]):
    """A goal that waits for `accept` or `reject`, from iterating over an action server."""

    def __init__(self, server: GoalServer, goal: ServerGoal[GoalT, ResultT, FeedbackT]) -> None:
        self._server = server
        self._goal = goal

    @property
    def goal_id(self) -> bytes:
        """16 bytes."""
        return self._goal.goal_id

    @property
    def goal(self) -> GoalT:
        """What the client asks for."""
        return self._goal.request

    def accept(self) -> ServerGoal[GoalT, ResultT, FeedbackT]:
        """Accept and begin: the goal is EXECUTING, and it is up to the caller to end it."""
        self._server.admit(self.goal_id, start=True)
        return self._goal

    def defer(self) -> ServerGoal[GoalT, ResultT, FeedbackT]:
        """Accept; the goal stays ACCEPTED until its `execute` is called."""
        self._server.admit(self.goal_id, start=False)
        return self._goal

    def reject(self) -> None:
        """Refuse."""
        self._server.refuse(self.goal_id)


class CancelRequest(Generic[GoalT, ResultT, FeedbackT]):
    """A wish to cancel one goal, from `ActionServer.cancel_requests`."""

    def __init__(self, goal: ServerGoal[GoalT, ResultT, FeedbackT], answer: asyncio.Future[bool]) -> None:
        self.goal = goal
        """The goal it is about."""
        self._answer = answer

    def accept(self) -> None:
        """The goal becomes CANCELING; end it with `goal.canceled`, or otherwise."""
        self._decide(True)

    def reject(self) -> None:
        """The goal goes on."""
        self._decide(False)

    def _decide(self, accepted: bool) -> None:
        if self._answer.done():
            raise GoalAlreadyAnsweredError("this cancel request was answered already, or its goal has ended")
        self._answer.set_result(accepted)
