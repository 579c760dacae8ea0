"""Servers of actions."""

from __future__ import annotations

import contextlib
import functools
import itertools
import threading
import traceback
import weakref
from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, Any

from action_msgs.msg import GoalInfo, GoalStatus

from rclpy._rclpy_pybind11 import RCLError
from rclpy._subscriptable import Subscriptable
from rclpy.clock import Clock
from rclpy.executors import await_or_execute
from rclpy.impl.action_endpoints import ActionWaitable
from rclpy.qos import QoSProfile, qos_profile_action_status_default, qos_profile_services_default
from rclpy.task import Future
from rclpy.time import Time
from rclpy.type_support import check_for_type_support
from rclpy.waitable import NumberOfEntities, Waitable
from rosidl_py_gen import EncodeError, runtime
from rosidl_py_gen.runtime import _rclpy_support as rules

if TYPE_CHECKING:
    from rclpy.callback_groups import CallbackGroup
    from rclpy.node import Node
    from rclpy.waitable import WaitSet

GoalEvent = runtime.GoalEvent
_CANCELABLE = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)
# Return codes of action_msgs/CancelGoal.
_UNKNOWN_GOAL_ID = 2
_GOAL_TERMINATED = 3


class GoalResponse(Enum):
    """Decision of the goal callback of an action server."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """Decision of the cancel callback of an action server."""

    REJECT = 1
    ACCEPT = 2


class ServerGoalHandle(Subscriptable):
    """Goal that an action server has accepted.

    `succeed`, `abort` and `canceled` end the goal; its result is the value that the execute callback returns.
    """

    def __init__(self, action_server: ActionServer, goal_info: Any, goal_request: Any) -> None:
        self._action_server = action_server
        self._goal_info = goal_info
        self._goal_request = goal_request
        self._rosidl_status: runtime.GoalStatus = runtime.GoalStatus.ACCEPTED
        self._rosidl_is_destroyed = False
        self._lock = threading.RLock()

    def __eq__(self, other: object) -> bool:
        return bool(self.goal_id == other.goal_id) if isinstance(other, ServerGoalHandle) else NotImplemented

    @property
    def request(self) -> Any:
        """Goal that the client sent."""
        return self._goal_request

    @property
    def goal_id(self) -> Any:
        return self._goal_info.goal_id

    @property
    def is_active(self) -> bool:
        """True if the goal has not ended."""
        with self._lock:
            return not self._rosidl_is_destroyed and self._rosidl_status.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """True if a request to cancel the goal was accepted; then the execute callback should call `canceled`."""
        return self.status == runtime.GoalStatus.CANCELING

    @property
    def status(self) -> int:
        """Status of the goal, a number of action_msgs/GoalStatus; STATUS_UNKNOWN after `destroy`."""
        with self._lock:
            return int(runtime.GoalStatus.UNKNOWN if self._rosidl_is_destroyed else self._rosidl_status)

    def _update_state(self, event: runtime.GoalEvent) -> None:
        with self._lock:
            if self._rosidl_is_destroyed:
                return
            try:
                self._rosidl_status = runtime.next_goal_status(self._rosidl_status, event)
            except runtime.GoalTransitionError as error:
                raise RCLError(f"Failed to update goal state: {error}") from error
            has_ended = not self._rosidl_status.is_active
        self._action_server._rosidl_publish_status()
        if has_ended:
            self._action_server.notify_goal_done()

    def execute(self, execute_callback: Callable[[ServerGoalHandle], Any] | None = None) -> None:
        """Schedule the execution of the goal, with the given callback or the execute callback of the server."""
        if not self.is_cancel_requested:
            self.executing()
        self._action_server.notify_execute(self, execute_callback)

    def publish_feedback(self, feedback: Any) -> None:
        """Publish feedback of the goal; raise TypeError if it is not of the action's class `Feedback`."""
        expected = self._action_server.action_type.Feedback
        if not isinstance(feedback, expected):
            raise TypeError(f"Expected type {expected.__name__} but received {type(feedback)}")
        if not self._rosidl_is_destroyed:
            self._action_server._rosidl_publish_feedback(self.goal_id, feedback)

    def executing(self) -> None:
        """Mark the goal as executing, for servers without execute callback; raise RCLError in other states."""
        self._update_state(GoalEvent.EXECUTE)

    def succeed(self, response: Any = None) -> None:
        """End the goal as succeeded.

        Args:
            response: result of the goal. [default: the result that the execute callback returns]

        Raises:
            RCLError: the goal has ended, or does not execute.
        """
        self._rosidl_end(GoalEvent.SUCCEED, response)

    def abort(self, response: Any = None) -> None:
        self._rosidl_end(GoalEvent.ABORT, response)

    def canceled(self, response: Any = None) -> None:
        """End the goal as canceled, after a client requested it; raise RCLError if no client did."""
        self._rosidl_end(GoalEvent.CANCELED, response)

    def _rosidl_end(self, event: runtime.GoalEvent, response: Any) -> None:
        self._update_state(event)
        if response is not None:
            self._action_server._rosidl_set_result(self, response)

    def destroy(self) -> None:
        """Invalidate the goal: its status is unknown, and feedback is ignored."""
        with self._lock:
            self._rosidl_is_destroyed = True


