"""Action clients: send goals, follow them, cancel them.

Decides that everything about a goal is remembered from before it is sent (feedback may overtake the acceptance) until
its result is in, that the result is asked for as soon as the goal is accepted, and what happens when the server goes
away: a server that comes back is asked again, one that stays away ends the goal with `ActionServerLost`.

Source: protocol.md 8.1, 8.4, 8.5.
"""

from __future__ import annotations

import asyncio
import uuid
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.msgs.action_msgs.srv import CancelGoal_Request
from rosidl_py_gen.runtime.action_handle import (
    ActionServerLost,
    ActionTimeoutError,
    AlreadyTerminated,
    CancelError,
    CancelRejected,
    ClientGoal,
    GoalRejected,
    UnknownGoal,
)
from rosidl_py_gen.runtime.action_types import goal_id_of, set_stamp
from rosidl_py_gen.runtime.client import Client, WouldDeadlockError
from rosidl_py_gen.runtime.ddsnames import request_name
from rosidl_py_gen.runtime.goal import ZERO_ID, CancelCode, GoalStatus
from rosidl_py_gen.runtime.message_types import raw_type
from rosidl_py_gen.runtime.qos import ACTION_STATUS, DEFAULT, SERVICES_DEFAULT
from rosidl_py_gen.runtime.request import CallTimeoutError
from rosidl_py_gen.runtime.status_rows import find_status
from rosidl_py_gen.runtime.subscription import Subscription
from rosidl_py_gen.runtime.time_values import Time

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime.action_types import ActionNames, ActionType
    from rosidl_py_gen.runtime.scope import Scope
    from rosidl_py_gen.runtime.time_values import SecNanosec

GoalT = TypeVar("GoalT")
ResultT = TypeVar("ResultT")
FeedbackT = TypeVar("FeedbackT")
T = TypeVar("T")

_LOOK_S = 0.5
"""How often the presence of the server is looked at while a result is awaited."""


