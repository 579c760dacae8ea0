"""Action clients: send goals, follow them, cancel them.

Decides that everything about a goal is remembered from before it is sent (feedback may overtake the acceptance) until
its result is in, that a goal is sent only when all five endpoints of a server are connected, so that its feedback finds
us, and that the result is asked for as soon as the goal is accepted. What happens when the server goes away is
`results.py`'s.

Source: docs/internals/protocol.md 8.1, 8.4, 8.5.
"""

from __future__ import annotations

import asyncio
import uuid
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from rosidl_py_gen.base.stamps import set_stamp
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal_Request
from rosidl_py_gen.runtime.actions.argument_checks import (
    ActionArgumentError,
    require_depth,
    require_goal_id,
    require_stamp,
)
from rosidl_py_gen.runtime.actions.client_goal import (
    STATUSES,
    ActionServerLostError,
    ActionTimeoutError,
    AlreadyTerminatedError,
    CancelError,
    CancelRejectedError,
    ClientGoal,
    GoalProgress,
    GoalRejectedError,
)
from rosidl_py_gen.runtime.actions.result_requests import FIRST_RETRY_DELAY_S, REGISTRATION_TIMEOUT_S, ResultRequester
from rosidl_py_gen.runtime.actions.states import ZERO_ID, ActionError, CancelCode, GoalStatus, UnknownGoalError
from rosidl_py_gen.runtime.actions.status import find_status
from rosidl_py_gen.runtime.actions.types import ActionT_co, goal_id_of, set_goal_id
from rosidl_py_gen.runtime.entities.client import Client
from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity, entity_repr
from rosidl_py_gen.runtime.entities.message_types import raw_type
from rosidl_py_gen.runtime.entities.service_common import CallTimeoutError, ServerLostError, service_endpoint_qos
from rosidl_py_gen.runtime.entities.subscription import Subscription
from rosidl_py_gen.runtime.loop.blocking import blocking
from rosidl_py_gen.runtime.time.deadline import Deadline, WaitTimeoutError, with_reason
from rosidl_py_gen.runtime.time.values import Time, read_stamp, timeout_to_ns
from rosidl_py_gen.runtime.transport.match_cache import MatchCache
from rosidl_py_gen.runtime.transport.qos import ACTION_STATUS, DEFAULT, SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from rosidl_py_gen.base.stamps import SecNanosec
    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.types import ActionNames, ActionType, GoalT
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck

T = TypeVar("T")

_CANCEL_ERRORS: dict[int, tuple[type[ActionError], str]] = {
    CancelCode.REJECTED: (CancelRejectedError, "refused to cancel"),
    CancelCode.UNKNOWN_GOAL_ID: (UnknownGoalError, "does not know"),
    CancelCode.GOAL_TERMINATED: (AlreadyTerminatedError, "has ended already, or is cancelling,"),
}


