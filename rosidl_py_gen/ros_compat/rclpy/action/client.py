"""Clients of actions."""

from __future__ import annotations

import threading
import time
import uuid
import weakref
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from unique_identifier_msgs.msg import UUID

from rclpy._classes import Subscriptable
from rclpy.executors import await_or_execute
from rclpy.impl.action_endpoints import ActionWaitable
from rclpy.impl.pending_requests import PendingRequests, wait_until_done
from rclpy.qos import QoSProfile, qos_profile_action_status_default, qos_profile_services_default
from rclpy.task import Future
from rclpy.type_support import check_for_type_support
from rclpy.waitable import NumberOfEntities, Waitable

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.callback_groups import CallbackGroup
    from rclpy.impl.pending_requests import ResponseFuture
    from rclpy.node import Node
    from rclpy.waitable import WaitSet

_FINAL_STATES = (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED)


class ClientGoalHandle(Subscriptable):
    """Goal to which a server has replied, whether the server accepted it or not."""

    def __init__(self, action_client: ActionClient, goal_id: Any, goal_response: Any) -> None:
        self._action_client = action_client
        self._goal_id = goal_id
        self._goal_response = goal_response
        self._status: int = GoalStatus.STATUS_UNKNOWN

    def __eq__(self, other: object) -> bool:
        return bool(self._goal_id == other.goal_id) if isinstance(other, ClientGoalHandle) else NotImplemented

    def __repr__(self) -> str:
        return f"ClientGoalHandle <id={self.goal_id.uuid}, accepted={self.accepted}, status={self.status}>"

    @property
    def goal_id(self) -> Any:
        """Id of the goal, a unique_identifier_msgs/UUID."""
        return self._goal_id

    @property
    def stamp(self) -> Any:
        """Time when the server accepted the goal, a builtin_interfaces/Time."""
        return self._goal_response.stamp

    @property
    def accepted(self) -> bool:
        return bool(self._goal_response.accepted)

    @property
    def status(self) -> int:
        """Status of the goal that the server published last, a number of action_msgs/GoalStatus."""
        return self._status

    def cancel_goal(self) -> Any:
        """Request to cancel the goal, and wait for the response, while an executor in another thread receives it."""
        return _wait_for_result(self.cancel_goal_async())

    def cancel_goal_async(self) -> Future[Any]:
        """Request to cancel the goal; return a future of the action_msgs/CancelGoal response."""
        return self._action_client._cancel_goal_async(self)

    def get_result(self) -> Any:
        """Wait for the result of the goal and return it, while an executor in another thread receives the response."""
        return _wait_for_result(self.get_result_async())

    def get_result_async(self) -> Future[Any]:
        """Return a future that is done when the goal ends: a response with `status` and `result`."""
        return self._action_client._get_result_async(self)


def _wait_for_result(future: Future[Any]) -> Any:
    wait_until_done(future)
    return future.result()