def default_handle_accepted_callback(goal_handle: ServerGoalHandle) -> None:
    """Execute an accepted goal at once."""
    goal_handle.execute()


def default_goal_callback(goal_request: Any) -> GoalResponse:
    """Accept every goal."""
    return GoalResponse.ACCEPT


def default_cancel_callback(cancel_request: Any) -> CancelResponse:
    """Reject every request to cancel a goal."""
    return CancelResponse.REJECT


class ActionServer(ActionWaitable):
    """Server of an action; the executor of the node takes its requests and runs its callbacks.

    Args:
        action_type: class such as `example_interfaces.action.Fibonacci`.
        action_name: name, expanded and remapped like the name of a topic.
        execute_callback: function that takes a `ServerGoalHandle` and returns a result of the action; None if the
            program ends goals itself, for example with `ServerGoalHandle.succeed`.
        goal_callback: function that takes the goal and returns a `GoalResponse`.
        handle_accepted_callback: function that takes the `ServerGoalHandle` and executes the goal, now or later.
        cancel_callback: function that takes the `ServerGoalHandle` and returns a `CancelResponse`.
        result_timeout: seconds for which a result is retained after the end of its goal, at least 0.05.

    Raises:
        TypeError: `result_timeout` is not a number.
        ValueError: `result_timeout` is negative, not finite, or more than 292 years.
    """

    def __init__(
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        execute_callback: Callable[[ServerGoalHandle], Any] | None = None,
        *,
        callback_group: CallbackGroup | None = None,
        goal_callback: Callable[[Any], Any] | None = default_goal_callback,
        handle_accepted_callback: Callable[[ServerGoalHandle], Any] | None = default_handle_accepted_callback,
        cancel_callback: Callable[[ServerGoalHandle], Any] | None = default_cancel_callback,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_pub_qos_profile: QoSProfile = QoSProfile(depth=10),  # noqa: B008  # as in rclpy
        status_pub_qos_profile: QoSProfile = qos_profile_action_status_default,
        result_timeout: float = 900,
    ) -> None:
        self.register_handle_accepted_callback(handle_accepted_callback)
        self.register_goal_callback(goal_callback)
        self.register_cancel_callback(cancel_callback)
        self._execute_callback: Callable[[ServerGoalHandle], Any] | None = None
        if execute_callback is not None:
            self.register_execute_callback(execute_callback)
        super().__init__(node, action_type, action_name, callback_group, "action_server")
        self._rosidl_result_timeout_ns = _to_timeout_ns(result_timeout)
        self._goal_handles: dict[bytes, ServerGoalHandle] = {}
        self._result_futures: dict[bytes, Future[Any]] = {}
        self._rosidl_end_times_ns: dict[bytes, int] = {}
        """Goal id -> time from which its result is retained: the end of the goal or of its execute callback."""
        self._rosidl_executing: set[bytes] = set()
        """Ids of goals whose execute callbacks have not returned the result yet."""
        self._rosidl_has_expiry_timer = False
        impl = action_type.Impl
        with self._rosidl_endpoints.closing_on_error() as endpoints:
            create = endpoints.create
            self._rosidl_services = {
                "goal": create("service", impl.SendGoalService, "send_goal", goal_service_qos_profile),
                "cancel": create("service", impl.CancelGoalService, "cancel_goal", cancel_service_qos_profile),
                "result": create("service", impl.GetResultService, "get_result", result_service_qos_profile),
            }
            self._rosidl_feedback = create("publisher", impl.FeedbackMessage, "feedback", feedback_pub_qos_profile)
            self._rosidl_status = create("publisher", impl.GoalStatusMessage, "status", status_pub_qos_profile)
        node.add_waitable(self)

    @property
    def action_type(self) -> Any:
        return self._action_type

    async def _execute_goal_request(self, request: Any) -> None:
        goal_id = request.message.goal_id
        key = bytes(goal_id.uuid)
        info = GoalInfo(goal_id=goal_id)
        accepted = False
        if key not in self._goal_handles:
            decision = await await_or_execute(self._goal_callback, request.message.goal)
            accepted = decision == GoalResponse.ACCEPT
            if not isinstance(decision, GoalResponse):
                self._logger.warning("Goal request callback did not return a GoalResponse type. Rejecting goal.")
        if accepted:
            info.stamp = self._node.get_clock().now().to_msg()
            self._goal_handles[key] = ServerGoalHandle(self, info, request.message.goal)
            self._result_futures[key] = Future()
            self.add_future(self._result_futures[key])
        response = self._action_type.Impl.SendGoalService.Response(accepted=accepted, stamp=info.stamp)
        if not self._rosidl_respond(request, response, "goal") or not accepted:
            return
        self._rosidl_publish_status()
        await await_or_execute(self._handle_accepted_callback, self._goal_handles[key])

    def _rosidl_respond(self, request: Any, response: Any, kind: str) -> bool:
        try:
            with self._rosidl_endpoints:
                request.respond(response)
        except (RCLError, runtime.ClosedError):
            self._logger.warn(f"Failed to send {kind} response (the client may have gone away)")
            return False
        return True

    async def _execute_goal(self, execute_callback: Callable[[Any], Any], goal_handle: ServerGoalHandle) -> None:
        key = bytes(goal_handle.goal_id.uuid)
        self._rosidl_executing.add(key)
        try:
            await self._rosidl_execute_goal(execute_callback, goal_handle)
        finally:
            self._rosidl_executing.discard(key)
            self.notify_goal_done()

    async def _rosidl_execute_goal(self, execute_callback: Callable[[Any], Any], goal_handle: ServerGoalHandle) -> None:
        try:
            result = await await_or_execute(execute_callback, goal_handle)
        except Exception as error:
            result = self._action_type.Result()
            self._logger.error(f"Error raised in execute callback: {error}")
            traceback.print_exc()
        if goal_handle.is_active:
            self._logger.warning(f"Goal state not set, assuming aborted. Goal ID: {goal_handle.goal_id.uuid}")
            goal_handle.abort()
        self._rosidl_set_result(goal_handle, result)

    def _rosidl_set_result(self, goal_handle: ServerGoalHandle, result: Any) -> None:
        response = self._action_type.Impl.GetResultService.Response(status=goal_handle.status)
        response.result = self._rosidl_as_result(result)
        future = self._result_futures.get(bytes(goal_handle.goal_id.uuid))
        if future is not None and not future.done():  # None: it has expired
            future.set_result(response)

    def _rosidl_as_result(self, value: Any) -> Any:
        """Return the value of an execute callback as a result; if that is impossible, log it and return a default.

        As in rclpy, an object of another class is accepted if it has the fields of a result.
        """
        kind = self._action_type.Result
        if isinstance(value, kind):
            return value
        try:
            return kind(**{name: getattr(value, name) for name in kind.get_fields_and_field_types()})
        except Exception:
            text = f"execute callback: expected {kind.__name__}, got {type(value).__name__} {value!r:.100}"
            self._logger.error(f"{text}; a default result is sent")
            return kind()

    async def _execute_cancel_request(self, request: Any) -> None:
        response = self._action_type.Impl.CancelGoalService.Response()
        response.return_code, keys = self._rosidl_find_goals_to_cancel(request.message.goal_info)
        for key in keys:
            goal = self._goal_handles[key]
            if await await_or_execute(self._cancel_callback, goal) != CancelResponse.ACCEPT:
                continue
            with contextlib.suppress(RCLError):  # the goal ended during the callback
                goal._update_state(GoalEvent.CANCEL_GOAL)
                response.goals_canceling.append(goal._goal_info)
        self._rosidl_respond(request, response, "cancel")

    def _rosidl_find_goals_to_cancel(self, info: Any) -> tuple[int, list[bytes]]:
        """Return the return code and the goals of a cancel request: one goal, goals up to a time, or all goals."""
        requested_key, latest_stamp = bytes(info.goal_id.uuid), Time.from_msg(info.stamp)
        if any(requested_key) and latest_stamp.nanoseconds == 0:
            goal = self._goal_handles.get(requested_key)
            if goal is None:
                return _UNKNOWN_GOAL_ID, []
            return (0, [requested_key]) if goal.status in _CANCELABLE else (_GOAL_TERMINATED, [])

        def is_selected(key: bytes, goal: ServerGoalHandle) -> bool:
            is_early_enough = latest_stamp.nanoseconds == 0 or Time.from_msg(goal._goal_info.stamp) <= latest_stamp
            return goal.status in _CANCELABLE and (is_early_enough or key == requested_key)

        return 0, [key for key, goal in list(self._goal_handles.items()) if is_selected(key, goal)]

    async def _execute_get_result_request(self, request: Any) -> None:
        future = self._result_futures.get(bytes(request.message.goal_id.uuid))
        if future is None:
            response = self._action_type.Impl.GetResultService.Response(status=GoalStatus.STATUS_UNKNOWN)
            self._rosidl_respond(request, response, "result")
            return
        future.add_done_callback(partial(self._rosidl_send_result, request))

    def _rosidl_send_result(self, request: Any, future: Future[Any]) -> None:
        response: Any = future.result()
        try:
            self._rosidl_respond(request, response, "result")
        except EncodeError as error:
            self._logger.error(f"execute callback: {error}; a default result is sent")
            response.result = self._action_type.Result()
            self._rosidl_respond(request, response, "result")

    def _rosidl_publish_status(self) -> None:
        goals = list(self._goal_handles.values())
        states = [GoalStatus(goal_info=goal._goal_info, status=goal.status) for goal in goals]
        with self._rosidl_endpoints:
            self._rosidl_status.publish(self._action_type.Impl.GoalStatusMessage(status_list=states))

    def _rosidl_publish_feedback(self, goal_id: Any, feedback: Any) -> None:
        with self._rosidl_endpoints:
            self._rosidl_feedback.publish(self._action_type.Impl.FeedbackMessage(goal_id=goal_id, feedback=feedback))

    def _rosidl_find_expired_goals(self) -> list[bytes]:
        """Return the ids of the goals whose result timeout is over."""
        if not self._rosidl_end_times_ns:
            return []
        last_ns = self._node.get_clock().now().nanoseconds - self._rosidl_result_timeout_ns
        return [key for key, _ in itertools.takewhile(lambda end: end[1] <= last_ns, self._rosidl_end_times())]

    def _rosidl_end_times(self) -> list[tuple[bytes, int]]:
        return list(self._rosidl_end_times_ns.items())

    def _rosidl_schedule_expiry(self) -> None:
        """Start a timer that wakes up the executors when the next result expires. Thread: any."""
        ends = self._rosidl_end_times()
        if self._rosidl_has_expiry_timer or not ends:
            return
        delay_ns = ends[0][1] + self._rosidl_result_timeout_ns - self._node.get_clock().now().nanoseconds
        loop = self._rosidl_endpoints.context.loop_runner.loop
        wake = partial(_wake_for_expiry, weakref.ref(self))
        with contextlib.suppress(RuntimeError):  # the context is closed
            loop.call_soon_threadsafe(loop.call_later, max(delay_ns / 10**9, 0.0) + 0.001, wake)
            self._rosidl_has_expiry_timer = True

    def _rosidl_remove_goal(self, key: bytes) -> None:
        goal = self._goal_handles.pop(key, None)
        self._rosidl_end_times_ns.pop(key, None)
        if goal is not None:  # None: another thread has removed it
            goal.destroy()
            self.remove_future(self._result_futures.pop(key))

    def notify_goal_done(self) -> None:
        """Start the result timeout of goals that have ended, unless their execute callbacks still run."""
        now_ns = self._node.get_clock().now().nanoseconds
        for key, goal in list(self._goal_handles.items()):
            if not goal.is_active and key not in self._rosidl_executing:
                self._rosidl_end_times_ns.setdefault(key, now_ns)
        self._rosidl_schedule_expiry()
        self._rosidl_endpoints.context.notify()

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: Callable[[ServerGoalHandle], Any] | None
    ) -> None:
        """Schedule the execution of a goal.

        Args:
            goal_handle: accepted goal.
            execute_callback: function that executes the goal; None uses the registered function, and does nothing
                without one.

        Raises:
            RuntimeError: no executor serves the node.
        """
        callback = execute_callback or self._execute_callback
        if callback is None:
            return
        executor = self._node.executor
        if executor is None:
            raise RuntimeError("cannot execute the goal: the node of its server is not in an executor")
        executor.create_task(self._execute_goal, callback, goal_handle)

    def is_ready(self, wait_set: WaitSet) -> bool:
        has_request = any(service.is_ready for service in self._rosidl_services.values())
        return has_request or bool(self._rosidl_find_expired_goals())

    def take_data(self) -> dict[str, Any]:
        """Return a dict with one request of each kind (``goal``, ``cancel``, ``result``), and the ``expired`` goals."""
        with self._rosidl_endpoints:
            items = {kind: service.take() for kind, service in self._rosidl_services.items()}
        requests = {kind: request for kind, request in items.items() if request is not None}
        return requests | {"expired": self._rosidl_find_expired_goals()}

    async def execute(self, taken_data: dict[str, Any]) -> None:
        if "goal" in taken_data:
            await self._execute_goal_request(taken_data["goal"])
        if "cancel" in taken_data:
            await self._execute_cancel_request(taken_data["cancel"])
        if "result" in taken_data:
            await self._execute_get_result_request(taken_data["result"])
        for key in taken_data["expired"]:
            if key in self._goal_handles:
                self._rosidl_remove_goal(key)
        self._rosidl_schedule_expiry()

    def get_num_entities(self) -> NumberOfEntities:
        return NumberOfEntities(num_timers=1, num_services=3)

    def register_handle_accepted_callback(self, handle_accepted_callback: Callable[[Any], Any] | None) -> None:
        """Set the function that handles accepted goals; None executes each goal at once."""
        self._handle_accepted_callback = handle_accepted_callback or default_handle_accepted_callback

    def register_goal_callback(self, goal_callback: Callable[[Any], Any] | None) -> None:
        """Set the function that accepts or rejects goals; None accepts all goals."""
        self._goal_callback = goal_callback or default_goal_callback

    def register_cancel_callback(self, cancel_callback: Callable[[Any], Any] | None) -> None:
        """Set the function that accepts or rejects requests to cancel goals; None rejects all requests."""
        self._cancel_callback = cancel_callback or default_cancel_callback

    def register_execute_callback(self, execute_callback: Callable[[Any], Any]) -> None:
        """Set the function that executes goals; raise TypeError if it is not callable."""
        if not callable(execute_callback):
            raise TypeError("Failed to register goal execution callback: not callable")
        self._execute_callback = execute_callback

    def destroy(self) -> None:
        """Destroy the server and its goals."""
        for goal in list(self._goal_handles.values()):
            goal.destroy()
        for future in list(self._result_futures.values()):
            self.remove_future(future)
        super().destroy()


def _to_timeout_ns(result_timeout: float) -> int:
    """Return a result timeout in nanoseconds.

    Raises:
        TypeError: the timeout is not a number.
        ValueError: the timeout is negative, not finite, or more than 292 years.
    """
    if not isinstance(result_timeout, (int, float)):
        raise TypeError(f"result_timeout must be a number of seconds, got {result_timeout!r:.100}")
    if not -1e-9 < result_timeout < 2**63 / 10**9:  # rclpy ignores fractions of a nanosecond; false for nan
        raise ValueError(
            f"Failed to create action server: timer period must be non-negative: result_timeout is {result_timeout}; "
            f"expected 0 to {2**63 // 10**9} seconds"
        )
    return max(int(result_timeout * 10**9), rules.MIN_RESULT_RETENTION_NS)


def _wake_for_expiry(reference: weakref.ref[ActionServer]) -> None:
    """Make executors check an action server for expired results. Thread: loop."""
    server = reference()
    if server is not None:
        server._rosidl_has_expiry_timer = False
        server._rosidl_endpoints.context.notify()
