"""Goals on an action server: the state machine as a table, and the list of all goals.

Plain objects without I/O, fed with values; times are nanoseconds of the server's clock. Decides which event is
possible when, when a finished goal is forgotten, and who may be cancelled with which return code
(docs/internals/protocol.md 8.2 to 8.4). Sending answers is `server.py`'s, publishing the status `server_goal.py`'s.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum
from itertools import islice, takewhile
from types import MappingProxyType
from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

ResultT = TypeVar("ResultT")

ZERO_ID = bytes(16)
GOAL_EVENT_INVALID = 2301
"""RCL_RET_ACTION_GOAL_EVENT_INVALID."""


class GoalStatus(IntEnum):
    """Numbers of action_msgs/GoalStatus."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @property
    def is_terminal(self) -> bool:
        """True for SUCCEEDED, CANCELED, ABORTED."""
        return self >= GoalStatus.SUCCEEDED

    @property
    def is_active(self) -> bool:
        """True for ACCEPTED, EXECUTING, CANCELING."""
        return GoalStatus.ACCEPTED <= self <= GoalStatus.CANCELING

    @property
    def is_cancelable(self) -> bool:
        """True for ACCEPTED, EXECUTING."""
        return self in (GoalStatus.ACCEPTED, GoalStatus.EXECUTING)


class GoalEvent(Enum):
    """What can happen to a goal."""

    EXECUTE = "execute"
    CANCEL_GOAL = "cancel_goal"
    SUCCEED = "succeed"
    ABORT = "abort"
    CANCELED = "canceled"


GOAL_TRANSITIONS: Mapping[tuple[GoalStatus, GoalEvent], GoalStatus] = MappingProxyType(
    {
        (GoalStatus.ACCEPTED, GoalEvent.EXECUTE): GoalStatus.EXECUTING,
        (GoalStatus.ACCEPTED, GoalEvent.CANCEL_GOAL): GoalStatus.CANCELING,
        (GoalStatus.EXECUTING, GoalEvent.CANCEL_GOAL): GoalStatus.CANCELING,
        (GoalStatus.EXECUTING, GoalEvent.SUCCEED): GoalStatus.SUCCEEDED,
        (GoalStatus.CANCELING, GoalEvent.SUCCEED): GoalStatus.SUCCEEDED,
        (GoalStatus.EXECUTING, GoalEvent.ABORT): GoalStatus.ABORTED,
        (GoalStatus.CANCELING, GoalEvent.ABORT): GoalStatus.ABORTED,
        (GoalStatus.CANCELING, GoalEvent.CANCELED): GoalStatus.CANCELED,
    }
)
"""The status of a goal and what happens to it give the next status; every pair that is not here is an error.

Source: docs/internals/protocol.md 8.2.
"""
TERMINAL_STATUS_OF = {event: status for (_, event), status in GOAL_TRANSITIONS.items() if status.is_terminal}
"""The events that end a goal."""


class GoalTransitionError(RosidlError):
    """The caller wanted something a goal cannot do in its present state; `code` is rcl's number."""

    code = GOAL_EVENT_INVALID

    def __init__(self, status: GoalStatus, event: GoalEvent) -> None:
        self.status, self.event = status, event
        possible = ", ".join(e.value for s, e in GOAL_TRANSITIONS if s is status) or "nothing"
        super().__init__(f"a goal that is {status.name} cannot {event.value}; possible now: {possible}")


class ActionError(RosidlError):
    """An action server did not do what the caller asked for."""


class UnknownGoalError(ActionError, LookupError):
    """The caller named a goal the server does not know, or has already forgotten."""


def next_goal_status(status: GoalStatus, event: GoalEvent) -> GoalStatus:
    """The status of a goal after `event`, by `GOAL_TRANSITIONS`.

    Raises:
        GoalTransitionError: a goal of that status cannot do that. TypeError: they are no status and no event.
    """
    if not isinstance(status, GoalStatus) or not isinstance(event, GoalEvent):
        raise TypeError(f"expected a GoalStatus and a GoalEvent, got {status!r:.100} and {event!r:.100}")
    try:
        return GOAL_TRANSITIONS[status, event]
    except KeyError:
        raise GoalTransitionError(status, event) from None


class GoalDecision(Enum):
    """What an `accept` callback may answer. None means ACCEPT; of anything else counts whether it is true."""

    ACCEPT = "accept and start"
    REJECT = "reject"
    DEFER = "accept; `goal.execute()` starts it later"


class CancelCode(IntEnum):
    """Return codes of action_msgs/CancelGoal."""

    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL_ID = 2
    GOAL_TERMINATED = 3


@dataclass(frozen=True, slots=True)
class GoalInfo:
    """Id and time of acceptance."""

    goal_id: bytes
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class CancelSelection:
    """The goals a cancel request is about; `code` says already why there is none.

    Attributes:
        by_id: the request names one goal and nothing else, so that its end matters to the caller.
    """

    code: CancelCode
    goals: tuple[GoalInfo, ...] = ()
    by_id: bool = False


@dataclass(slots=True)
class _Goal(Generic[ResultT]):
    info: GoalInfo
    status: GoalStatus = GoalStatus.ACCEPTED
    result: ResultT | None = None


