"""Action clients: send, follow and cancel goals, and request their results.

A goal is tracked from before it is sent, because feedback may overtake the acceptance, until its result arrives. It is
sent only when all five endpoints of a server are matched, so that no feedback is lost. The result is requested as soon
as the goal is accepted. Each goal has one request, which is open until the goal ends.

Every server of the action's name receives a request, and replies UNKNOWN if it was started after the goal was accepted.
So UNKNOWN is ignored while a server that may have accepted the goal is present. When all of these have disappeared, the
present servers get the request; if there are no servers for `server_lost_timeout_s`, the result is lost.

One timer for all goals checks for conditions that no event reports:

- Servers queue few requests, and silently drop older ones. If the status topic reports the end of a goal and no result
  arrives, the request is repeated, with doubling delays; earlier requests may still be answered. If a server that
  accepted the goal replies UNKNOWN after the end, the request is repeated at most `_MAX_UNKNOWN_REPLIES` times.
- A killed server is announced until its lease ends. If a second node of the same name appears, its server gets the
  request. If the new server replies UNKNOWN and the old one acknowledges nothing, the goal ended with the old process.

A server of rclcpp sends the goal response before it registers the goal, so that a request in between is answered with
UNKNOWN. A server that may have accepted the goal and replies UNKNOWN within `REGISTRATION_TIMEOUT_S` gets another
request.

A goal costs no task and no future, because results are pending for as long as goals run.
Source: docs/internals/protocol.md 8.1, 8.3 to 8.5.
"""

from __future__ import annotations

import asyncio
import math
import uuid
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from rosidl_py_gen.base.stamps import NS_PER_S, set_stamp
from rosidl_py_gen.base.waiters import Waiters, blocking
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal
from rosidl_py_gen.runtime.actions.states import (
    STATUSES,
    ZERO_ID,
    ActionError,
    ActionServerLostError,
    ActionTimeoutError,
    AlreadyTerminatedError,
    CancelCode,
    CancelError,
    CancelRejectedError,
    GoalRejectedError,
    GoalStatus,
    UnknownGoalError,
    find_status,
)
from rosidl_py_gen.runtime.actions.types import (
    ActionArgumentError,
    ActionEntity,
    ActionT_co,
    goal_id_of,
    require_depth,
    require_goal_id,
    require_stamp,
    set_goal_id,
)
from rosidl_py_gen.runtime.entities.entity_scope import entity_repr
from rosidl_py_gen.runtime.entities.message_types import raw_type
from rosidl_py_gen.runtime.entities.services import CallTimeoutError, Client, ServerLostError, service_endpoint_qos
from rosidl_py_gen.runtime.entities.topics import Subscription
from rosidl_py_gen.runtime.graph import BARE_DDS_NODE, UNKNOWN_NODE
from rosidl_py_gen.runtime.loop.queues import AsyncQueue
from rosidl_py_gen.runtime.time_values import Deadline, Time, WaitTimeoutError, read_stamp, timeout_to_ns, with_reason
from rosidl_py_gen.runtime.transport.api import TopicKey, service_topic_keys
from rosidl_py_gen.runtime.transport.endpoint_index import MatchCache
from rosidl_py_gen.runtime.transport.qos import ACTION_STATUS, DEFAULT, SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.base.stamps import SecNanosec
    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.types import ActionNames, ActionType, FeedbackT, GoalT, ResultT
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.message_types import ServiceType
    from rosidl_py_gen.runtime.graph import TypeCheck
    from rosidl_py_gen.runtime.transport.flow_control import PendingRequest

T = TypeVar("T")

_CANCEL_ERRORS: dict[int, tuple[type[ActionError], str]] = {
    CancelCode.REJECTED: (CancelRejectedError, "refused to cancel"),
    CancelCode.UNKNOWN_GOAL_ID: (UnknownGoalError, "does not know"),
    CancelCode.GOAL_TERMINATED: (AlreadyTerminatedError, "has already ended, or is already cancelling,"),
}


