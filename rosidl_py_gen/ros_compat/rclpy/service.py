"""Servers of services: the class `Service`, and the base class that it shares with asyncio nodes."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any, Awaitable, Callable, TypeVar

from rclpy._classes import Subscriptable
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock
from rclpy.handles import ServiceEntity
from rclpy.qos import QoSProfile
from rclpy.service_introspection import ServiceIntrospectionState
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.handles import Handle

SrvType = TypeVar("SrvType")
SrvTypeRequest = TypeVar("SrvTypeRequest")
SrvTypeResponse = TypeVar("SrvTypeResponse")
GenericServiceCallback = Callable[[Any, Any], Any]
AsyncGenericServiceCallback = Callable[[Any, Any], Awaitable[Any]]
ServiceCallbackUnion = GenericServiceCallback | AsyncGenericServiceCallback


class BaseService(Subscriptable, ServiceEntity[runtime.ServiceServer[Any, Any]]):
    """Server of a service; base class of `Service` and `rclpy.experimental.AsyncService`.

    Attributes:
        srv_type: class of the service.
        srv_name: name of the service as the program passed it.
        callback: function, plain or async, that takes the request and an empty response, and returns the response.
    """

    def __init__(
        self,
        service_impl: Handle[runtime.ServiceServer[Any, Any]],
        srv_type: Any,
        srv_name: str,
        callback: ServiceCallbackUnion,
        qos_profile: QoSProfile,
        *,
        on_destroy: Callable[[Any], None] | None = None,
    ) -> None:
        super().__init__(service_impl, srv_type, srv_name, qos_profile, on_destroy)
        self.callback = callback

    def send_response(self, response: Any, header: runtime.ServiceRequest[Any, Any]) -> None:
        """Send the response to a request; raise TypeError if it is of another class, or None."""
        if not isinstance(response, self.srv_type.Response):
            raise TypeError(f"Expected {self.srv_type.Response}, got {type(response)}")
        if not isinstance(header, runtime.ServiceRequest):
            raise TypeError(f"Expected the request that is answered, got {type(header)}")
        with self.handle.in_use(require_ok=False):
            header.respond(response)

    def rosidl_take_request(self) -> runtime.ServiceRequest[Any, Any] | None:
        with self._rosidl_handle as handle:
            return handle.entity.take()


class Service(BaseService):
    """Server of a service, created by `Node.create_service`."""

    rosidl_take_method = "_take_service"

    def __init__(
        self,
        service_impl: Handle[runtime.ServiceServer[Any, Any]],
        srv_type: Any,
        srv_name: str,
        callback: ServiceCallbackUnion,
        callback_group: CallbackGroup,
        qos_profile: QoSProfile,
    ) -> None:
        super().__init__(service_impl, srv_type, srv_name, callback, qos_profile)
        self.callback_group = callback_group
        self._executor_event = False

    def rosidl_take(self, executor: Executor) -> Callable[[], Any] | None:
        request = self.rosidl_take_request()
        if request is None:
            return None

        def serve() -> Any:
            response = self.callback(request.message, self.srv_type.Response())
            if inspect.isawaitable(response):
                return self._rosidl_send_awaited_response(response, request)
            self.send_response(response, request)
            return None

        return serve

    async def _rosidl_send_awaited_response(
        self, response: Awaitable[Any], request: runtime.ServiceRequest[Any, Any]
    ) -> None:
        self.send_response(await response, request)
