"""Services."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, Callable, TypeVar  # noqa: UP035

from rclpy.callback_groups import CallbackGroup as CallbackGroup
from rclpy.clock import Clock as Clock
from rclpy.qos import QoSProfile as QoSProfile
from rclpy.service_introspection import ServiceIntrospectionState as ServiceIntrospectionState
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Awaitable

    from rclpy.executors import Executor
    from rclpy.handles import Handle

SrvType = TypeVar("SrvType")
SrvTypeRequest = TypeVar("SrvTypeRequest")
SrvTypeResponse = TypeVar("SrvTypeResponse")


class Service:
    """Made by `Node.create_service`.

    Attributes:
        srv_type: the class of the service.
        srv_name: the name as it was written.
        callback: called with the request and an empty response, answers the response; plain or async.
    """

    def __init__(
        self,
        service_impl: Handle[runtime.ServiceServer[Any, Any]],
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        callback_group: CallbackGroup,
        qos_profile: QoSProfile,
    ) -> None:
        self._rosidl_service = service_impl
        self._rosidl_is_ready = service_impl.is_ready
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.callback = callback
        self.callback_group = callback_group
        self._executor_event = False
        self.qos_profile = qos_profile

    def send_response(self, response: Any, header: runtime.ServiceRequest[Any, Any]) -> None:
        """Answer a request; TypeError for a response of another class, None included."""
        if not isinstance(response, self.srv_type.Response):
            raise TypeError(f"Expected {self.srv_type.Response}, got {type(response)}")
        if not isinstance(header, runtime.ServiceRequest):
            raise TypeError(f"Expected the request that is answered, got {type(header)}")
        with self.handle.in_use():
            header.respond(response)

    def configure_introspection(
        self, clock: Clock, service_event_qos_profile: QoSProfile, introspection_state: ServiceIntrospectionState
    ) -> None:
        """Publish requests and responses on ``<service>/_service_event``, as far as the state says."""
        with self.handle.in_use() as service:
            profile = service_event_qos_profile.get_c_qos_profile()
            service.configure_introspection(
                clock.handle.clock, profile, runtime.IntrospectionState(int(introspection_state))
            )

    @property
    def handle(self) -> Handle[runtime.ServiceServer[Any, Any]]:
        """What a wait set takes."""
        return self._rosidl_service

    @property
    def service_name(self) -> str:
        """The name after expansion and remapping."""
        with self.handle.in_use() as service:
            return service.name

    @property
    def logger_name(self) -> str:
        """The name of the node's logger."""
        with self.handle as handle:
            return handle.logger_name

    def destroy(self) -> None:
        """End it; use `Node.destroy_service`."""
        self._rosidl_service.destroy_when_not_in_use()

    def _rosidl_take(self, executor: Executor) -> Callable[[], Any] | None:
        with self._rosidl_service as handle:
            request = handle.entity.take()
        if request is None:
            return None

        def serve() -> Any:
            response = self.callback(request.message, self.srv_type.Response())
            if inspect.isawaitable(response):
                return self._rosidl_answer_later(response, request)
            self.send_response(response, request)
            return None

        return serve

    async def _rosidl_answer_later(self, response: Awaitable[Any], request: runtime.ServiceRequest[Any, Any]) -> None:
        self.send_response(await response, request)
