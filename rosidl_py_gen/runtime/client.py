"""Service clients: send a request, find its response among all that arrive.

Decides how calls are matched (own id plus sequence number, protocol.md 5.1), when a server counts as available (5.2),
and that a pending call never outlives its caller: timeout, cancellation and `close` all remove it.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.errors import ClosedError, DecodeError, RosidlError
from rosidl_py_gen.runtime.ddsnames import endpoint_user_data, reply_name, request_name, type_name
from rosidl_py_gen.runtime.qos import History
from rosidl_py_gen.runtime.request import (
    CallTimeoutError,
    ForeignServiceError,
    add_header,
    carrier_qos,
    foreign_words,
    is_foreign,
    split_header,
)
from rosidl_py_gen.runtime.scope import Throttle, request_numbers, require_timeout

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime.clock import Clock
    from rosidl_py_gen.runtime.introspection import IntrospectionState
    from rosidl_py_gen.runtime.message_types import ServiceType
    from rosidl_py_gen.runtime.qos import QoSLike, QoSProfile
    from rosidl_py_gen.runtime.scope import Scope

RequestT = TypeVar("RequestT")
ResponseT = TypeVar("ResponseT")


class WouldDeadlockError(RosidlError, RuntimeError):
    """The caller would wait, on the event loop's own thread, for something only that loop can bring."""