class ClientGoal(Generic[ActionT_co]):
    """Goal that a server has accepted, from `ActionClient.send_goal`. Type checkers see `ClientGoal[Fibonacci]`."""

    def __init__(
        self,
        goal_id: bytes,
        goal: object,
        feedback_depth: int,
        cancel: Callable[[bytes, float | None], Coroutine[Any, Any, None]],
        scope: EntityScope,
    ) -> None:
        self.goal_id: bytes = goal_id
        """UUID of the goal, 16 bytes."""
        self._goal: Any = goal
        self._cancel = cancel
        self._scope = scope
        self._status = GoalStatus.UNKNOWN
        self._accepted_stamp: SecNanosec | None = None
        self._accepted_s: float | None = None
        """Time when the acceptance arrived, by the event loop's clock; None before."""
        self._feedback: AsyncQueue[Any] = AsyncQueue(feedback_depth)
        self._outcome: tuple[GoalStatus, Any] | None = None
        self._error: BaseException | None = None
        self._waiters = Waiters()

    def _on_accepted(self, stamp: SecNanosec, now_s: float) -> None:
        self._accepted_stamp, self._accepted_s = stamp, now_s
        if self._status is GoalStatus.UNKNOWN:
            self._status = GoalStatus.ACCEPTED

    def _on_status(self, number: int) -> None:
        """Record a status from the status topic, unless a later status is known, because the topic may lag behind
        replies.
        """
        status = STATUSES.get(number)
        if status is not None and status > self._status:
            self._status = status

    def _on_result(self, status: GoalStatus, result: object) -> None:
        if not self._has_ended():
            self._status, self._outcome = status, (status, result)
            self._feedback.close()
            self._waiters.wake()

    def _on_error(self, error: BaseException) -> None:
        """Record that no result will arrive, and raise the error in tasks that wait for the result or feedback."""
        if not self.is_done:
            self._error = error
            self._feedback.close(error)
            self._waiters.wake()

    @property
    def goal(self: ClientGoal[Action[GoalT, Any, Any]]) -> GoalT:
        """Goal message that was sent to the server."""
        goal: GoalT = self._goal
        return goal

    @property
    def status(self) -> GoalStatus:
        """Newest status of the goal that was received."""
        return self._status

    @property
    def accepted_stamp(self) -> Time | None:
        """Time of acceptance by the server's clock; None if the server sent a negative time."""
        return None if self._accepted_stamp is None else read_stamp(self._accepted_stamp)

    @property
    def is_done(self) -> bool:
        """True once `result` returns or raises without waiting."""
        return self._has_ended()

    def _has_ended(self) -> bool:
        return self._outcome is not None or self._error is not None

    @property
    def feedback_dropped(self) -> int:
        """Number of feedback messages that were dropped, oldest first, because the queue was full."""
        return self._feedback.dropped

    def feedback(self: ClientGoal[Action[Any, Any, FeedbackT]]) -> AsyncQueue[FeedbackT]:
        """Return the queue of all feedback of the goal; iterating over the queue ends when the result arrives.

        The iteration raises `ActionServerLostError` or `ClosedError` if no result will arrive.
        """
        return self._feedback

    async def result(
        self: ClientGoal[Action[Any, ResultT, Any]], timeout_s: float | None = None
    ) -> tuple[GoalStatus, ResultT]:
        """Wait for the end of the goal, and return its status and result; several tasks may call it repeatedly.

        Raises:
            ActionTimeoutError: the goal has not ended within `timeout_s`; it continues.
            TypeError, ValueError: `timeout_s` is not a number of seconds.
            ActionServerLostError: the server disappeared.
            UnknownGoalError: the server was restarted and does not know the goal.
            ActionError: the server sent a result with a status that does not end a goal.
            ClosedError: the client was closed.
        """
        if not await self._waiters.wait(self._has_ended, Deadline(timeout_s).remaining_s()):
            raise ActionTimeoutError(
                f"no result of goal {self.goal_id.hex()} in {timeout_s} s; it is {self.status.name}"
            )
        if self._error is not None:
            raise self._error
        assert self._outcome is not None
        return self._outcome

    result_sync = blocking(result)

    async def cancel(self, timeout_s: float | None = None) -> None:
        """Request to cancel the goal, and wait for the server's consent. The goal ends later; `result` waits for that.

        Raises:
            CancelRejectedError, AlreadyTerminatedError, UnknownGoalError: the server refused.
            ActionTimeoutError: no reply arrived within `timeout_s`.
            ActionServerLostError: the server disappeared.
            ClosedError: the client is closed.
        """
        await self._cancel(self.goal_id, timeout_s)

    cancel_sync = blocking(cancel)

    def __repr__(self) -> str:
        return f"ClientGoal({self.goal_id.hex()}, {self.status.name})"


