"""Servers of actions."""

from __future__ import annotations

import contextlib
import functools
import threading
import traceback
import weakref
from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, Any

from action_msgs.msg import GoalInfo, GoalStatus

from rclpy._classes import Subscriptable
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock import Clock
from rclpy.executors import await_or_execute
from rclpy.impl.action_endpoints import ActionWaitable
from rclpy.qos import QoSProfile, qos_profile_action_status_default, qos_profile_services_default
from rclpy.task import Future
from rclpy.type_support import check_for_type_support
from rclpy.waitable import NumberOfEntities, Waitable
from rosidl_py_gen import EncodeError, runtime
from rosidl_py_gen.runtime import _rclpy_support as rules

if TYPE_CHECKING:
    from rclpy.callback_groups import CallbackGroup
    from rclpy.node import Node
    from rclpy.waitable import WaitSet

GoalEvent = runtime.GoalEvent


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

    `succeed`, `abort` and `canceled` end the goal; its result is the value that the execute callback returns. The
    status of the goal is in the `GoalTable` of the server.

    Raises:
        RCLError: the server has a goal with the same id.
    """

    def __init__(self, action_server: ActionServer, goal_info: Any, goal_request: Any) -> None:
        self._action_server = action_server
        self._goal_info = goal_info
        self._goal_request = goal_request
        self._rosidl_key = bytes(goal_info.goal_id.uuid)
        self._rosidl_is_destroyed = False
        with action_server._lock:
            if action_server._rosidl_goals.accept(self._rosidl_key, _nanoseconds(goal_info.stamp)) is None:
                raise RCLError(f"Failed to accept goal: goal {self._rosidl_key.hex()} exists already")

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
        return self._rosidl_status.is_active

    @property
    def is_cancel_requested(self) -> bool:
        """True if a request to cancel the goal was accepted; then the execute callback should call `canceled`."""
        return self.status == runtime.GoalStatus.CANCELING

    @property
    def status(self) -> int:
        """Status of the goal, a number of action_msgs/GoalStatus; STATUS_UNKNOWN after `destroy`."""
        return int(self._rosidl_status)

    @property
    def _rosidl_status(self) -> runtime.GoalStatus:
        with self._action_server._lock:  # another goal may get the id of a destroyed one
            goals = self._action_server._rosidl_goals
            return runtime.GoalStatus.UNKNOWN if self._rosidl_is_destroyed else goals.status(self._rosidl_key)

    def _update_state(self, event: runtime.GoalEvent) -> None:
        server = self._action_server
        with server._lock:
            if self._rosidl_is_destroyed:
                return
            try:
                status = server._rosidl_goals.apply(self._rosidl_key, event)
            except (runtime.GoalTransitionError, runtime.UnknownGoalError) as error:
                raise RCLError(f"Failed to update goal state: {error}") from error
        server._rosidl_publish_status()
        if status.is_terminal:
            server._rosidl_retain(self)
            server.notify_goal_done()

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
        """Invalidate the goal: its status is unknown, and feedback is ignored. The server still sends its result."""
        if self._rosidl_invalidate():
            self._action_server._rosidl_retain(self)

    def _rosidl_invalidate(self) -> bool:
        """Make the status unknown; return False if it was before."""
        with self._action_server._lock:
            if self._rosidl_is_destroyed:
                return False
            self._rosidl_is_destroyed = True
            self._action_server._rosidl_goals.forget_status(self._rosidl_key)
            return True


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
        self._lock = threading.RLock()
        self._rosidl_goals: rules.GoalTable[None] = rules.GoalTable(_to_timeout_ns(result_timeout), rules.RCLPY_RULES)
        """States of the goals. Lock: _lock must be held. The results are in the futures."""
        self._rosidl_publishing_lock = threading.RLock()
        """Lock for publishing the states: the messages are sent in the order of the changes."""
        self._goal_handles: dict[bytes, ServerGoalHandle] = {}
        self._result_futures: dict[bytes, Future[Any]] = {}
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
        if key not in self._rosidl_goals:
            decision = await await_or_execute(self._goal_callback, request.message.goal)
            accepted = decision == GoalResponse.ACCEPT
            if not isinstance(decision, GoalResponse):
                self._logger.warning("Goal request callback did not return a GoalResponse type. Rejecting goal.")
        if accepted:
            info.stamp = self._node.get_clock().now().to_msg()
            try:
                goal = ServerGoalHandle(self, info, request.message.goal)
            except RCLError as error:  # a request with the same id was accepted during the callback
                self._logger.error(str(error))
                accepted = False
            else:
                self._goal_handles[key] = goal
                self._result_futures[key] = Future()
                self.add_future(self._result_futures[key])
        response = self._action_type.Impl.SendGoalService.Response(accepted=accepted, stamp=info.stamp)
        if not self._rosidl_respond(request, response, "goal") or not accepted:
            return
        self._rosidl_publish_status()
        await await_or_execute(self._handle_accepted_callback, goal)

    def _rosidl_respond(self, request: Any, response: Any, kind: str) -> bool:
        try:
            with self._rosidl_endpoints.in_use():
                request.respond(response)
        except RCLError:
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
            self._rosidl_retain(goal_handle)
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
        info = request.message.goal_info
        with self._lock:
            selection = self._rosidl_goals.select_for_cancel(bytes(info.goal_id.uuid), _nanoseconds(info.stamp))
        canceled = []
        for one in selection.goals:
            goal = self._goal_handles.get(one.goal_id)  # None: the program made the handle, or the result has expired
            if goal is None or await await_or_execute(self._cancel_callback, goal) != CancelResponse.ACCEPT:
                continue
            with contextlib.suppress(RCLError):  # the goal ended during the callback
                goal._update_state(GoalEvent.CANCEL_GOAL)
                canceled.append(goal._goal_info)
        code = self._rosidl_goals.cancel_code(selection, any_canceled=bool(canceled))
        response = self._action_type.Impl.CancelGoalService.Response(return_code=int(code), goals_canceling=canceled)
        self._rosidl_respond(request, response, "cancel")

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
        with self._rosidl_endpoints.in_use(), self._rosidl_publishing_lock:
            with self._lock:
                states = self._rosidl_goals.status_message()
            self._rosidl_status.publish_raw(states)

    def _rosidl_publish_feedback(self, goal_id: Any, feedback: Any) -> None:
        with self._rosidl_endpoints.in_use():
            self._rosidl_feedback.publish(self._action_type.Impl.FeedbackMessage(goal_id=goal_id, feedback=feedback))

    def _rosidl_expire_goals(self) -> None:
        """Destroy the goals whose result timeout is over."""
        with self._lock:
            for key in self._rosidl_goals.expire(self._rosidl_now_ns()):
                goal = self._goal_handles.pop(key, None)
                if goal is not None:  # None: the program made the handle
                    goal._rosidl_is_destroyed = True
                    self.remove_future(self._result_futures.pop(key))

    def _rosidl_has_expired_goal(self) -> bool:
        with self._lock:
            due_ns = self._rosidl_goals.next_expiry_ns()
        return due_ns is not None and due_ns <= self._rosidl_now_ns()

    def _rosidl_now_ns(self) -> int:
        return self._node.get_clock().now().nanoseconds

    def _rosidl_schedule_expiry(self) -> None:
        """Start a timer that wakes up the executors when the next result expires. Thread: any."""
        with self._lock:
            due_ns = self._rosidl_goals.next_expiry_ns()
        if self._rosidl_has_expiry_timer or due_ns is None:
            return
        delay_ns = due_ns - self._rosidl_now_ns()
        loop = self._rosidl_endpoints.context.loop_runner.loop
        wake = partial(_wake_for_expiry, weakref.ref(self))
        with contextlib.suppress(RuntimeError):  # the context is closed
            loop.call_soon_threadsafe(loop.call_later, max(delay_ns / 10**9, 0.0) + 0.001, wake)
            self._rosidl_has_expiry_timer = True

    def _rosidl_on_expiry_timer(self) -> None:
        self._rosidl_has_expiry_timer = False
        self._rosidl_endpoints.context.notify()

    def _rosidl_retain(self, goal: ServerGoalHandle) -> None:
        """Start the result timeout of a goal that has ended or is destroyed, unless its execute callback still runs."""
        now_ns = self._rosidl_now_ns()
        with self._lock:
            if not goal.is_active and goal._rosidl_key not in self._rosidl_executing:
                self._rosidl_goals.retain(goal._rosidl_key, None, now_ns)

    def notify_goal_done(self) -> None:
        """Make executors check for expired results again, because a goal has ended."""
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
        return has_request or self._rosidl_has_expired_goal()

    def take_data(self) -> dict[str, Any]:
        """Return a dict with one request of each kind that arrived: ``goal``, ``cancel``, ``result``."""
        with self._rosidl_endpoints:
            items = {kind: service.take() for kind, service in self._rosidl_services.items()}
        return {kind: request for kind, request in items.items() if request is not None}

    async def execute(self, taken_data: dict[str, Any]) -> None:
        if "goal" in taken_data:
            await self._execute_goal_request(taken_data["goal"])
        if "cancel" in taken_data:
            await self._execute_cancel_request(taken_data["cancel"])
        if "result" in taken_data:
            await self._execute_get_result_request(taken_data["result"])
        self._rosidl_expire_goals()  # not earlier, as the request may be for a result that expires now
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
            goal._rosidl_invalidate()
        for future in list(self._result_futures.values()):
            self.remove_future(future)
        super().destroy()


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


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
        server._rosidl_on_expiry_timer()
