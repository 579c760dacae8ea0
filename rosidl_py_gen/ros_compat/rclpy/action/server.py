"""Servers of actions."""

from __future__ import annotations

import contextlib
import functools  # noqa: F401
import threading  # noqa: F401
import traceback
from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, Any

from action_msgs.msg import GoalInfo, GoalStatus

from rclpy._rclpy_pybind11 import RCLError
from rclpy.action.server_goal import GoalEvent as GoalEvent
from rclpy.action.server_goal import ServerGoalHandle as ServerGoalHandle
from rclpy.clock import Clock
from rclpy.executors import await_or_execute
from rclpy.impl.action_endpoints import ActionWaitable
from rclpy.qos import QoSProfile, qos_profile_action_status_default, qos_profile_services_default
from rclpy.task import Future
from rclpy.time import Time
from rclpy.type_support import check_for_type_support as check_for_type_support
from rclpy.waitable import NumberOfEntities
from rclpy.waitable import Waitable as Waitable
from rosidl_py_gen import EncodeError, runtime

if TYPE_CHECKING:
    from rclpy.callback_groups import CallbackGroup
    from rclpy.node import Node
    from rclpy.waitable import WaitSet

_CANCELABLE = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)
_UNKNOWN_GOAL_ID, _GOAL_TERMINATED = 2, 3
"""Of action_msgs/CancelGoal."""


class GoalResponse(Enum):
    """What a goal callback decides."""

    REJECT = 1
    ACCEPT = 2


class CancelResponse(Enum):
    """What a cancel callback decides."""

    REJECT = 1
    ACCEPT = 2


def default_handle_accepted_callback(goal_handle: ServerGoalHandle) -> None:
    """Execute it now."""
    goal_handle.execute()


def default_goal_callback(goal_request: Any) -> GoalResponse:
    """Accept all."""
    return GoalResponse.ACCEPT


def default_cancel_callback(cancel_request: Any) -> CancelResponse:
    """Cancel none."""
    return CancelResponse.REJECT