class ActionClient(ActionEntity, Generic[ActionT_co]):
    """Client of an action, created by `Node.create_action_client`."""

    def __init__(
        self,
        scope: EntityScope,
        action_type: ActionType,
        names: ActionNames,
        *,
        feedback_depth: int,
        server_lost_timeout_s: float,
        type_hash_check: TypeCheck | None = None,
    ) -> None:
        super().__init__(scope, action_type, names, type_hash_check)
        self._feedback_depth = require_depth("feedback_depth", feedback_depth)
        lost_after_ns = timeout_to_ns("server_lost_timeout_s", server_lost_timeout_s)
        self._goals: dict[bytes, ClientGoal[ActionT_co]] = {}
        # The topics first: peers discover endpoints in this order, and a server that knows the send_goal client must
        # know the feedback subscription, too. That subscription keeps all samples: all goals share its queue, and each
        # goal has a queue of its own depth.
        parts = self._parts
        self._feedback: Subscription[Any] = Subscription(
            parts, action_type.feedback_message, names.feedback, self._on_feedback, service_endpoint_qos(DEFAULT)
        )
        self._status: Subscription[bytes] = Subscription(
            parts, raw_type(action_type.status), names.status, self._on_status, ACTION_STATUS
        )
        self._send: Client[Any, Any] = Client(parts, action_type.send_goal, names.send_goal, SERVICES_DEFAULT)
        self._cancel: Client[Any, Any] = Client(parts, action_type.cancel, names.cancel_goal, SERVICES_DEFAULT)
        self._result = ResultRequester(parts, action_type.get_result, names.get_result, lost_after_ns)
        self._services = (self._send, self._cancel, self._result.client)
        self._topics = (self._feedback, self._status)
        topic_keys = [key for client in self._services for key in service_topic_keys(client.name, client.qos)]
        topic_keys += [TopicKey.of_topic(topic.topic, topic.qos) for topic in self._topics]
        self._servers: MatchCache[bool] = MatchCache(
            scope.participant.endpoint_index, topic_keys, lambda _: not self._missing()
        )
        """Cache with one entry, for the key None: True if a server is matched."""
        scope.register(self)

    def server_is_available(self) -> bool:
        """Return True if all three services and both topics of a server are matched.

        Raises:
            IncompatibleServiceError: the only servers are Fast DDS servers that cannot be used.
            ClosedError: the client is closed.
        """
        self._require_open()
        self._scope.discovery.refresh()
        return self._is_available()

    def _is_available(self) -> bool:
        return self._servers[None]

    def server_is_ready(self) -> bool:
        """Return `server_is_available()`; for compatibility with rclpy."""
        return self.server_is_available()

    def _missing(self) -> list[str]:
        """Return the names of the action's services and topics for which no server is matched."""
        missing = [client.name for client in self._services if not client._available()]
        return missing + [topic.topic for topic in self._topics if not topic.publisher_count]

    def _why_missing(self) -> str:
        for client in self._services:
            if not client._available():
                return client._why_missing(client.name.removeprefix(self.name))
        silent = (topic for topic in self._topics if not topic.publisher_count)
        return next((topic._why_unmatched() for topic in silent), "")

    async def wait_for_server(self, timeout_s: float | None = None) -> Literal[True]:
        """Wait until all three services and both topics of a server are matched.

        Raises:
            WaitTimeoutError: no server was matched within `timeout_s`.
            IncompatibleServiceError: the only servers are Fast DDS servers that cannot be used.
            ClosedError: the client is closed, also while waiting.
        """
        return await self._scope.wait_or_raise(
            self._is_available,
            timeout_s,
            lambda: f"no server of action {self.name} ({self.action_type}) appeared at {', '.join(self._missing())}",
            self,
            why=self._why_missing,
        )

    wait_for_server_sync = blocking(wait_for_server)

    async def send_goal(
        self: ActionClient[Action[GoalT, Any, Any]],
        goal: GoalT,
        timeout_s: float | None = None,
        *,
        goal_id: bytes | None = None,
    ) -> ClientGoal[ActionT_co]:
        """Wait for a server, send a goal, wait until the server accepts the goal, and return the accepted goal.

        Args:
            goal: goal message.
            timeout_s: time for all of this; None waits forever.
            goal_id: 16 bytes, not all zero; None: a random UUID.

        Raises:
            GoalRejectedError: the server rejected the goal.
            ActionTimeoutError: no reply arrived within `timeout_s`; a `TimeoutError`.
            ActionServerLostError: the server disappeared before it replied; it may have accepted the goal.
            EncodeError, TypeError: the goal does not fit its type.
            ActionArgumentError: `goal_id` is not a goal id, or belongs to a goal that has not ended.
            IncompatibleServiceError: the only servers are Fast DDS servers that cannot be used.
            ClosedError: the client is closed.
        """
        if self._closed or self._scope.closed:
            self._require_open()
        request = self._type.cls.SendGoal.Request()
        goal_id = uuid.uuid4().bytes if goal_id is None else require_goal_id(goal_id)
        if goal_id in self._goals:
            raise ActionArgumentError(f"goal_id {goal_id.hex()} belongs to a goal of this client that has not ended")
        set_goal_id(request, goal_id)
        request.goal = self._type.goal.to_message(goal)
        client_goal: ClientGoal[ActionT_co] = ClientGoal(
            goal_id, goal, self._feedback_depth, self.cancel_goal, self._scope
        )
        self._goals[goal_id] = client_goal
        try:
            response = await self._call_send_goal(request, timeout_s)
            if not response.accepted:
                raise GoalRejectedError(f"action server {self.name} rejected the goal {goal!r:.200}")
            client_goal._on_accepted(response.stamp, asyncio.get_running_loop().time())
            self._request_result(client_goal)
        except BaseException:
            self._goals.pop(goal_id, None)
            raise
        return client_goal

    send_goal_sync = blocking(send_goal)

    async def _call_send_goal(self, request: Any, timeout_s: float | None) -> Any:
        left_s = timeout_s
        if not self._servers[None]:
            deadline = Deadline(timeout_s)
            # Raise encoding errors before waiting for a server.
            self._type.send_goal.request.encode(request)
            try:
                await self.wait_for_server(deadline.remaining_s())
            except WaitTimeoutError as error:
                names = ", ".join(self._missing())
                text = f"action {self.name}: goal not sent, because no server appeared in {timeout_s} s at {names}"
                raise ActionTimeoutError(with_reason(text, error.reason)) from None
            left_s = deadline.remaining_s()
        try:
            return await self._send.call(request, left_s)
        except CallTimeoutError as error:
            raise ActionTimeoutError(f"action {self.name}: no reply to the goal in {timeout_s} s") from error
        except ServerLostError as error:
            raise ActionServerLostError(f"action {self.name}: no reply to the goal: {error}") from error

    def _request_result(self, goal: ClientGoal[ActionT_co]) -> None:
        request = self._type.cls.GetResult.Request()
        set_goal_id(request, goal.goal_id)

        def on_error(error: BaseException) -> None:
            self._goals.pop(goal.goal_id, None)
            goal._on_error(error)

        self._result.request(request, partial(self._on_result, goal), on_error, lambda: goal.status.is_terminal)

    def _on_result(self, goal: ClientGoal[ActionT_co], response: Any) -> None:
        self._feedback._deliver()  # feedback that arrived before the result and was not handled yet
        self._goals.pop(goal.goal_id, None)
        server, goal_id = f"action server {self.name}", goal.goal_id.hex()
        try:
            status = STATUSES.get(response.status)
            if status is GoalStatus.UNKNOWN:
                raise UnknownGoalError(f"{server} does not know goal {goal_id}")
            if status is None or not status.is_terminal:
                text = f"{response.status}" + (f" ({status.name})" if status else "")
                expected = ", ".join(f"{value} ({value.name})" for value in GoalStatus if value.is_terminal)
                raise ActionError(f"{server} sent a result of goal {goal_id} with status {text}; expected {expected}")
            goal._on_result(status, self._type.result.to_value(response.result))
        except Exception as error:
            goal._on_error(error)

    async def cancel_goal(self, goal_id: bytes, timeout_s: float | None = None) -> None:
        """Request to cancel one goal, which another client may have sent, and wait for the server's consent.

        Raises:
            ActionArgumentError: `goal_id` is not a goal id.
            CancelRejectedError, AlreadyTerminatedError, UnknownGoalError: the server refused.
            ActionTimeoutError: no reply arrived within `timeout_s`.
            ActionServerLostError: the server disappeared.
            ClosedError: the client is closed.
        """
        goal_id = require_goal_id(goal_id)
        subject = f"goal {goal_id.hex()}"
        deadline, delay_s = Deadline(timeout_s), FIRST_RETRY_DELAY_S
        left_s = timeout_s
        while True:
            try:
                canceled = await self._request_cancel(goal_id, None, subject, left_s)
                break
            except UnknownGoalError:
                left_s = deadline.remaining_s()
                if not self._may_be_unregistered(goal_id) or (left_s is not None and left_s <= delay_s):
                    raise
            await asyncio.sleep(delay_s)
            delay_s, left_s = 2 * delay_s, deadline.remaining_s()
        if goal_id not in canceled:
            # rclpy servers reply 0 with an empty list if they refuse.
            raise CancelRejectedError(f"action server {self.name} refused to cancel {subject}")

    def _may_be_unregistered(self, goal_id: bytes) -> bool:
        """Return True if a goal was accepted so recently that the server may not have registered it yet.

        A server of rclcpp sends its reply before it registers the goal (see the docstring of the module).
        """
        goal = self._goals.get(goal_id)
        if goal is None or goal._accepted_s is None:
            return False
        return self._scope.loop_binding.running_loop().time() - goal._accepted_s < REGISTRATION_TIMEOUT_S

    cancel_goal_sync = blocking(cancel_goal)

    async def cancel_all(self, timeout_s: float | None = None) -> list[bytes]:
        """Request to cancel all goals of the server, also of other clients; return the ids of the cancelling goals.

        Raises:
            CancelRejectedError: the server refused for all of its goals.
            ActionTimeoutError: no reply arrived within `timeout_s`.
            ActionServerLostError: the server disappeared.
            ClosedError: the client is closed.
        """
        return await self._request_cancel(ZERO_ID, None, "any goal", timeout_s)

    cancel_all_sync = blocking(cancel_all)

    async def cancel_before(self, stamp: Time | SecNanosec, timeout_s: float | None = None) -> list[bytes]:
        """Request to cancel every goal accepted at `stamp` or earlier; return the ids of the goals being cancelled.

        Raises:
            ActionArgumentError: `stamp` is zero, which selects all goals.
            CancelRejectedError: the server refused for all of these goals.
            ActionTimeoutError: no reply arrived within `timeout_s`.
            ActionServerLostError: the server disappeared.
            ClosedError: the client is closed.
            TypeError: `stamp` is not a time.
        """
        return await self._request_cancel(ZERO_ID, require_stamp(stamp), "any goal", timeout_s)

    cancel_before_sync = blocking(cancel_before)

    async def _request_cancel(
        self, goal_id: bytes, stamp: Time | None, subject: str, timeout_s: float | None
    ) -> list[bytes]:
        request = CancelGoal.Request()
        set_goal_id(request.goal_info, goal_id)
        if stamp is not None:
            set_stamp(request.goal_info.stamp, stamp.nanoseconds)
        try:
            response = await self._cancel.call(request, timeout_s)
        except CallTimeoutError as error:
            raise ActionTimeoutError(f"action {self.name}: no reply to the cancel request: {error}") from error
        except ServerLostError as error:
            raise ActionServerLostError(f"action {self.name}: no reply to the cancel request: {error}") from error
        code = int(response.return_code)
        if code != CancelCode.NONE:
            error_class, text = _CANCEL_ERRORS.get(code, (CancelError, f"replied with the unknown code {code} for"))
            raise error_class(f"action server {self.name} {text} {subject}")
        return [goal_id_of(info) for info in response.goals_canceling]

    def _on_feedback(self, message: Any) -> None:
        goal = self._goals.get(goal_id_of(message))
        if goal is not None:
            goal._feedback._push(self._type.feedback.to_value(message.feedback))

    def _on_status(self, data: bytes) -> None:
        for goal_id, goal in list(self._goals.items()):  # another thread may send a goal
            status = find_status(data, goal_id)
            if status is not None:
                goal._on_status(status)

    def _described(self) -> str:
        return f"the action client of {self.name}"

    def __repr__(self) -> str:
        return entity_repr(self, self.name, self.action_type, peers=lambda: len(self._send._servers()), peer="server")

    def close(self) -> None:
        """Close the client: tasks that wait for a result get `ClosedError`, feedback ends. May be called twice."""
        for goal in list(self._goals.values()):
            goal._on_error(ClosedError(f"the action client of {self.name} was closed"))
        self._goals.clear()
        self._servers.close()
        super().close()


