"""Clients of asyncio nodes."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from rclpy.client import BaseClient
from rclpy.impl.async_entities import EntityTask
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    import concurrent.futures
    from collections.abc import Callable

    from rclpy.context import Context
    from rclpy.handles import Handle
    from rclpy.qos import QoSProfile


class AsyncClient(BaseClient):
    """Client of a service, created by `AsyncNode.create_client`. Responses arrive while its node runs."""

    def __init__(
        self,
        context: Context,
        client_impl: Handle[runtime.Client[Any, Any]],
        srv_type: Any,
        srv_name: str,
        qos_profile: QoSProfile,
        on_destroy: Callable[[AsyncClient], None],
        tg: Any = None,
    ) -> None:
        super().__init__(context, client_impl, srv_type, srv_name, qos_profile, on_destroy=on_destroy)
        self._rosidl_calls: set[asyncio.Future[Any]] = set()
        self.rosidl_task = EntityTask(self._rosidl_run, self.destroy, tg)

    def destroy(self) -> None:
        """Destroy the client, and cancel calls that wait for a response."""
        self.rosidl_task.cancel()
        super().destroy()
        for future in tuple(self._rosidl_calls):
            future.cancel()

    async def _rosidl_run(self) -> None:
        await asyncio.Event().wait()  # the calls need no task; the client is destroyed when this one is cancelled

    async def wait_for_service(self, *, check_interval: float = 0.1) -> None:
        """Wait until a server is connected; `asyncio.timeout` limits the time.

        Args:
            check_interval: seconds between two checks.
        """
        while not self.service_is_ready():
            await asyncio.sleep(check_interval)

    async def call(self, request: Any) -> Any:
        """Send a request and return the response.

        Without a server the request is lost, and the call waits until it is cancelled.

        Raises:
            TypeError: the request is of another class.
            RuntimeError: the client was destroyed.
        """
        if not self.handle.is_valid:
            raise RuntimeError("Calling a destroyed client is forbidden")
        if not isinstance(request, self.srv_type.Request):
            raise TypeError(f"Expected {self.srv_type.Request}, got {type(request)}")
        loop = asyncio.get_running_loop()
        future: asyncio.Future[Any] = loop.create_future()
        with self.handle.in_use(require_ok=False) as client:
            response_future = client.send_request(request)

        def on_response(_: object) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(_copy_result, response_future, future)

        response_future.add_done_callback(on_response)
        self._rosidl_calls.add(future)
        try:
            return await future
        finally:
            self._rosidl_calls.discard(future)
            if not response_future.done():
                response_future.cancel()


def _copy_result(source: concurrent.futures.Future[Any], target: asyncio.Future[Any]) -> None:
    if target.done() or source.cancelled():
        return
    error = source.exception()
    if error is None:
        target.set_result(source.result())
    elif not isinstance(error, (runtime.ServerLostError, runtime.ClosedError)):  # in rclpy the call stays pending
        target.set_exception(error)