class ActionServer(ActionWaitable):
    """Serves an action; the executor of the node takes requests and runs the callbacks.

    Args:
        node: it belongs to.
        action_type: a class such as `example_interfaces.action.Fibonacci`.
        action_name: expanded and remapped as names of topics are.
        execute_callback: called with a `ServerGoalHandle`; answers a result of the action.
        callback_group: None means that of the node.
        goal_callback: called with the goal; answers a `GoalResponse`.
        handle_accepted_callback: called with the `ServerGoalHandle`, to execute it now or later.
        cancel_callback: called with the `ServerGoalHandle`; answers a `CancelResponse`.
        goal_service_qos_profile: of that service, as the following two.
        result_service_qos_profile: by default as other services.
        cancel_service_qos_profile: by default as other services.
        feedback_pub_qos_profile: of the topic of feedback.
        status_pub_qos_profile: of the topic of states, whose last message waits for those who come late.
        result_timeout: seconds for which the result of a goal that ended is kept; negative for ever.
    """

    def __init__(
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        execute_callback: Callable[[ServerGoalHandle], Any],
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
        self.register_execute_callback(execute_callback)
        super().__init__(node, action_type, action_name, callback_group, "action_server")
        self._rosidl_result_timeout_ns = int(result_timeout * 10**9)
        self._goal_handles: dict[bytes, ServerGoalHandle] = {}
        self._result_futures: dict[bytes, Future[Any]] = {}
        self._rosidl_ended_ns: dict[bytes, int] = {}
        impl = action_type.Impl
        with self._rosidl_endpoints.under_construction() as made:
            goal, cancel, result = goal_service_qos_profile, cancel_service_qos_profile, result_service_qos_profile
            self._rosidl_services = {
                "goal": made.service(impl.SendGoalService, "send_goal", goal.get_c_qos_profile()),
                "cancel": made.service(impl.CancelGoalService, "cancel_goal", cancel.get_c_qos_profile()),
                "result": made.service(impl.GetResultService, "get_result", result.get_c_qos_profile()),
            }
            feedback_qos, status_qos = feedback_pub_qos_profile, status_pub_qos_profile
            self._rosidl_feedback = made.publisher(impl.FeedbackMessage, "feedback", feedback_qos.get_c_qos_profile())
            self._rosidl_status = made.publisher(impl.GoalStatusMessage, "status", status_qos.get_c_qos_profile())
        node.add_waitable(self)

    @property
    def action_type(self) -> Any:
        """The class of the action."""
        return self._action_type

    # ------------------------------------------------------------------------------------------------------- goals

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
            info.stamp = self._rosidl_clock().now().to_msg()
            self._goal_handles[key] = ServerGoalHandle(self, info, request.message.goal)
            self._result_futures[key] = Future()
            self.add_future(self._result_futures[key])
        response = self._action_type.Impl.SendGoalService.Response(accepted=accepted, stamp=info.stamp)
        if not self._rosidl_respond(request, response, "goal") or not accepted:
            return
        self._rosidl_publish_status()
        await await_or_execute(self._handle_accepted_callback, self._goal_handles[key])

    def _rosidl_clock(self) -> Clock:
        return self._node.get_clock()

    def _rosidl_respond(self, request: Any, response: Any, what: str) -> bool:
        try:
            with self._rosidl_endpoints:
                request.respond(response)
        except (RCLError, runtime.ClosedError):
            self._logger.warn(f"Failed to send {what} response (the client may have gone away)")
            return False
        return True

    async def _execute_goal(self, execute_callback: Callable[[Any], Any], goal_handle: ServerGoalHandle) -> None:
        try:
            result = await await_or_execute(execute_callback, goal_handle)
        except Exception as error:
            result = self._action_type.Result()
            self._logger.error(f"Error raised in execute callback: {error}")
            traceback.print_exc()
        if goal_handle.is_active:
            self._logger.warning(f"Goal state not set, assuming aborted. Goal ID: {goal_handle.goal_id.uuid}")
            goal_handle.abort()
        response = self._action_type.Impl.GetResultService.Response(status=goal_handle.status)
        response.result = self._rosidl_as_result(result)
        future = self._result_futures.get(bytes(goal_handle.goal_id.uuid))
        if future is not None:  # else it expired already
            future.set_result(response)

    def _rosidl_as_result(self, answer: Any) -> Any:
        """Return what an execute callback answered; a default result, and an error in the log, when it is no result.

        As in rclpy a message of another class is taken when it has the fields of a result.
        """
        kind = self._action_type.Result
        if isinstance(answer, kind):
            return answer
        try:
            return kind(**{name: getattr(answer, name) for name in kind.get_fields_and_field_types()})
        except Exception:
            found = f"{type(answer).__name__} {answer!r:.100}"
            self._logger.error(f"execute callback: returned {found}, expected {kind.__name__}; a default one is sent")
            return kind()

    async def _execute_cancel_request(self, request: Any) -> None:
        response = self._action_type.Impl.CancelGoalService.Response()
        response.return_code, chosen = self._rosidl_chosen_for_cancel(request.message.goal_info)
        for key in chosen:
            goal = self._goal_handles[key]
            if await await_or_execute(self._cancel_callback, goal) != CancelResponse.ACCEPT:
                continue
            with contextlib.suppress(RCLError):  # it ended meanwhile
                goal._update_state(GoalEvent.CANCEL_GOAL)
                response.goals_canceling.append(goal._goal_info)
        self._rosidl_respond(request, response, "cancel")

    def _rosidl_chosen_for_cancel(self, info: Any) -> tuple[int, list[bytes]]:
        """Return code, and the goals that a request is about: one, those up to a time, or all."""
        named, until = bytes(info.goal_id.uuid), Time.from_msg(info.stamp)
        if any(named) and until.nanoseconds == 0:
            goal = self._goal_handles.get(named)
            if goal is None:
                return _UNKNOWN_GOAL_ID, []
            return (0, [named]) if goal.status in _CANCELABLE else (_GOAL_TERMINATED, [])

        def is_meant(key: bytes, goal: ServerGoalHandle) -> bool:
            early = until.nanoseconds == 0 or Time.from_msg(goal._goal_info.stamp) <= until
            return goal.status in _CANCELABLE and (early or key == named)

        return 0, [key for key, goal in list(self._goal_handles.items()) if is_meant(key, goal)]

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
        states = [GoalStatus(goal_info=one._goal_info, status=one.status) for one in list(self._goal_handles.values())]
        with self._rosidl_endpoints:
            self._rosidl_status.publish(self._action_type.Impl.GoalStatusMessage(status_list=states))

    def _rosidl_publish_feedback(self, goal_id: Any, feedback: Any) -> None:
        with self._rosidl_endpoints:
            self._rosidl_feedback.publish(self._action_type.Impl.FeedbackMessage(goal_id=goal_id, feedback=feedback))

    def _rosidl_expired(self) -> list[bytes]:
        """Goals whose result was kept long enough."""
        if self._rosidl_result_timeout_ns < 0:
            return []
        last_ns = self._rosidl_clock().now().nanoseconds - self._rosidl_result_timeout_ns
        return [key for key, ended_ns in list(self._rosidl_ended_ns.items()) if ended_ns <= last_ns]

    def _rosidl_forget(self, key: bytes) -> None:
        goal = self._goal_handles.pop(key, None)
        self._rosidl_ended_ns.pop(key, None)
        if goal is not None:  # otherwise another thread was faster
            goal.destroy()
            self.remove_future(self._result_futures.pop(key))

    def notify_goal_done(self) -> None:
        """Note which goals ended: their time runs from now on."""
        now_ns = self._rosidl_clock().now().nanoseconds
        for key, goal in list(self._goal_handles.items()):
            if not goal.is_active:
                self._rosidl_ended_ns.setdefault(key, now_ns)
        self._rosidl_endpoints.context.notify()

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: Callable[[ServerGoalHandle], Any] | None
    ) -> None:
        """Have the node's executor execute a goal, by this callback or the registered one."""
        executor = self._node.executor
        if executor is None:
            raise RuntimeError("a goal can only be executed while the node of its server is in an executor")
        executor.create_task(self._execute_goal, execute_callback or self._execute_callback, goal_handle)

    # ---------------------------------------------------------------------------------------------------- waitable

    def is_ready(self, wait_set: WaitSet) -> bool:
        """Whether a request came, or a result expired."""
        return any(service.is_ready for service in self._rosidl_services.values()) or bool(self._rosidl_expired())

    def take_data(self) -> dict[str, Any]:
        """One request of each kind that came: ``goal``, ``cancel``, ``result``; and ``expired``."""
        with self._rosidl_endpoints:
            taken = {kind: service.take() for kind, service in self._rosidl_services.items()}
        return {kind: one for kind, one in taken.items() if one is not None} | {"expired": self._rosidl_expired()}

    async def execute(self, taken_data: dict[str, Any]) -> None:
        """Decide, answer and forget."""
        if "goal" in taken_data:
            await self._execute_goal_request(taken_data["goal"])
        if "cancel" in taken_data:
            await self._execute_cancel_request(taken_data["cancel"])
        if "result" in taken_data:
            await self._execute_get_result_request(taken_data["result"])
        for key in taken_data["expired"]:
            if key in self._goal_handles:
                self._rosidl_forget(key)

    def get_num_entities(self) -> NumberOfEntities:
        """Three services, and the timer of expiry."""
        return NumberOfEntities(num_timers=1, num_services=3)

    # --------------------------------------------------------------------------------------------------- callbacks

    def register_handle_accepted_callback(self, handle_accepted_callback: Callable[[Any], Any] | None) -> None:
        """What is done with accepted goals; None executes them."""
        self._handle_accepted_callback = handle_accepted_callback or default_handle_accepted_callback

    def register_goal_callback(self, goal_callback: Callable[[Any], Any] | None) -> None:
        """What decides on goals; None accepts all."""
        self._goal_callback = goal_callback or default_goal_callback

    def register_cancel_callback(self, cancel_callback: Callable[[Any], Any] | None) -> None:
        """What decides on cancelling; None refuses all."""
        self._cancel_callback = cancel_callback or default_cancel_callback

    def register_execute_callback(self, execute_callback: Callable[[Any], Any]) -> None:
        """What executes goals; TypeError for what cannot be called."""
        if not callable(execute_callback):
            raise TypeError("Failed to register goal execution callback: not callable")
        self._execute_callback = execute_callback

    def destroy(self) -> None:
        """End it, and forget its goals."""
        for goal in list(self._goal_handles.values()):
            goal.destroy()
        for future in list(self._result_futures.values()):
            self.remove_future(future)
        super().destroy()