# -------------------------------------------------------------------------------------------------------------- results

CHECK_INTERVAL_S = 0.5
"""Interval in seconds at which an action client checks its servers while results are pending."""
_BATCH_INTERVAL_S = 0.01
"""Interval in seconds between groups of result requests that are sent together. It delays no result, because servers
reply when goals end."""
RETRY_DELAY_S = 0.5
"""Time in seconds from the end of a goal until the request for its result is repeated; doubles with each repetition."""
_MAX_UNKNOWN_REPLIES = 3
"""Number of UNKNOWN replies about an ended goal, from servers that accepted it, after which UNKNOWN is its result."""
ACK_TIMEOUT_S = 1.0
"""Time in seconds without acknowledgement after which an action server is considered dead if a second node has its
node's name.

A running server acknowledges within milliseconds.
"""
REGISTRATION_TIMEOUT_S = 2.0
"""Time in seconds after the acceptance of a goal in which the reply UNKNOWN may mean that the server has not registered
the goal yet.

rclcpp needs less than 1 ms to register a goal on an idle machine. A larger value delays the error for a goal that is
really unknown.
"""
FIRST_RETRY_DELAY_S = 0.02
"""Time in seconds until a server that may not have registered a goal gets another result request; doubles with each
retry."""


@dataclass(slots=True, eq=False)
class _ResultRequest:
    """Pending result of one goal.

    Attributes:
        request: get_result request.
        on_reply: called with the response.
        on_error: called with the exception if there is no response.
        has_ended: returns True once the goal is known to have ended.
        accepted_s: loop time when the goal was accepted.
        candidate_servers: reply writers of the servers that may know the goal.
        initial_servers: reply writers of the servers that existed when the goal was accepted.
        requested_servers: reply writers of all servers that received a request.
        sent_requests: requests without a final response; empty while there is no server.
        repeat_at_s: loop time to repeat the request; 0 while the goal continues.
        repeat_interval_s: delay that leads to `repeat_at_s`.
        unknown_count: number of UNKNOWN replies of `initial_servers` after the goal has ended.
        unknown_reply: UNKNOWN reply that was ignored, because another server may know the goal, and its loop time.
        is_early: a server of `initial_servers` replied UNKNOWN, perhaps because it had not registered the goal yet.
        is_retrying: another request is sent after `retry_delay_s`.
        retry_delay_s: delay of the next retry.
    """

    request: Any
    on_reply: Callable[[Any], None]
    on_error: Callable[[Exception], None]
    has_ended: Callable[[], bool]
    accepted_s: float
    candidate_servers: set[bytes] = field(default_factory=set)
    initial_servers: frozenset[bytes] = frozenset()
    requested_servers: set[bytes] = field(default_factory=set)
    sent_requests: list[PendingRequest[Any]] = field(default_factory=list)
    repeat_at_s: float = 0.0
    repeat_interval_s: float = field(default_factory=lambda: RETRY_DELAY_S)
    unknown_count: int = 0
    unknown_reply: tuple[Any, float] | None = None
    is_early: bool = False
    is_retrying: bool = False
    retry_delay_s: float = FIRST_RETRY_DELAY_S

    def is_repeat_due(self, now_s: float) -> bool:
        if not self.has_ended():
            return False
        if not self.repeat_at_s:
            self.repeat_at_s = now_s + self.repeat_interval_s
        return now_s >= self.repeat_at_s