class ActionClient(Generic[GoalT, ResultT, FeedbackT]):
    """Made by `create_action_client`."""

    def __init__(
        self,
        scope: Scope,
        action_type: ActionType[GoalT, ResultT, FeedbackT],
        names: ActionNames,
        run: Callable[[Coroutine[Any, Any, Any]], Any],
        *,
        feedback_depth: int,
        server_lost_after_s: float,
    ) -> None:
        self.name = names.action
        """Fully qualified name of the action."""
        self.action_type = action_type.ros_name
        """``pkg/action/Name``."""
        self._scope = scope
        self._type = action_type
        self._run = run
        self._closed = False
        self._feedback_depth = feedback_depth
        self._lost_after_s = server_lost_after_s
        self._goals: dict[bytes, ClientGoal[GoalT, ResultT, FeedbackT]] = {}
        self._waiting: dict[bytes, asyncio.Task[Any]] = {}
        self._interrupted: dict[bytes, str] = {}
        self._watcher: asyncio.Task[None] | None = None
        self._send: Client[Any, Any] = Client(scope, action_type.send_goal, names.send_goal, SERVICES_DEFAULT, run)
        self._cancel: Client[Any, Any] = Client(scope, action_type.cancel, names.cancel_goal, SERVICES_DEFAULT, run)
        self._result: Client[Any, Any] = Client(scope, action_type.get_result, names.get_result, SERVICES_DEFAULT, run)
        self._feedback: Subscription[Any] = Subscription(
            scope, action_type.feedback_message, names.feedback, self._on_feedback, DEFAULT
        )
        self._status: Subscription[bytes] = Subscription(
            scope, raw_type(action_type.status), names.status, self._on_status, ACTION_STATUS
        )

    # ------------------------------------------------------------------------------------------------ availability

    def server_is_available(self) -> bool:
        """Whether a server is connected: three services and both topics.

        Raises:
            ForeignServiceError: the only servers are Fast DDS ones.
            ClosedError: the client is closed.
        """
        services = (self._send, self._cancel, self._result)
        return all(client.service_is_available() for client in services) and all(
            topic.publisher_count > 0 for topic in (self._feedback, self._status)
        )

    async def wait_for_server(self, timeout_s: float | None = None) -> bool:
        """Wait until a server is connected; False when the time passed. Raises as `server_is_available`."""
        return await self._scope.wait_until(self.server_is_available, timeout_s, lambda: self._closed)

    # ------------------------------------------------------------------------------------------------------- goals

    async def send_goal(
        self, goal: GoalT, timeout_s: float | None = None, *, goal_id: bytes | None = None
    ) -> ClientGoal[GoalT, ResultT, FeedbackT]:
        """Send a goal and wait until it is accepted; a server that is not there yet is waited for.

        Args:
            goal_id: 16 bytes; None makes a random UUID.

        Raises:
            GoalRejected: the server does not want it.
            ActionTimeoutError: no answer in `timeout_s` seconds; a `TimeoutError`.
            EncodeError, TypeError: the goal does not fit its type. ForeignServiceError, ClosedError.
        """
        self._scope.require_open(self._closed, f"the action client of {self.name}")
        request = self._type.cls.SendGoal.Request()
        goal_id = uuid.uuid4().bytes if goal_id is None else goal_id
        request.goal_id.uuid = goal_id
        request.goal = self._type.goal.to_message(goal)
        handle: ClientGoal[GoalT, ResultT, FeedbackT] = ClientGoal(self, goal_id, goal, self._feedback_depth)
        self._goals[goal_id] = handle
        try:
            response = await self._send.call(request, timeout_s)
        except CallTimeoutError as error:
            del self._goals[goal_id]
            raise ActionTimeoutError(f"goal not answered by action {self.name}: {error}") from error
        except BaseException:
            self._goals.pop(goal_id, None)
            raise
        if not response.accepted:
            del self._goals[goal_id]
            raise GoalRejected(f"action server {self.name} rejected the goal {goal!r:.200}")
        handle.accepted(Time.from_msg(response.stamp))
        self._scope.start(self._await_result(handle))
        return handle

    def send_goal_sync(
        self, goal: GoalT, timeout_s: float | None = None, *, goal_id: bytes | None = None
    ) -> ClientGoal[GoalT, ResultT, FeedbackT]:
        """`send_goal` for plain code: from a script without event loop, or from another thread than the loop's.

        The handle has `result_sync` and `cancel_sync`. Raises `WouldDeadlockError` inside the loop, else as
        `send_goal`.
        """
        return self.run_sync(self.send_goal(goal, timeout_s, goal_id=goal_id))

    def run_sync(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine of this client from plain code; see `send_goal_sync`."""
        bridge = self._scope.bridge
        if bridge.in_loop_thread() or asyncio._get_running_loop() is not None:
            coroutine.close()
            raise WouldDeadlockError(
                f"a waiting call on action {self.name} from inside the event loop would wait for ever; use 'await' in "
                "an async function, or call it from another thread"
            )
        loop = bridge.loop
        if loop is not None and loop.is_running():
            return asyncio.run_coroutine_threadsafe(coroutine, loop).result()
        done: T = self._run(coroutine)
        return done

    # ------------------------------------------------------------------------------------------------------ result

    async def _await_result(self, handle: ClientGoal[GoalT, ResultT, FeedbackT]) -> None:
        try:
            response = await self._ask_result(handle.goal_id)
            # Feedback that came in the same batch is delivered first: another reader brings it.
            await asyncio.sleep(0)
            status = GoalStatus(int(response.status))
            if status is GoalStatus.UNKNOWN:
                raise UnknownGoal(f"action server {self.name} does not know goal {handle.goal_id.hex()} any more")
            handle.finished(status, self._type.result.to_value(response.result))
        except asyncio.CancelledError:
            handle.failed(ClosedError(f"the action client of {self.name} was closed"))
            raise
        except Exception as error:
            handle.failed(error)
        finally:
            self._goals.pop(handle.goal_id, None)

    async def _ask_result(self, goal_id: bytes) -> Any:
        """Ask until there is an answer; again when another server took the place of the first."""
        request = self._type.cls.GetResult.Request()
        request.goal_id.uuid = goal_id
        task = asyncio.current_task()
        assert task is not None
        self._waiting[goal_id] = task
        if self._watcher is None or self._watcher.done():
            self._watcher = self._scope.start(self._watch_server())
        try:
            while True:
                try:
                    return await self._result.call(request)
                except asyncio.CancelledError:
                    if goal_id not in self._interrupted:
                        raise
                    if self._interrupted.pop(goal_id) == "lost":
                        raise ActionServerLost(
                            f"action server {self.name} went away and did not come back in {self._lost_after_s} s; "
                            "the goal's result is lost"
                        ) from None
        finally:
            del self._waiting[goal_id]

    async def _watch_server(self) -> None:
        """While results are awaited, look at the server from time to time; one task for all goals."""
        loop = asyncio.get_running_loop()
        servers, gone_since = self._servers(), loop.time()
        while self._waiting and not self._closed:
            await asyncio.sleep(_LOOK_S)
            present = self._servers()
            if present - servers:
                self._interrupt("another")
            if present:
                servers, gone_since = present, loop.time()
            elif loop.time() - gone_since >= self._lost_after_s:
                self._interrupt("lost")

    def _interrupt(self, why: str) -> None:
        for goal_id, task in self._waiting.items():
            if goal_id not in self._interrupted:
                self._interrupted[goal_id] = why
                task.cancel()

    def _servers(self) -> frozenset[bytes]:
        topic = request_name(self._result.name)
        return frozenset(endpoint.info.guid for endpoint in self._scope.graph.on_topic(topic, writers=False))

    # ------------------------------------------------------------------------------------------------------ cancel

    async def cancel_goal(self, goal_id: bytes, timeout_s: float | None = None) -> None:
        """Ask to cancel one goal, which may be another client's; see `ClientGoal.cancel`."""
        code, canceling = await self._ask_cancel(goal_id, None, timeout_s)
        if code == CancelCode.UNKNOWN_GOAL_ID:
            raise UnknownGoal(f"action server {self.name} does not know goal {goal_id.hex()}")
        if code == CancelCode.GOAL_TERMINATED:
            raise AlreadyTerminated(
                f"goal {goal_id.hex()} of action {self.name} has ended or is being cancelled already"
            )
        # rclpy servers answer 0 with an empty list when they refuse.
        if code == CancelCode.REJECTED or (code == CancelCode.NONE and goal_id not in canceling):
            raise CancelRejected(f"action server {self.name} refused to cancel goal {goal_id.hex()}")
        if code != CancelCode.NONE:
            raise CancelError(f"action server {self.name} answered a cancel with the unknown code {code}")

    async def cancel_all(self, timeout_s: float | None = None) -> list[bytes]:
        """Ask to cancel every goal of the server, other clients' too; returns the ids being cancelled.

        Raises:
            CancelRejected: there were goals, and the server refused for all of them. ActionTimeoutError, ClosedError.
        """
        return await self._cancel_many(None, timeout_s)

    async def cancel_before(self, stamp: Time | SecNanosec, timeout_s: float | None = None) -> list[bytes]:
        """Ask to cancel every goal accepted at `stamp` or before; returns and raises as `cancel_all`."""
        moment = stamp if isinstance(stamp, Time) else Time.from_msg(stamp)
        return await self._cancel_many(moment, timeout_s)

    async def _cancel_many(self, stamp: Time | None, timeout_s: float | None) -> list[bytes]:
        code, canceling = await self._ask_cancel(ZERO_ID, stamp, timeout_s)
        if code == CancelCode.REJECTED:
            raise CancelRejected(f"action server {self.name} refused to cancel any goal")
        if code != CancelCode.NONE:
            raise CancelError(f"action server {self.name} answered a cancel with code {code}")
        return canceling

    async def _ask_cancel(self, goal_id: bytes, stamp: Time | None, timeout_s: float | None) -> tuple[int, list[bytes]]:
        request = CancelGoal_Request()
        request.goal_info.goal_id.uuid = goal_id  # type: ignore[assignment]  # bytes are welcome in a uint8 array
        if stamp is not None:
            set_stamp(request.goal_info, stamp.nanoseconds)
        try:
            response = await self._cancel.call(request, timeout_s)
        except CallTimeoutError as error:
            raise ActionTimeoutError(f"cancel not answered by action {self.name}: {error}") from error
        return int(response.return_code), [goal_id_of(info) for info in response.goals_canceling]

    # ------------------------------------------------------------------------------------------------------ topics

    def _on_feedback(self, message: Any) -> None:
        handle = self._goals.get(goal_id_of(message))
        if handle is not None:
            handle.feedback_arrived(self._type.feedback.to_value(message.feedback))

    def _on_status(self, data: bytes) -> None:
        for goal_id, handle in self._goals.items():
            status = find_status(data, goal_id)
            if status is not None:
                handle.status_arrived(status)

    def close(self) -> None:
        """Let go of all goals: whoever waits gets `ClosedError`, feedback ends. May be called twice."""
        if self._closed:
            return
        self._closed = True
        self._scope.disown(self)
        for handle in list(self._goals.values()):
            handle.failed(ClosedError(f"the action client of {self.name} was closed"))
        self._goals.clear()
        for endpoint in (self._send, self._cancel, self._result, self._feedback, self._status):
            endpoint.close()