class ActionClient(CompositeEntity, Generic[ActionT_co]):
    """Made by `create_action_client`."""

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
        super().__init__(scope, type_hash_check=type_hash_check)
        self._feedback_depth = require_depth("feedback_depth", feedback_depth)
        lost_after_ns = timeout_to_ns("server_lost_timeout_s", server_lost_timeout_s)
        self.name = names.action
        """Fully qualified name of the action."""
        self.action_type = action_type.ros_name
        """``pkg/action/Name``."""
        self.action_class = action_type.cls
        """The generated class, with `Goal`, `Result` and `Feedback`."""
        self._type = action_type
        self._is_available: MatchCache[bool] = MatchCache(scope.graph, lambda _: not self._missing())
        self._goals: dict[bytes, GoalProgress] = {}
        # The topics first: endpoints become known in this order, and a server that knows the client of send_goal shall
        # know who wants the feedback. Feedback is kept until it is sorted: the queue is shared by all goals, each has
        # its own depth.
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
        scope.register(self)

    # ------------------------------------------------------------------------------------------------ availability

    def server_is_available(self) -> bool:
        """Whether a server is connected: three services and both topics.

        Raises:
            IncompatibleServiceError: the only servers are Fast DDS ones.
            ClosedError: the client is closed.
        """
        self._scope.require_open(self._closed, f"the action client of {self.name}")
        self._scope.discovery.refresh()
        return self._is_available.get()

    def server_is_ready(self) -> bool:
        """Return `server_is_available()`; the name in rclpy."""
        return self.server_is_available()

    def _missing(self) -> list[str]:
        """The names of what no server is connected at."""
        services = (self._send, self._cancel, self._result.client)
        missing = [client.name for client in services if not client.service_is_available()]
        return missing + [topic.topic for topic in (self._feedback, self._status) if not topic.publisher_count]

    def _why_missing(self) -> str:
        for client in (self._send, self._cancel, self._result.client):
            if not client.service_is_available():
                return client._why_missing(client.name.removeprefix(self.name))
        silent = (topic for topic in (self._feedback, self._status) if not topic.publisher_count)
        return next((topic._why_unmatched() for topic in silent), "")

    async def wait_for_server(self, timeout_s: float | None = None) -> Literal[True]:
        """Wait until a server is connected.

        Raises:
            WaitTimeoutError: none was in time. Others as `server_is_available`.
        """
        return await self._scope.wait_or_raise(
            self._is_available.get,
            timeout_s,
            lambda: self._closed,
            lambda: f"no server of action {self.name} ({self.action_type}) appeared at {', '.join(self._missing())}",
            why=self._why_missing,
        )

    wait_for_server_sync = blocking(wait_for_server)

    # ------------------------------------------------------------------------------------------------------- goals

    async def send_goal(
        self: ActionClient[Action[GoalT, Any, Any]],
        goal: GoalT,
        timeout_s: float | None = None,
        *,
        goal_id: bytes | None = None,
    ) -> ClientGoal[ActionT_co]:
        """Send a goal and wait until it is accepted; a server that is not there yet is waited for.

        Args:
            goal_id: 16 bytes, not all zero; None makes a random UUID.

        Raises:
            GoalRejectedError: the server does not want it.
            ActionTimeoutError: no answer in `timeout_s` seconds; a `TimeoutError`.
            ActionServerLostError: the server went away before it answered; the goal may have been accepted.
            EncodeError, TypeError: the goal does not fit its type.
            ActionArgumentError: no goal id, or one of a goal of this client that has not ended.
            IncompatibleServiceError, ClosedError: as their names say.
        """
        self._scope.require_open(self._closed, f"the action client of {self.name}")
        deadline = Deadline(timeout_s)
        request = self._type.cls.SendGoal.Request()
        goal_id = uuid.uuid4().bytes if goal_id is None else require_goal_id(goal_id)
        if goal_id in self._goals:
            raise ActionArgumentError(f"goal_id {goal_id.hex()} belongs to a goal of this client that has not ended")
        set_goal_id(request, goal_id)
        request.goal = self._type.goal.to_message(goal)
        progress = GoalProgress(goal_id, self._feedback_depth)
        self._goals[goal_id] = progress
        try:
            response = await self._call_send_goal(request, deadline, timeout_s)
            if not response.accepted:
                raise GoalRejectedError(f"action server {self.name} rejected the goal {goal!r:.200}")
            now_s = self._scope.bridge.running_loop().time()
            progress.on_accepted(read_stamp(response.stamp), now_s)
            self._ask_result(progress)
        except BaseException:
            self._goals.pop(goal_id, None)
            raise
        return ClientGoal(progress, goal, self.cancel_goal, self._run_sync)

    async def _call_send_goal(self, request: Any, deadline: Deadline, timeout_s: float | None) -> Any:
        if not self._is_available.get():
            # A goal that does not fit is refused before anybody is waited for.
            self._type.send_goal.request.encode(request)
            try:
                await self.wait_for_server(deadline.remaining_s())
            except WaitTimeoutError as error:
                places = ", ".join(self._missing())
                text = f"goal not answered by action {self.name}: no server appeared in {timeout_s} s at {places}"
                raise ActionTimeoutError(with_reason(text, error.reason)) from None
        try:
            return await self._send.call(request, deadline.remaining_s())
        except CallTimeoutError as error:
            raise ActionTimeoutError(f"goal not answered by action {self.name} in {timeout_s} s") from error
        except ServerLostError as error:
            raise ActionServerLostError(f"goal not answered by action {self.name}: {error}") from error

    def send_goal_sync(
        self: ActionClient[Action[GoalT, Any, Any]],
        goal: GoalT,
        timeout_s: float | None = None,
        *,
        goal_id: bytes | None = None,
    ) -> ClientGoal[ActionT_co]:
        """`send_goal` for plain code: from a script without event loop, or from another thread than the loop's.

        The handle has `result_sync` and `cancel_sync`. Raises `WouldDeadlockError` inside the loop, else as
        `send_goal`.
        """
        coroutine: Coroutine[Any, Any, Any] = self.send_goal(goal, timeout_s, goal_id=goal_id)
        handle: ClientGoal[ActionT_co] = self._run_sync(coroutine)
        return handle

    def _run_sync(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine of this client from plain code; see `send_goal_sync`."""
        return self._scope.run_blocking(coroutine, f"a waiting call on action {self.name}", "'await'")

    # ------------------------------------------------------------------------------------------------------ result

    def _ask_result(self, progress: GoalProgress) -> None:
        request = self._type.cls.GetResult.Request()
        set_goal_id(request, progress.goal_id)

        def on_error(error: BaseException) -> None:
            self._goals.pop(progress.goal_id, None)
            progress.on_error(error)

        on_reply = partial(self._on_result, progress)
        self._result.ask(request, on_reply, on_error, lambda: progress.status.is_terminal)

    def _on_result(self, progress: GoalProgress, response: Any) -> None:
        self._feedback._deliver()  # what came before the result, and is perhaps not looked at before the next wait
        self._goals.pop(progress.goal_id, None)
        server, goal_id = f"action server {self.name}", progress.goal_id.hex()
        try:
            status = STATUSES.get(response.status)
            if status is GoalStatus.UNKNOWN:
                raise UnknownGoalError(f"{server} does not know goal {goal_id} any more")
            if status is None or not status.is_terminal:
                found = f"{response.status}" + (f" ({status.name})" if status else "")
                ends = ", ".join(f"{one} ({one.name})" for one in GoalStatus if one.is_terminal)
                raise ActionError(f"{server} sent a result of goal {goal_id} with status {found}; expected {ends}")
            progress.on_result(status, self._type.result.to_value(response.result))
        except Exception as error:
            progress.on_error(error)

    # ------------------------------------------------------------------------------------------------------ cancel

    async def cancel_goal(self, goal_id: bytes, timeout_s: float | None = None) -> None:
        """Ask to cancel one goal, which may be another client's; see `ClientGoal.cancel`.

        Raises:
            ActionArgumentError: no goal id. Else as `ClientGoal.cancel`.
        """
        goal_id = require_goal_id(goal_id)
        what = f"goal {goal_id.hex()}"
        deadline, delay_s = Deadline(timeout_s), FIRST_RETRY_DELAY_S
        left_s = timeout_s
        while True:
            try:
                canceled = await self._ask_cancel(goal_id, None, what, left_s)
                break
            except UnknownGoalError:
                left_s = deadline.remaining_s()
                if not self._is_early(goal_id) or (left_s is not None and left_s <= delay_s):
                    raise
            await asyncio.sleep(delay_s)
            delay_s, left_s = 2 * delay_s, deadline.remaining_s()
        if goal_id not in canceled:
            # rclpy servers answer 0 with an empty list when they refuse.
            raise CancelRejectedError(f"action server {self.name} refused to cancel {what}")

    def _is_early(self, goal_id: bytes) -> bool:
        """Return True if the server may not have registered the goal yet that it accepted; see `results.py`."""
        progress = self._goals.get(goal_id)
        if progress is None or progress.accepted_s is None:
            return False
        return self._scope.bridge.running_loop().time() - progress.accepted_s < REGISTRATION_TIMEOUT_S

    cancel_goal_sync = blocking(cancel_goal)

    async def cancel_all(self, timeout_s: float | None = None) -> list[bytes]:
        """Ask to cancel every goal of the server, other clients' too; returns the ids being cancelled.

        Raises:
            CancelRejectedError: there were goals, and the server refused for all of them.
            ActionTimeoutError, ActionServerLostError, ClosedError: as their names say.
        """
        return await self._ask_cancel(ZERO_ID, None, "any goal", timeout_s)

    cancel_all_sync = blocking(cancel_all)

    async def cancel_before(self, stamp: Time | SecNanosec, timeout_s: float | None = None) -> list[bytes]:
        """Ask to cancel every goal accepted at `stamp` or before; returns and raises as `cancel_all`.

        Raises:
            ActionArgumentError: `stamp` is zero, which would mean all. TypeError: it is no time.
        """
        return await self._ask_cancel(ZERO_ID, require_stamp(stamp), "any goal", timeout_s)

    cancel_before_sync = blocking(cancel_before)

    async def _ask_cancel(self, goal_id: bytes, stamp: Time | None, what: str, timeout_s: float | None) -> list[bytes]:
        request = CancelGoal_Request()
        set_goal_id(request.goal_info, goal_id)
        if stamp is not None:
            set_stamp(request.goal_info.stamp, stamp.nanoseconds)
        try:
            response = await self._cancel.call(request, timeout_s)
        except CallTimeoutError as error:
            raise ActionTimeoutError(f"cancel not answered by action {self.name}: {error}") from error
        except ServerLostError as error:
            raise ActionServerLostError(f"cancel not answered by action {self.name}: {error}") from error
        code = int(response.return_code)
        if code != CancelCode.NONE:
            kind, says = _CANCEL_ERRORS.get(code, (CancelError, f"answered with the unknown code {code} about"))
            raise kind(f"action server {self.name} {says} {what}")
        return [goal_id_of(info) for info in response.goals_canceling]

    # ------------------------------------------------------------------------------------------------------ topics

    def _on_feedback(self, message: Any) -> None:
        progress = self._goals.get(goal_id_of(message))
        if progress is not None:
            progress.feedback._push(self._type.feedback.to_value(message.feedback))

    def _on_status(self, data: bytes) -> None:
        for goal_id, progress in self._goals.items():
            status = find_status(data, goal_id)
            if status is not None:
                progress.on_status(status)

    def __repr__(self) -> str:
        return entity_repr(self, self.name, self.action_type, peers=lambda: len(self._send._servers()), peer="server")

    def close(self) -> None:
        """Let go of all goals: whoever waits gets `ClosedError`, feedback ends. May be called twice."""
        for progress in list(self._goals.values()):
            progress.on_error(ClosedError(f"the action client of {self.name} was closed"))
        self._goals.clear()
        super().close()