class ResultRequester:
    """Pending results of one action client. Thread: loop."""

    def __init__(
        self, scope: EntityScope, service_type: ServiceType[Any, Any], name: str, lost_after_ns: int | None
    ) -> None:
        self._scope = scope
        self._lost_after_s = math.inf if lost_after_ns is None else lost_after_ns / NS_PER_S
        self._pending: set[_ResultRequest] = set()
        self._check_timer: asyncio.TimerHandle | None = None
        self._server_seen_s = 0.0
        self.client: Client[Any, Any] = Client(
            scope, service_type, name, SERVICES_DEFAULT, batch_interval_s=_BATCH_INTERVAL_S
        )

    def request(
        self,
        request: Any,
        on_reply: Callable[[Any], None],
        on_error: Callable[[Exception], None],
        has_ended: Callable[[], bool],
    ) -> None:
        """Request the result of a goal that was just accepted; call `on_reply` or `on_error` once.

        Args:
            request: get_result request.
            on_reply: called with the response.
            on_error: called with `ActionServerLostError`, `DecodeError` or `ClosedError`.
            has_ended: returns True once the goal is known to have ended.
        """
        loop = self._scope.loop_binding.running_loop()
        pending = _ResultRequest(request, on_reply, on_error, has_ended, loop.time())
        self._pending.add(pending)
        self._restart(pending)
        pending.initial_servers = frozenset(pending.candidate_servers)
        if self._check_timer is None:
            self._server_seen_s = loop.time()
            self._check_timer = loop.call_later(CHECK_INTERVAL_S, self._check_servers)

    def _restart(self, pending: _ResultRequest) -> None:
        """Withdraw earlier requests for a result, and send a new request to the present servers, if there are any."""
        if pending.sent_requests:
            self._abandon(pending)
        pending.is_early = pending.is_retrying = False
        pending.candidate_servers = servers = self.client._servers()
        if servers:
            self._send(pending, servers)

    def _send(self, pending: _ResultRequest, servers: set[bytes]) -> None:
        """Send another request for a result to the present servers, whose reply writers are `servers`."""
        pending.requested_servers |= servers
        on_reply, on_error = partial(self._on_reply, pending), partial(self._on_error, pending)
        pending.sent_requests.append(self.client._start_request(pending.request, on_reply, on_error))

    def _abandon(self, pending: _ResultRequest) -> None:
        for request in pending.sent_requests:
            self.client._abandon_request(request)
        pending.sent_requests.clear()

    def _on_reply(self, pending: _ResultRequest, response: Any, server: bytes | None) -> bool:
        """Handle a response to a result request.

        Returns True to keep the request open, because another server may know the goal.
        """
        if pending not in self._pending:
            return False
        if response.status != GoalStatus.UNKNOWN:
            self._end(pending, pending.on_reply, response)
            return False
        now_s = self._scope.loop_binding.running_loop().time()
        if server is None or server in pending.initial_servers:
            if now_s - pending.accepted_s < REGISTRATION_TIMEOUT_S:
                pending.is_early = True
            elif pending.has_ended():
                pending.unknown_count += 1
                if pending.unknown_count < _MAX_UNKNOWN_REPLIES:
                    return True
        pending.candidate_servers.discard(server or b"")
        if not pending.candidate_servers.isdisjoint(self.client._servers()):
            pending.unknown_reply = response, now_s
            return True
        return self._accept_unknown(pending, response)

    def _accept_unknown(self, pending: _ResultRequest, response: Any) -> bool:
        """Handle a server's reply that it does not know the goal; return True if the result will be requested again.

        It is requested again if the server may not have registered the accepted goal yet. Otherwise the client's goal
        gets the reply, and the method returns False.
        """
        if pending.is_early and not pending.is_retrying:
            pending.is_retrying = True
            self._scope.loop_binding.running_loop().call_later(pending.retry_delay_s, self._retry, pending)
            pending.retry_delay_s *= 2
        if not pending.is_retrying:
            self._end(pending, pending.on_reply, response)
        return pending.is_retrying

    def _retry(self, pending: _ResultRequest) -> None:
        if pending in self._pending and pending.is_retrying and not self._scope.closed:
            self._restart(pending)

    def _on_error(self, pending: _ResultRequest, error: Exception) -> None:
        if pending not in self._pending:
            return
        if isinstance(error, ServerLostError):
            pending.candidate_servers.clear()  # `_check_servers` sends another request when a server appears
        else:
            self._end(pending, pending.on_error, error)

    def _end(self, pending: _ResultRequest, report: Callable[[Any], None], value: Any) -> None:
        self._pending.discard(pending)
        self._abandon(pending)
        report(value)

    # ------------------------------------------------------------------------------------------- check of the servers

    def _check_servers(self) -> None:
        """Check the servers of all pending results, repeat requests where necessary, and schedule the next check."""
        self._check_timer = None
        if not self._pending or self._scope.closed:
            return
        loop = self._scope.loop_binding.running_loop()
        present, now_s = self.client._servers(), loop.time()
        if present:
            self._server_seen_s = now_s
        names = {server: self._node_of(server) for server in present}
        for pending in list(self._pending):
            if pending.is_retrying:
                continue
            if pending.candidate_servers.isdisjoint(present):
                self._switch_server(pending, present, now_s)
            elif pending.unknown_reply is not None and self._has_been_restarted(pending, names, now_s):
                self._accept_unknown(pending, pending.unknown_reply[0])
            elif self._restarted_servers(pending, names) - pending.requested_servers:
                self._send(pending, present)
            elif pending.is_repeat_due(now_s):
                pending.repeat_interval_s *= 2
                pending.repeat_at_s = now_s + pending.repeat_interval_s
                self._send(pending, present)
        self._check_timer = loop.call_later(CHECK_INTERVAL_S, self._check_servers)

    def _switch_server(self, pending: _ResultRequest, present: set[bytes], now_s: float) -> None:
        if present:
            self._restart(pending)
        elif now_s - self._server_seen_s >= self._lost_after_s:
            text = f"the server of {self.client.name} disappeared, and none has replaced it in {self._lost_after_s} s; "
            self._end(pending, pending.on_error, ActionServerLostError(text + "the goal's result is lost"))

    def _node_of(self, server: bytes) -> tuple[str, str]:
        endpoint = self._scope.graph.endpoints.get(server)
        return UNKNOWN_NODE if endpoint is None else self._scope.graph.node_of(endpoint)

    def _restarted_servers(self, pending: _ResultRequest, names: dict[bytes, tuple[str, str]]) -> set[bytes]:
        """Return the newer servers among the present servers whose node has the same name as a node that may know the
        goal.

        Args:
            names: name of the node of each present server.
        """
        old = {names[server] for server in pending.candidate_servers if server in names} - {UNKNOWN_NODE, BARE_DDS_NODE}
        return {
            server
            for server, name in names.items()
            if name in old and server not in pending.initial_servers | pending.candidate_servers
        }

    def _has_been_restarted(self, pending: _ResultRequest, names: dict[bytes, tuple[str, str]], now_s: float) -> bool:
        """Return True if all servers that may know the goal were restarted, and the old ones acknowledge nothing."""
        assert pending.unknown_reply is not None
        new = {names[server] for server in self._restarted_servers(pending, names)}
        all_restarted = all(names[server] in new for server in pending.candidate_servers if server in names)
        return (
            all_restarted and now_s - pending.unknown_reply[1] >= ACK_TIMEOUT_S and not self.client.all_acknowledged()
        )
