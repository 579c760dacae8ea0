"""Clients of services."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any, Dict, Optional, TypeVar

from rclpy._classes import Subscriptable
from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock
from rclpy.context import Context
from rclpy.entity_execution import is_in_callback_that_blocks
from rclpy.handles import ServiceEntity
from rclpy.impl.pending_requests import PendingRequests
from rclpy.qos import QoSProfile
from rclpy.service_introspection import ServiceIntrospectionState
from rclpy.task import Future
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.executors import Executor
    from rclpy.handles import Handle

_WARNING_AFTER_S = 5.0

SrvType = TypeVar("SrvType")
SrvTypeRequest = TypeVar("SrvTypeRequest")
SrvTypeResponse = TypeVar("SrvTypeResponse")


class BaseClient(Subscriptable, ServiceEntity[runtime.Client[Any, Any]]):
    """Client of a service; base class of `Client` and `rclpy.experimental.AsyncClient`.

    Attributes:
        srv_type: class of the service.
        srv_name: name of the service as the program passed it.
    """

    def __init__(
        self,
        context: Context,
        client_impl: Handle[runtime.Client[Any, Any]],
        srv_type: Any,
        srv_name: str,
        qos_profile: QoSProfile,
        *,
        on_destroy: Callable[[Any], None] | None = None,
    ) -> None:
        super().__init__(client_impl, srv_type, srv_name, qos_profile, on_destroy)
        self.context = context

    def service_is_ready(self) -> bool:
        """Return True if a server is connected.

        Raises:
            rosidl_py_gen.runtime.IncompatibleServiceError: servers exist, but this middleware can call none of them.
            RCLError: the context was shut down.
        """
        with self.handle.in_use() as client:
            return client.service_is_available()


class Client(BaseClient):
    """Client of a service, created by `Node.create_client`. The executor of its node receives the responses."""

    rosidl_take_method = "_take_client"

    def __init__(
        self,
        context: Context,
        client_impl: Handle[runtime.Client[Any, Any]],
        srv_type: Any,
        srv_name: str,
        qos_profile: QoSProfile,
        callback_group: CallbackGroup,
    ) -> None:
        super().__init__(context, client_impl, srv_type, srv_name, qos_profile)
        self.callback_group = callback_group
        self._executor_event = False
        self._rosidl_requests = requests = PendingRequests(client_impl.entity, client_impl.notify_arrival)
        self._pending_requests, self._lock = requests.futures, requests.lock
        client_impl.set_ready_check(lambda: bool(requests.responses))

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Send a request and wait for the response, while an executor in another thread receives it.

        A call from a callback needs a MultiThreadedExecutor, and a callback group of its own for the client.

        Returns:
            The response, or None if the time has passed.

        Raises:
            TypeError: the request is of another class.
        """
        event = threading.Event()
        future = self.call_async(request)
        future.add_done_callback(lambda _: event.set())
        if not future.done() and not self._rosidl_wait_for(event, timeout_sec):
            self.remove_pending_request(future)
        return future.result()

    def _rosidl_wait_for(self, event: threading.Event, timeout_sec: float | None) -> bool:
        """Wait until an event is set.

        Log a warning if a callback waits too long in the only thread that could set the event.
        """
        if timeout_sec is not None and timeout_sec <= _WARNING_AFTER_S:
            return event.wait(timeout_sec)
        if event.wait(_WARNING_AFTER_S):
            return True
        if is_in_callback_that_blocks(self):
            text = f"call of {self.srv_name} in a callback: its executor cannot receive the response before it ends"
            advice = "use `await client.call_async(request)` in an async callback"
            runtime.get_logger(self.logger_name).warning(f"{text}; {advice}")
        return event.wait(None if timeout_sec is None else timeout_sec - _WARNING_AFTER_S)

    def call_async(self, request: Any) -> Future[Any]:
        """Send a request and return a future of the response.

        Without a server, or after the context was shut down, the request is lost and the future stays pending.

        Raises:
            TypeError: the request is of another class.
            InvalidHandle: the client was destroyed.
        """
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"Expected {self.srv_type.Request}, got {type(request)}")
        with self.handle:
            try:
                return self._rosidl_requests.send(request)
            except runtime.ClosedError:
                return Future()

    def get_pending_request(self, sequence_number: int) -> Future[Any]:
        """Return the future of an unanswered request by its sequence number; raise KeyError for other numbers."""
        with self._lock:
            return self._pending_requests[sequence_number]

    def remove_pending_request(self, future: Future[Any]) -> None:
        """Discard the request of a future, so that its response is ignored."""
        self._rosidl_requests.discard(future)

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait until a server is connected; return False if the time has passed. No executor is needed.

        Raises:
            RCLError: the context is shut down, before or while waiting.
        """
        with self.handle as handle:
            return handle.context.wait(self.service_is_ready, timeout_sec)

    def rosidl_take(self, executor: Executor) -> Callable[[], Any] | None:
        item = self._rosidl_requests.take() if self._rosidl_handle.is_valid else None
        if item is None:
            return None
        future, _, response_future = item

        def finish() -> None:
            if future is None:  # removed or cancelled
                return
            future._set_executor(executor)
            error = response_future.exception()
            if error is None:
                future.set_result(response_future.result())
            else:
                future.set_exception(error)

        return finish