class Client(Generic[RequestT, ResponseT]):
    """Made by `Node.create_client`."""

    def __init__(
        self,
        scope: Scope,
        service_type: ServiceType[RequestT, ResponseT],
        name: str,
        qos: QoSProfile,
        run: Callable[[Coroutine[Any, Any, ResponseT]], ResponseT],
    ) -> None:
        self._scope = scope
        self._run = run
        self._closed = False
        self._introspection: object | None = None
        self.name = name
        """Fully qualified service name, after expansion and remapping."""
        self.service_type = service_type.ros_name
        """``pkg/srv/Name``."""
        carrier = carrier_qos(qos)
        self._type = service_type
        self._pending: dict[int, asyncio.Future[ResponseT]] = {}
        self._checked_version = -1
        self._burst = 0
        self._throttle = Throttle()
        self._available = False
        client_id = scope.new_entity_id()
        prefix = not qos.avoid_ros_namespace_conventions
        self._request_topic, self._reply_topic = request_name(name, prefix=prefix), reply_name(name, prefix=prefix)
        # The reader first: a server may answer as soon as the writer is known (protocol.md 5.2).
        self._reader = scope.participant.create_reader(
            self._reply_topic,
            type_name(service_type.response.ros_name),
            carrier,
            endpoint_user_data(service_type.response.type_hash, client_id=client_id),
        )
        self._writer = scope.participant.create_writer(
            self._request_topic,
            type_name(service_type.request.ros_name),
            carrier,
            endpoint_user_data(service_type.request.type_hash, client_id=client_id),
        )
        self._line = scope.discovery.request_line(self._request_topic)
        scope.add(self._reader.guid, self._writer.guid)
        self._reader.set_sink(self._on_replies)

    # ------------------------------------------------------------------------------------------------ availability

    def service_is_available(self) -> bool:
        """Whether a server is connected, both ways.

        Raises:
            ForeignServiceError: the only servers are Fast DDS ones.
            ClosedError: the client is closed.
        """
        self._scope.require_open(self._closed, f"the client of {self.name}")
        self._scope.discovery.refresh()
        return self._is_available()

    async def wait_for_service(self, timeout_s: float | None = None) -> bool:
        """Wait until a server with matching endpoints is connected.

        Returns:
            False when the time passed. Never raises for absence.

        Raises:
            ForeignServiceError: the only servers are Fast DDS ones.
        """
        return await self._scope.wait_until(self._is_available, timeout_s, lambda: self._closed)

    def _is_available(self) -> bool:
        version = self._scope.graph.version
        if not self._available or version != self._checked_version:
            self._available = self._find_server()
            self._checked_version = version
        return self._available

    def _find_server(self) -> bool:
        """Source: protocol.md 5.2."""
        graph = self._scope.graph
        # Matched but not reported yet: what the server keeps, and its id, are known a moment later.
        known = graph.endpoints.keys()
        readers = {guid for guid in self._writer.matched_readers() if guid in known and not is_foreign(guid)}
        writers = {guid for guid in self._reader.matched_writers() if guid in known and not is_foreign(guid)}
        if not readers or not writers:
            servers = graph.on_topic(self._request_topic, writers=False)
            if servers and all(is_foreign(server.info.guid) for server in servers):
                raise ForeignServiceError(foreign_words(graph, servers[0], self.name, "the server"))
            return False
        servers_qos = [graph.endpoints[guid].info.qos for guid in readers]
        self._burst = min((qos.depth for qos in servers_qos if qos.history is History.KEEP_LAST), default=0)
        ids = {graph.endpoints[guid].user_data.get("serviceid") for guid in readers}
        ids.discard(None)
        return not ids or any(graph.endpoints[guid].user_data.get("serviceid") in ids for guid in writers)

    # ------------------------------------------------------------------------------------------------------- calls

    async def call(self, request: RequestT, timeout_s: float | None = None) -> ResponseT:
        """Send a request and wait for its response; any number of calls may be under way.

        A server that is not there yet is waited for, as part of `timeout_s`; None waits for ever.

        Raises:
            CallTimeoutError: a `TimeoutError`.
            ForeignServiceError: the only servers are Fast DDS ones.
            EncodeError: the request does not fit its type. DecodeError: the response does not.
            ClosedError: the client was closed, also while waiting.
        """
        scope = self._scope
        if self._closed or scope.closed:
            scope.require_open(True, f"the client of {self.name}")
        require_timeout(timeout_s)
        loop = scope.bridge.running_loop()
        encoded = self._type.request.encode(request)
        started = loop.time()
        if not self._is_available() and not await self.wait_for_service(timeout_s):
            raise CallTimeoutError(f"no server of {self.name} ({self.service_type}) appeared in {timeout_s} s")
        sequence = next(request_numbers)
        future: asyncio.Future[ResponseT] = loop.create_future()
        self._pending[sequence] = future
        timer, in_burst = None, False
        if timeout_s is not None:
            left = max(0.0, started + timeout_s - loop.time())
            timer = loop.call_later(left, self._expire, sequence, timeout_s)
        try:
            if self._burst:
                in_burst = await self._line.take_turn(future, self._burst)
            data = add_header(encoded, self._writer.handle, sequence)
            while not future.done() and not self._writer.write(data):
                await asyncio.sleep(0.001)  # the server is far behind; calls wait their turn
            return await future
        finally:
            self._pending.pop(sequence, None)
            if timer is not None:
                timer.cancel()
            if in_burst:
                self._line.over()

    def call_sync(self, request: RequestT, timeout_s: float | None = None) -> ResponseT:
        """`call` for plain code: from a script without event loop, or from another thread than the loop's.

        Raises:
            WouldDeadlockError: called on the event loop's thread; use ``await client.call(...)`` there, or run the
                callback in a thread (`asyncio.to_thread`). Otherwise like `call`.
        """
        bridge = self._scope.bridge
        if bridge.in_loop_thread() or asyncio._get_running_loop() is not None:
            raise WouldDeadlockError(
                f"call_sync on {self.name} from inside the event loop would wait for ever; use "
                "'await client.call(...)' in an async function, or call it from another thread"
            )
        return self._run(self.call(request, timeout_s))

    def _expire(self, sequence: int, timeout_s: float) -> None:
        future = self._pending.pop(sequence, None)
        if future is not None and not future.done():
            future.set_exception(
                CallTimeoutError(f"no response from {self.name} ({self.service_type}) in {timeout_s} s")
            )

    def _on_replies(self) -> None:
        """The sink of the reply reader. All clients of a service see all replies."""
        items = self._reader.queue.items
        own = self._writer.handle
        while items:
            data, _, handle, _ = items.popleft()
            try:
                guid, sequence, message = split_header(data)
            except DecodeError as err:
                if self._throttle.passes():
                    self._scope.logger.warning(f"dropped a reply on {self.name}: {err}")
                continue
            if guid != own:
                continue
            writer = self._reader.writer_guid(handle)
            if writer is not None and is_foreign(writer):
                continue
            future = self._pending.pop(sequence, None)
            if future is None or future.done():
                continue
            try:
                future.set_result(self._type.response.decode(message))
            except DecodeError as err:
                future.set_exception(err)
            except RuntimeError:
                continue  # the loop it was awaited on is closed

    # ------------------------------------------------------------------------------------------------------- state

    def configure_introspection(self, clock: Clock, qos: QoSLike, state: IntrospectionState) -> None:
        """Publish what passes on ``<service>/_service_event`` from now on; see `introspection.py`.

        Args:
            clock: stamps the events; usually the node's.
            qos: counts when introspection goes from OFF to something else.
        """
        self._scope.require_open(self._closed, f"the client of {self.name}")
        from rosidl_py_gen.runtime.introspection import introspect

        introspect(self, clock, state, qos)

    @property
    def pending_count(self) -> int:
        """How many calls wait for a response."""
        return len(self._pending)

    def close(self) -> None:
        """Stop; calls under way raise `ClosedError`. May be called twice."""
        if self._closed:
            return
        self._closed = True
        self._scope.disown(self)
        for future in self._pending.values():
            with contextlib.suppress(RuntimeError):  # the loop it was awaited on is closed
                if not future.done():
                    future.set_exception(ClosedError(f"the client of {self.name} was closed during the call"))
        self._pending.clear()
        self._scope.remove(self._reader.guid, self._writer.guid)
        self._writer.close()
        self._reader.close()