class ActionClient(ActionWaitable):
    """Client of an action; the executor of the node receives responses and feedback.

    Args:
        action_type: class such as `example_interfaces.action.Fibonacci`.
        action_name: name, expanded and remapped like the name of a topic.
        enable_feedback_msg_optimization: without effect; feedback for goals of other clients is always ignored here.
    """

    def __init__(
        self,
        node: Node,
        action_type: Any,
        action_name: str,
        *,
        callback_group: CallbackGroup | None = None,
        goal_service_qos_profile: QoSProfile = qos_profile_services_default,
        result_service_qos_profile: QoSProfile = qos_profile_services_default,
        cancel_service_qos_profile: QoSProfile = qos_profile_services_default,
        feedback_sub_qos_profile: QoSProfile = QoSProfile(depth=10),  # noqa: B008  # as in rclpy
        status_sub_qos_profile: QoSProfile = qos_profile_action_status_default,
        enable_feedback_msg_optimization: bool = False,
    ) -> None:
        super().__init__(node, action_type, action_name, callback_group, "action_client")
        self._action_name = action_name
        self._goal_handles: dict[bytes, weakref.ref[ClientGoalHandle]] = {}
        self._feedback_callbacks: dict[bytes, Callable[[Any], Any]] = {}
        self._rosidl_ended_goal_ids: list[bytes] = []
        impl = action_type.Impl
        with self._rosidl_endpoints.closing_on_error() as endpoints:
            create = endpoints.create
            clients = {
                "goal": create("client", impl.SendGoalService, "send_goal", goal_service_qos_profile),
                "result": create("client", impl.GetResultService, "get_result", result_service_qos_profile),
                "cancel": create("client", impl.CancelGoalService, "cancel_goal", cancel_service_qos_profile),
            }
            self._rosidl_feedback = create("subscription", impl.FeedbackMessage, "feedback", feedback_sub_qos_profile)
            self._rosidl_status = create("subscription", impl.GoalStatusMessage, "status", status_sub_qos_profile)
        self._rosidl_requests = {
            kind: PendingRequests(client, endpoints.context.notify) for kind, client in clients.items()
        }
        node.add_waitable(self)

    def is_ready(self, wait_set: WaitSet) -> bool:
        return (
            any(requests.responses for requests in self._rosidl_requests.values())
            or self._rosidl_feedback.is_ready
            or self._rosidl_status.is_ready
        )

    def take_data(self) -> dict[str, Any]:
        """Return a dict with one item of each arrived kind: ``goal``, ``cancel``, ``result``, ``feedback``, ``status``.

        Together with ``feedback``, the dict contains the function for it, ``callback``, if the goal has one.
        """
        callbacks = self._feedback_callbacks.copy()  # another thread may receive the result after this feedback
        with self._rosidl_endpoints:
            items: dict[str, Any] = {kind: one.take() for kind, one in self._rosidl_requests.items()}
            items |= {"feedback": self._rosidl_feedback.take(), "status": self._rosidl_status.take()}
        if items["feedback"] is not None:
            key = bytes(items["feedback"].goal_id.uuid)
            items["callback"] = callbacks.get(key, self._feedback_callbacks.get(key))
        return {kind: item for kind, item in items.items() if item is not None}

    async def execute(self, taken_data: dict[str, Any]) -> None:
        for kind in ("goal", "cancel", "result"):
            if kind in taken_data:
                self._rosidl_take_response(kind, *taken_data[kind])
        if "callback" in taken_data:
            await await_or_execute(taken_data["callback"], taken_data["feedback"])
        while self._rosidl_ended_goal_ids:  # not earlier, as feedback that arrived with the result has to be delivered
            with suppress(IndexError):  # another thread was faster
                self._feedback_callbacks.pop(self._rosidl_ended_goal_ids.pop(), None)
        if "status" in taken_data:
            self._rosidl_store_states(taken_data["status"].status_list)

    def _rosidl_take_response(
        self, kind: str, future: Future[Any] | None, goal_id: Any, response_future: ResponseFuture
    ) -> None:
        if future is None:
            text = "There may be more than one action server for the action"
            self._logger.warning(f"Ignoring unexpected {kind} response. {text} '{self._action_name}'")
            return
        error = response_future.exception()
        if error is not None:
            future.set_exception(error)
            return
        response = response_future.result()
        if kind == "goal":
            response = ClientGoalHandle(self, goal_id, response)
            if response.accepted:
                key = bytes(goal_id.uuid)
                if key in self._goal_handles:
                    raise RuntimeError(f"Two goals were accepted with the same ID ({response})")
                self._goal_handles[key] = weakref.ref(response)
        elif kind == "result":
            self._rosidl_ended_goal_ids.append(bytes(goal_id.uuid))
        future.set_result(response)

    def _rosidl_store_states(self, states: list[Any]) -> None:
        for state in states:
            key = bytes(state.goal_info.goal_id.uuid)
            goal = self._goal_handles.get(key, lambda: None)()
            if goal is not None:
                goal._status = state.status
            if goal is None or state.status in _FINAL_STATES:
                self._goal_handles.pop(key, None)

    def get_num_entities(self) -> NumberOfEntities:
        return NumberOfEntities(num_subs=2, num_clients=3)

    def send_goal(self, goal: Any, **kwargs: Any) -> Any:
        """Send a goal and wait for its result, while an executor in another thread receives it."""
        return _wait_for_result(self._get_result_async(_wait_for_result(self.send_goal_async(goal, **kwargs))))

    def send_goal_async(
        self, goal: Any, feedback_callback: Callable[[Any], Any] | None = None, goal_uuid: Any = None
    ) -> Future[Any]:
        """Send a goal, even if no server is available; return a future of a `ClientGoalHandle`.

        Args:
            goal: object of the action's class `Goal`.
            feedback_callback: function that is called with each feedback message, which has `feedback` and `goal_id`.
            goal_uuid: id of the goal, a unique_identifier_msgs/UUID. [default: a random id]

        Raises:
            TypeError: the goal is of another class.
        """
        self._rosidl_require(goal, self._action_type.Goal)
        request = self._action_type.Impl.SendGoalService.Request()
        request.goal_id = UUID(uuid=list(uuid.uuid4().bytes)) if goal_uuid is None else goal_uuid
        request.goal = goal
        if feedback_callback is not None:
            self._feedback_callbacks[bytes(request.goal_id.uuid)] = feedback_callback
        return self._rosidl_send("goal", request, request.goal_id)

    def _rosidl_send(self, kind: str, request: Any, goal_id: Any) -> Future[Any]:
        with self._rosidl_endpoints:
            future = self._rosidl_requests[kind].send(request, goal_id)
        self.add_future(future)
        future.add_done_callback(self.remove_future)
        return future

    @staticmethod
    def _rosidl_require(value: Any, expected: type) -> None:
        if not isinstance(value, expected):
            raise TypeError(f"Expected type {expected.__name__} but received {type(value)}")

    def _cancel_goal_async(self, goal_handle: ClientGoalHandle) -> Future[Any]:
        self._rosidl_require(goal_handle, ClientGoalHandle)
        request = CancelGoal.Request()
        request.goal_info.goal_id = goal_handle.goal_id
        return self._rosidl_send("cancel", request, goal_handle.goal_id)

    def _get_result_async(self, goal_handle: ClientGoalHandle) -> Future[Any]:
        self._rosidl_require(goal_handle, ClientGoalHandle)
        request = self._action_type.Impl.GetResultService.Request(goal_id=goal_handle.goal_id)
        return self._rosidl_send("result", request, goal_handle.goal_id)

    def server_is_ready(self) -> bool:
        """Return True if all endpoints of a server are connected; raise RCLError after a shutdown."""
        with self._rosidl_endpoints:
            self._rosidl_endpoints.context.require_ok()
            services = all(requests.client.service_is_available() for requests in self._rosidl_requests.values())
            return services and bool(self._rosidl_feedback.publisher_count and self._rosidl_status.publisher_count)

    def wait_for_server(self, timeout_sec: float | None = None) -> bool:
        """Wait until a server is connected; return False if the time has passed. No executor is needed."""
        return self._rosidl_endpoints.context.wait(self.server_is_ready, timeout_sec)
