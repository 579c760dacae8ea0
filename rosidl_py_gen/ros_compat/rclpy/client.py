"""Clients of services."""

from __future__ import annotations

import itertools
import threading
import time  # noqa: F401
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any, Dict, Optional, TypeVar  # noqa: F401, UP035

from rclpy.callback_groups import CallbackGroup as CallbackGroup
from rclpy.clock import Clock as Clock
from rclpy.context import Context as Context
from rclpy.entity_execution import is_in_callback_that_blocks
from rclpy.impl.entities import ServiceEntity
from rclpy.qos import QoSProfile as QoSProfile
from rclpy.service_introspection import ServiceIntrospectionState as ServiceIntrospectionState
from rclpy.task import Future
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    import concurrent.futures
    from collections.abc import Callable

    from rclpy.executors import Executor
    from rclpy.handles import Handle

_WARNING_AFTER_S = 5.0

SrvType = TypeVar("SrvType")
SrvTypeRequest = TypeVar("SrvTypeRequest")
SrvTypeResponse = TypeVar("SrvTypeResponse")


class Client(ServiceEntity[runtime.Client[Any, Any]]):
    """Client of a service, created by `Node.create_client`. The executor of its node receives the responses.

    Attributes:
        srv_type: class of the service.
        srv_name: name as it was passed.
    """

    def __init__(
        self,
        context: Context,
        client_impl: Handle[runtime.Client[Any, Any]],
        srv_type: Any,
        srv_name: str,
        qos_profile: QoSProfile,
        callback_group: CallbackGroup,
    ) -> None:
        super().__init__(client_impl)
        self.context = context
        self._rosidl_is_ready = client_impl.is_ready
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.qos_profile = qos_profile
        self._pending_requests: dict[int, Future[Any]] = {}
        self.callback_group = callback_group
        self._executor_event = False
        self._lock = threading.Lock()
        self._rosidl_sequence_numbers = itertools.count(1)
        self._rosidl_response_futures: dict[int, concurrent.futures.Future[Any]] = {}
        self._rosidl_responses: deque[tuple[int, concurrent.futures.Future[Any]]] = deque()
        client_impl.set_ready_check(self._rosidl_has_response)

    def _rosidl_has_response(self) -> bool:
        return bool(self._rosidl_responses)

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Send a request and wait for the response, while an executor in another thread receives it.

        In a callback this needs a MultiThreadedExecutor and a callback group of its own.

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
        """Wait for the event; log a warning if a callback of the only thread that could set it waits too long."""
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
        future: Future[Any] = Future()
        with self.handle as handle:
            try:
                response_future = handle.entity.send_request(request)
            except runtime.ClosedError:
                return future
        with self._lock:
            sequence_number = next(self._rosidl_sequence_numbers)
            self._pending_requests[sequence_number] = future
            self._rosidl_response_futures[sequence_number] = response_future
        future.add_done_callback(self.remove_pending_request)
        response_future.add_done_callback(partial(self._rosidl_on_response, sequence_number))
        return future

    def _rosidl_on_response(self, sequence_number: int, response_future: concurrent.futures.Future[Any]) -> None:
        lost_errors = runtime.ServerLostError, runtime.ClosedError
        if response_future.cancelled() or isinstance(response_future.exception(), lost_errors):
            return  # in rclpy such a future stays pending
        self._rosidl_responses.append((sequence_number, response_future))
        self._rosidl_handle.notify_arrival()
        self._rosidl_handle.context.loop_runner.wake()

    def get_pending_request(self, sequence_number: int) -> Future[Any]:
        """Return the future of an unanswered request; raise KeyError for other numbers."""
        with self._lock:
            return self._pending_requests[sequence_number]

    def remove_pending_request(self, future: Future[Any]) -> None:
        """Discard a request, so that its response is ignored."""
        with self._lock:
            sequence_number = next((key for key, other in self._pending_requests.items() if other is future), None)
            if sequence_number is None:
                return
            del self._pending_requests[sequence_number]
            response_future = self._rosidl_response_futures.pop(sequence_number)
        if not response_future.done():
            response_future.cancel()

    def service_is_ready(self) -> bool:
        """Return True if a server is connected.

        Raises:
            rosidl_py_gen.runtime.IncompatibleServiceError: there are only servers that this middleware cannot call.
            RCLError: the context was shut down.
        """
        with self.handle.in_use_if_ok() as client:
            return client.service_is_available()

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait until a server is connected, or the time has passed; no executor is needed.

        Raises:
            RCLError: the context is shut down, before or while waiting.
        """
        with self.handle as handle:
            return handle.context.wait(self.service_is_ready, timeout_sec)

    def _rosidl_take(self, executor: Executor) -> Callable[[], Any] | None:
        if not self._rosidl_handle.is_valid or not self._rosidl_responses:
            return None
        sequence_number, response_future = self._rosidl_responses.popleft()

        def finish() -> None:
            with self._lock:
                future = self._pending_requests.get(sequence_number)
            if future is None:  # removed or cancelled
                return
            future._set_executor(executor)
            error = response_future.exception()
            if error is None:
                future.set_result(response_future.result())
            else:
                future.set_exception(error)

        return finish
