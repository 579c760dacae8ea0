"""Services of asyncio nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.executors import await_or_execute
from rclpy.impl.async_entities import Arrivals, EntityTask, call_for_each
from rclpy.service import BaseService

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.handles import Handle
    from rclpy.qos import QoSProfile
    from rclpy.service import ServiceCallbackUnion
    from rosidl_py_gen import runtime


class AsyncService(BaseService):
    """Server of a service, created by `AsyncNode.create_service`."""

    def __init__(
        self,
        service_impl: Handle[runtime.ServiceServer[Any, Any]],
        srv_type: Any,
        srv_name: str,
        callback: ServiceCallbackUnion,
        qos_profile: QoSProfile,
        on_destroy: Callable[[AsyncService], None],
        concurrent: bool = False,
        tg: Any = None,
    ) -> None:
        super().__init__(service_impl, srv_type, srv_name, callback, qos_profile, on_destroy=on_destroy)
        self._rosidl_is_concurrent = concurrent
        self._rosidl_arrivals = Arrivals(service_impl, self.rosidl_take_request)
        self.rosidl_task = EntityTask(self._rosidl_run, self.destroy, tg)

    def destroy(self) -> None:
        """Destroy the service, and cancel the running callback, whose request gets no response."""
        self.rosidl_task.cancel()
        super().destroy()

    async def _rosidl_run(self) -> None:
        await call_for_each(self._rosidl_arrivals.items(), self._rosidl_serve, concurrent=self._rosidl_is_concurrent)

    async def _rosidl_serve(self, request: runtime.ServiceRequest[Any, Any]) -> None:
        response = await await_or_execute(self.callback, request.message, self.srv_type.Response())
        self.send_response(response, request)
