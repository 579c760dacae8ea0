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
from rclpy.qos import QoSProfile as QoSProfile
from rclpy.service_introspection import ServiceIntrospectionState as ServiceIntrospectionState
from rclpy.task import Future
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    import concurrent.futures
    from collections.abc import Callable

    from rclpy.executors import Executor
    from rclpy.handles import Handle

SrvType = TypeVar("SrvType")
SrvTypeRequest = TypeVar("SrvTypeRequest")
SrvTypeResponse = TypeVar("SrvTypeResponse")


class Client:
    """Made by `Node.create_client`. A response is taken by the executor of its node, like everything else.

    Attributes:
        srv_type: the class of the service.
        srv_name: the name as it was written.
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
        self.context = context
        self._rosidl_client = client_impl
        self._rosidl_is_ready = client_impl.is_ready
        self.srv_type = srv_type
        self.srv_name = srv_name
        self.qos_profile = qos_profile
        self._pending_requests: dict[int, Future[Any]] = {}
        self.callback_group = callback_group
        self._executor_event = False
        self._lock = threading.Lock()
        self._rosidl_numbers = itertools.count(1)
        self._rosidl_sent: dict[int, concurrent.futures.Future[Any]] = {}
        self._rosidl_arrived: deque[tuple[int, concurrent.futures.Future[Any]]] = deque()
        client_impl.set_ready(self._rosidl_has_arrived)

    def _rosidl_has_arrived(self) -> bool:
        return bool(self._rosidl_arrived)

    def call(self, request: Any, timeout_sec: float | None = None) -> Any:
        """Send a request and wait for the response, which an executor in another thread has to take: a callback in a
        group of its own, of a MultiThreadedExecutor. None when the time has passed.

        Raises:
            TypeError: the request is of another class.
        """
        event = threading.Event()
        future = self.call_async(request)
        future.add_done_callback(lambda _: event.set())
        if not future.done() and not event.wait(timeout_sec):
            self.remove_pending_request(future)
        return future.result()

    def call_async(self, request: Any) -> Future[Any]:
        """Send a request, and answer a future of its response. Where no server is there, or the context is
        shut down, it is lost.

        Raises:
            TypeError: the request is of another class. InvalidHandle: the client was destroyed.
        """
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"Expected {self.srv_type.Request}, got {type(request)}")
        future: Future[Any] = Future()
        with self.handle as handle:
            try:
                sent = handle.entity.send_request(request)
            except runtime.ClosedError:
                return future
        with self._lock:
            number = next(self._rosidl_numbers)
            self._pending_requests[number], self._rosidl_sent[number] = future, sent
        future.add_done_callback(self.remove_pending_request)
        sent.add_done_callback(partial(self._rosidl_on_response, number))
        return future

    def _rosidl_on_response(self, number: int, sent: concurrent.futures.Future[Any]) -> None:
        """On the loop, mostly."""
        if sent.cancelled() or isinstance(sent.exception(), (runtime.ServerLostError, runtime.ClosedError)):
            return  # in rclpy such a future is pending for ever
        self._rosidl_arrived.append((number, sent))
        self._rosidl_client.notify_arrival()
        self._rosidl_client.context.driver.wake()

    def get_pending_request(self, sequence_number: int) -> Future[Any]:
        """The future of a request that was not answered; KeyError for others."""
        with self._lock:
            return self._pending_requests[sequence_number]

    def remove_pending_request(self, future: Future[Any]) -> None:
        """Forget a request: nobody waits for its response any more."""
        with self._lock:
            number = next((number for number, other in self._pending_requests.items() if other is future), None)
            if number is None:
                return
            del self._pending_requests[number]
            sent = self._rosidl_sent.pop(number)
        if not sent.done():
            sent.cancel()

    def service_is_ready(self) -> bool:
        """Whether a server is connected.

        Raises `rosidl_py_gen.runtime.IncompatibleServiceError` where the only servers are such that this machine
        cannot talk to them; it says why. RCLError after the context was shut down.
        """
        with self.handle.active() as client:
            return client.service_is_available()

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        """Wait until a server is connected, or the time has passed; nobody has to spin.

        Raises RCLError when the context is shut down, also meanwhile.
        """
        with self.handle as handle:
            return handle.context.wait(
                self.service_is_ready, timeout_sec if timeout_sec is None else max(0.0, timeout_sec)
            )

    def configure_introspection(
        self, clock: Clock, service_event_qos_profile: QoSProfile, introspection_state: ServiceIntrospectionState
    ) -> None:
        """Publish requests and responses on ``<service>/_service_event``, as far as the state says."""
        with self.handle.in_use() as client:
            profile = service_event_qos_profile.get_c_qos_profile()
            client.configure_introspection(
                clock.handle.clock, profile, runtime.IntrospectionState(int(introspection_state))
            )

    @property
    def handle(self) -> Handle[runtime.Client[Any, Any]]:
        """What a wait set takes."""
        return self._rosidl_client

    @property
    def service_name(self) -> str:
        """The name after expansion and remapping."""
        with self.handle.in_use() as client:
            return client.name

    @property
    def logger_name(self) -> str:
        """The name of the node's logger."""
        with self.handle as handle:
            return handle.logger_name

    def destroy(self) -> None:
        """End it; use `Node.destroy_client`."""
        self._rosidl_client.destroy_when_not_in_use()

    def _rosidl_take(self, executor: Executor) -> Callable[[], Any] | None:
        if not self._rosidl_client.is_valid or not self._rosidl_arrived:
            return None
        number, sent = self._rosidl_arrived.popleft()

        def finish() -> None:
            with self._lock:
                future = self._pending_requests.get(number)
            if future is None:  # removed, or cancelled
                return
            future._set_executor(executor)
            error = sent.exception()
            if error is None:
                future.set_result(sent.result())
            else:
                future.set_exception(error)

        return finish
