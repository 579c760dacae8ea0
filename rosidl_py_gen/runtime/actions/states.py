"""State machine, table and errors for the goals of an action server, and their encoding as status array; without I/O.

Times are nanoseconds of the clock of the server. Source: docs/internals/protocol.md 8.2 to 8.4.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum, IntEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Generic, TypeVar

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.cdr.layout import Count, Header
from rosidl_py_gen.errors import RosidlError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosidl_py_gen.runtime.transport.api import Payload


class ActionError(RosidlError):
    """Base class of errors about action goals and cancel requests."""


class UnknownGoalError(ActionError, LookupError):
    """Raised for a goal that the action server does not know, or whose result has expired."""


class GoalRejectedError(ActionError):
    """Raised if the action server rejects a goal."""


class ActionTimeoutError(ActionError, TimeoutError):
    """Raised if the action server does not reply in time; the goal may continue."""


class ActionServerLostError(ActionError):
    """Raised if the action server disappears before it replies, or before it sends the result."""


class CancelError(ActionError):
    """Raised if a request to cancel a goal fails."""


class CancelRejectedError(CancelError):
    """Raised if the action server refuses to cancel a goal."""


class AlreadyTerminatedError(CancelError):
    """Raised if a goal to cancel has ended, or is being cancelled already."""


ResultT = TypeVar("ResultT")

ZERO_ID = bytes(16)
MIN_RESULT_RETENTION_NS = 50_000_000
"""Minimum time in nanoseconds for which a server retains a result; a shorter timeout is raised to this value.

A client requests the result after it has received the acceptance, and a goal may have ended by then. rclpy with
``result_timeout=0`` loses 8 to 60 of 60 results of short goals. A client on the same machine needs 1 to 5 ms, and up to
30 ms on a busy machine.
"""
GOAL_EVENT_INVALID = 2301
"""Value of rcl's return code RCL_RET_ACTION_GOAL_EVENT_INVALID."""


class GoalStatus(IntEnum):
    """Status of a goal, with the numbers of action_msgs/GoalStatus."""

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


STATUSES = {int(status): status for status in GoalStatus}
"""Members of `GoalStatus` by their number."""


class GoalEvent(Enum):
    """Event that changes the status of a goal."""

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
"""Next status of a goal, by status and event; if a pair is missing, the event is not possible in the status."""
# Source: docs/internals/protocol.md 8.2.
TERMINAL_STATUS_OF = {event: status for (_, event), status in GOAL_TRANSITIONS.items() if status.is_terminal}
"""Final status of a goal, by the event that ends the goal."""


class GoalTransitionError(RosidlError):
    """Raised for an event that is not possible in the status of a goal; `code` is the number of the error in rcl."""

    code = GOAL_EVENT_INVALID

    def __init__(self, status: GoalStatus, event: GoalEvent) -> None:
        self.status, self.event = status, event
        possible = ", ".join(e.value for s, e in GOAL_TRANSITIONS if s is status) or "nothing"
        super().__init__(f"a goal that is {status.name} cannot {event.value}; possible events: {possible}")


def next_goal_status(status: GoalStatus, event: GoalEvent) -> GoalStatus:
    """Return the status of a goal after `event`, by `GOAL_TRANSITIONS`.

    Raises:
        GoalTransitionError: the event is not possible in this status.
        TypeError: an argument is not a `GoalStatus` or not a `GoalEvent`.
    """
    if not isinstance(status, GoalStatus) or not isinstance(event, GoalEvent):
        raise TypeError(f"expected a GoalStatus and a GoalEvent, got {status!r:.100} and {event!r:.100}")
    try:
        return GOAL_TRANSITIONS[status, event]
    except KeyError:
        raise GoalTransitionError(status, event) from None


class GoalDecision(Enum):
    """Return value of a `goal_callback` of an action server.

    A callback may also return None, which means ACCEPT, or another value, which accepts the goal if it is true.
    """

    ACCEPT = "accept and start"
    REJECT = "reject"
    DEFER = "accept; `goal.execute()` starts it later"


class CancelCode(IntEnum):
    """Return codes in the reply to a cancel request, with the numbers of action_msgs/CancelGoal."""

    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL_ID = 2
    GOAL_TERMINATED = 3


@dataclass(frozen=True, slots=True)
class GoalRules:
    """Rules of a `GoalTable` that differ between the action servers of this package and of rclpy.

    The two servers also call callbacks in different ways, which docs/internals/architecture.md lists.

    Attributes:
        code_of_refusal: return code of a cancel request if the program refuses every goal that can still be cancelled.
        code_of_ended_goal: return code of a cancel request for one goal that ends while the program decides.
    """

    code_of_refusal: CancelCode
    code_of_ended_goal: CancelCode