class GoalTable(Generic[ResultT]):
    """All goals a server knows, in the order of acceptance.

    Args:
        result_timeout_ns: how long a finished goal is remembered, None for ever. It counts from the end of the goal:
            counting from its acceptance, as rcl does, forgets the result of a long goal before anybody could ask. 0 or
            less forgets it at the next `expire`.
    """

    def __init__(self, result_timeout_ns: int | None) -> None:
        self.result_timeout_ns = result_timeout_ns
        self._goals: dict[bytes, _Goal[ResultT]] = {}
        # Finished goals with the time of their end, oldest first: nothing looks at all goals to find what is over.
        self._ended_ns: dict[bytes, int] = {}

    def __len__(self) -> int:
        return len(self._goals)

    def __contains__(self, goal_id: bytes) -> bool:
        return goal_id in self._goals

    def accept(self, goal_id: bytes, now_ns: int) -> GoalInfo | None:
        """Enter a goal as ACCEPTED; None when the id is already known, and the goal must be refused."""
        if goal_id in self._goals:
            return None
        info = GoalInfo(goal_id, now_ns)
        self._goals[goal_id] = _Goal(info)
        return info

    def status(self, goal_id: bytes) -> GoalStatus:
        """UNKNOWN for goals not in the book."""
        goal = self._goals.get(goal_id)
        return GoalStatus.UNKNOWN if goal is None else goal.status

    def apply(self, goal_id: bytes, event: GoalEvent) -> GoalStatus:
        """Let something happen that does not end the goal; raises `UnknownGoalError`, `GoalTransitionError`."""
        goal = self._find(goal_id)
        status = next_goal_status(goal.status, event)
        assert not status.is_terminal, "use finish, which takes the result"
        goal.status = status
        return status

    def finish(self, goal_id: bytes, event: GoalEvent, result: ResultT, now_ns: int) -> None:
        """End a goal with its result, which is any object. Raises as `apply`."""
        goal = self._find(goal_id)
        status = next_goal_status(goal.status, event)
        assert status.is_terminal, "use apply"
        goal.status, goal.result = status, result
        if any(ended_ns > now_ns for ended_ns in islice(reversed(self._ended_ns.values()), 1)):
            # Time went back. Goals must not be kept until it has caught up.
            self._ended_ns = {known: min(ended_ns, now_ns) for known, ended_ns in self._ended_ns.items()}
        self._ended_ns[goal_id] = now_ns

    def replace_result(self, goal_id: bytes, result: ResultT, status: GoalStatus) -> None:
        """Another result and end for a goal that has ended; nothing happens when it is forgotten already."""
        goal = self._goals.get(goal_id)
        if goal is not None:
            goal.status, goal.result = status, result

    def result(self, goal_id: bytes) -> ResultT | None:
        """None for goals that have not ended, and for those not in the book."""
        goal = self._goals.get(goal_id)
        return None if goal is None else goal.result

    def select_for_cancel(self, goal_id: bytes, stamp_ns: int) -> CancelSelection:
        """Which goals a cancel request is about, by the table of docs/internals/protocol.md 8.4."""
        if goal_id != ZERO_ID and stamp_ns == 0:
            goal = self._goals.get(goal_id)
            if goal is None:
                return CancelSelection(CancelCode.UNKNOWN_GOAL_ID, by_id=True)
            if not goal.status.is_cancelable:
                return CancelSelection(CancelCode.GOAL_TERMINATED, by_id=True)
            return CancelSelection(CancelCode.NONE, (goal.info,), by_id=True)
        chosen = [
            goal.info
            for goal in self._goals.values()
            if goal.status.is_cancelable
            and (stamp_ns == 0 or goal.info.stamp_ns <= stamp_ns or goal.info.goal_id == goal_id)
        ]
        return CancelSelection(CancelCode.NONE, tuple(chosen))

    def answer_cancel(
        self, selection: CancelSelection, agreed: Collection[GoalInfo]
    ) -> tuple[CancelCode, tuple[GoalInfo, ...]]:
        """The return code and the goals to cancel, once the user has agreed to some of the selected ones, or to none.

        Goals that ended meanwhile count as if they had ended before: GOAL_TERMINATED for one named by its id, nothing
        for others. REJECTED when the user refused every one that is left: rclcpp says so, while rclpy leaves 0, with
        which a client could not tell a refusal from a success.
        """
        left = [info for info in selection.goals if self.status(info.goal_id).is_cancelable]
        canceled = tuple(info for info in left if info in agreed)
        if selection.goals and not left and selection.by_id:
            return CancelCode.GOAL_TERMINATED, ()
        return CancelCode.REJECTED if left and not canceled else selection.code, canceled

    def expire(self, now_ns: int) -> list[bytes]:
        """Forget finished goals whose time is over; returns their ids."""
        gone = list(takewhile(lambda goal_id: self._is_over(self._ended_ns[goal_id], now_ns), self._ended_ns))
        for goal_id in gone:
            del self._goals[goal_id], self._ended_ns[goal_id]
        return gone

    def next_expiry_ns(self) -> int | None:
        """When `expire` will next have something to do; None when no goal has ended, or will never be forgotten."""
        if self.result_timeout_ns is None:
            return None
        for ended_ns in self._ended_ns.values():
            return ended_ns + max(self.result_timeout_ns, 0) + 1
        return None

    def _is_over(self, ended_ns: int, now_ns: int) -> bool:
        timeout_ns = self.result_timeout_ns
        return timeout_ns is not None and (timeout_ns <= 0 or now_ns - ended_ns > timeout_ns)

    def _find(self, goal_id: bytes) -> _Goal[ResultT]:
        goal = self._goals.get(goal_id)
        if goal is None:
            raise UnknownGoalError(f"goal {goal_id.hex()} is not known, or its result has expired")
        return goal