RULES = GoalRules(CancelCode.REJECTED, CancelCode.GOAL_TERMINATED)
"""Rules for goals of this package's `ActionServer`: as in rclcpp, a client learns that a cancel request had no effect.
"""
RCLPY_RULES = GoalRules(CancelCode.NONE, CancelCode.NONE)
"""Rules for goals of rclpy's `ActionServer`. rclpy replies to a refused cancel request with code 0 and an empty list,
which a client takes for success."""


@dataclass(frozen=True, slots=True)
class GoalInfo:
    """Id of a goal, and the time of its acceptance."""

    goal_id: bytes
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class CancelSelection:
    """Goals that a cancel request selects.

    Attributes:
        code: return code that says why `goals` is empty, or NONE.
        goals: selected goals that can be cancelled.
        by_id: the request names exactly one goal, so a goal that has ended is an error.
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
    """Goals of an action server with status and result, in the order of acceptance.

    A goal ends by an event. Its result timeout starts with `retain`, because an execute function may end its goal first
    and return the result afterwards.

    Args:
        result_timeout_ns: time from `retain` until `expire` removes a goal; None: never. rcl before Kilted counts from
            the acceptance, and removes the result of a long goal before a client can request it.
        rules: rules of the server.
    """

    def __init__(self, result_timeout_ns: int | None, rules: GoalRules = RULES) -> None:
        self.result_timeout_ns = result_timeout_ns
        self.rules = rules
        self._goals: dict[bytes, _Goal[ResultT]] = {}
        # Time from which each result is retained, oldest first, so that `expire` need not iterate over all goals.
        self._retained_ns: dict[bytes, int] = {}
        self._rows = StatusArray()

    def __len__(self) -> int:
        return len(self._goals)

    def __contains__(self, goal_id: bytes) -> bool:
        return goal_id in self._goals

    def accept(self, goal_id: bytes, now_ns: int) -> GoalInfo | None:
        """Add a goal as ACCEPTED; return None if another goal has the id, so that the new goal must be rejected."""
        if goal_id in self._goals:
            return None
        info = GoalInfo(goal_id, now_ns)
        self._goals[goal_id] = _Goal(info)
        self._rows.add(goal_id, now_ns, GoalStatus.ACCEPTED)
        return info

    def status(self, goal_id: bytes) -> GoalStatus:
        """Return the status of a goal; UNKNOWN if it is not in the table."""
        goal = self._goals.get(goal_id)
        return GoalStatus.UNKNOWN if goal is None else goal.status

    def status_message(self) -> bytes:
        """Return the serialized GoalStatusArray of all goals in the table."""
        return self._rows.message()

    def apply(self, goal_id: bytes, event: GoalEvent) -> GoalStatus:
        """Apply an event to a goal, and return its new status; after the end of the goal, call `retain`.

        Raises:
            UnknownGoalError: the goal is not in the table.
            GoalTransitionError: the event is not possible in the status of the goal.
        """
        goal = self._goals.get(goal_id)
        if goal is None:
            raise UnknownGoalError(f"goal {goal_id.hex()} is unknown, or its result has expired")
        goal.status = next_goal_status(goal.status, event)
        self._rows.set_status(goal_id, goal.status)
        return goal.status

    def retain(self, goal_id: bytes, result: ResultT, now_ns: int, *, failed: bool = False) -> None:
        """Store the result of a goal that has ended, and start its result timeout, unless it has started before.

        The method has no effect if the goal is not in the table.

        Args:
            goal_id: id of the goal.
            result: result of the goal.
            now_ns: current time.
            failed: the execute function raised after it had ended the goal; the status becomes ABORTED.
        """
        goal = self._goals.get(goal_id)
        if goal is None:
            return
        assert not goal.status.is_active, "the goal has not ended"
        goal.result = result
        if failed:
            goal.status = GoalStatus.ABORTED
            self._rows.set_status(goal_id, goal.status)
        if next(reversed(self._retained_ns.values()), now_ns) > now_ns:
            # The clock has jumped back: results must not be retained until it has caught up.
            self._retained_ns = {key: min(retained_ns, now_ns) for key, retained_ns in self._retained_ns.items()}
        self._retained_ns.setdefault(goal_id, now_ns)

    def result(self, goal_id: bytes) -> ResultT | None:
        """Return the result of a goal; None before `retain`, or if the goal is not in the table."""
        goal = self._goals.get(goal_id)
        return None if goal is None else goal.result

    def select_for_cancel(self, goal_id: bytes, stamp_ns: int) -> CancelSelection:
        """Return the goals that a cancel request selects by id and time, or the reason why it selects none.

        Source: docs/internals/protocol.md 8.4.
        """
        if goal_id != ZERO_ID and stamp_ns == 0:
            goal = self._goals.get(goal_id)
            if goal is None or goal.status is GoalStatus.UNKNOWN:
                return CancelSelection(CancelCode.UNKNOWN_GOAL_ID, by_id=True)
            if not goal.status.is_cancelable:
                return CancelSelection(CancelCode.GOAL_TERMINATED, by_id=True)
            return CancelSelection(CancelCode.NONE, (goal.info,), by_id=True)
        selected = [
            goal.info
            for goal in self._goals.values()
            if goal.status.is_cancelable
            and (stamp_ns == 0 or goal.info.stamp_ns <= stamp_ns or goal.info.goal_id == goal_id)
        ]
        return CancelSelection(CancelCode.NONE, tuple(selected))

    def cancel_code(self, selection: CancelSelection, *, any_canceled: bool) -> CancelCode:
        """Return the return code for the reply to a cancel request, once the program has decided and the goals are
        CANCELING.

        A goal that has ended during the decision counts as if it had ended before.

        Args:
            selection: goals that the cancel request selects.
            any_canceled: the request cancels at least one goal.
        """
        if any_canceled or not selection.goals:
            return selection.code
        if any(self.status(info.goal_id).is_cancelable for info in selection.goals):
            return self.rules.code_of_refusal
        return self.rules.code_of_ended_goal if selection.by_id else CancelCode.NONE

    def expire(self, now_ns: int) -> list[bytes]:
        """Remove finished goals whose result timeout is over; return their ids."""
        timeout_ns, expired = self.result_timeout_ns, []
        if timeout_ns is not None:
            for goal_id, retained_ns in self._retained_ns.items():
                if 0 < timeout_ns >= now_ns - retained_ns:
                    break  # all others are retained since a later time
                expired.append(goal_id)
        for goal_id in expired:
            del self._goals[goal_id], self._retained_ns[goal_id]
        if expired:
            self._rows.remove(expired)
        return expired

    def forget_status(self, goal_id: bytes) -> None:
        """Set the status of a goal to UNKNOWN, which no event changes; has no effect if the goal is not in the table.

        After `retain`, the goal expires like one that has ended.
        """
        goal = self._goals.get(goal_id)
        if goal is not None:
            goal.status = GoalStatus.UNKNOWN
            self._rows.set_status(goal_id, goal.status)

    def next_expiry_ns(self) -> int | None:
        """Return the time at which the next finished goal expires; None if no goal will expire."""
        if self.result_timeout_ns is None:
            return None
        for retained_ns in self._retained_ns.values():
            return retained_ns + max(self.result_timeout_ns, 0) + 1
        return None


_ROW = struct.Struct("<16s3xiIB")
_FIRST = Header.SIZE + Count.SIZE
_ID_BYTES, _PAD_BYTES, _STATUS_OFFSET = 16, 3, 27


class StatusArray:
    """Serialized GoalStatusArray with the goals of one action server, in the order of acceptance, which is updated in
    place.

    The status topic carries every goal of a server at every transition. With message objects, a server with a thousand
    retained results would spend milliseconds on each transition. A goal takes a row of 28 bytes: UUID 16, 3 padding
    bytes, sec 4, nanosec 4, status 1; the first row has no padding, because its stamp is aligned without it
    (docs/internals/protocol.md 2, 8.3).
    """

    def __init__(self) -> None:
        self._rows = bytearray()
        self._offsets: dict[bytes, int] = {}

    def add(self, goal_id: bytes, stamp_ns: int, status: int) -> None:
        """Append the bytes of a new goal to the serialized status array."""
        self._offsets[goal_id] = len(self._rows)
        self._rows += _ROW.pack(goal_id, *sec_nanosec(stamp_ns), status)

    def set_status(self, goal_id: bytes, status: int) -> None:
        """Change the status of a goal in the serialized status array."""
        self._rows[self._offsets[goal_id] + _STATUS_OFFSET] = status

    def remove(self, goal_ids: list[bytes]) -> None:
        """Remove goals from the serialized status array."""
        removed = {self._offsets.pop(goal_id) for goal_id in goal_ids}
        if removed:
            size = _ROW.size
            rows = [self._rows[at : at + size] for at in range(0, len(self._rows), size) if at not in removed]
            self._rows = bytearray().join(rows)
            self._offsets = {goal_id: index * size for index, goal_id in enumerate(self._offsets)}

    def message(self) -> bytes:
        """Return the serialized GoalStatusArray."""
        rows = self._rows
        first_id, rest = rows[:_ID_BYTES], memoryview(rows)[_ID_BYTES + _PAD_BYTES :]
        return b"".join((Header.BYTES, len(self._offsets).to_bytes(Count.SIZE, "little"), first_id, rest))


def find_status(data: Payload, goal_id: bytes) -> int | None:
    """Return the status of one goal in a serialized GoalStatusArray; None if the goal is not listed."""
    raw = data if isinstance(data, bytes) else bytes(data)
    at = raw.find(goal_id, _FIRST)
    while at >= 0:
        # Start of the row if the first one had padding, too.
        row = _FIRST - _PAD_BYTES if at == _FIRST else at
        if (row - _FIRST + _PAD_BYTES) % _ROW.size == 0 and row + _STATUS_OFFSET < len(raw):
            return raw[row + _STATUS_OFFSET]
        at = raw.find(goal_id, at + 1)
    return None
