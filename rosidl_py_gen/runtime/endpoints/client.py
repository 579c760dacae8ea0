"""Service clients: send a request, find its response among all that arrive.

Decides how calls are matched (own id plus sequence number, protocol.md 5.1), when a server counts as available (5.2),
and that a pending call never outlives its caller: timeout, cancellation and `close` all remove it.

A request goes to all servers of its service, in the way one kind of them understands. As soon as one of them is on Fast
DDS it is theirs: Cyclone's have to refuse most requests of that kind as too short, ours understand them, whereas Fast
DDS would take the header of the other kind for the message. In that way requests are numbered by the middleware, 1, 2,
3 ... for each writer, so they are counted here.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rosidl_py_gen.errors import ClosedError, DecodeError, RosidlError
from rosidl_py_gen.runtime.endpoints.header import (
    CallTimeoutError,
    ForeignServiceError,
    carrier_qos,
    foreign_words,
    is_foreign,
    send,
    split_header,
)
from rosidl_py_gen.runtime.endpoints.scope import Throttle, request_numbers, require_timeout
from rosidl_py_gen.runtime.loop.bridge import current_loop
from rosidl_py_gen.runtime.names.dds import endpoint_user_data, reply_name, request_name, type_name
from rosidl_py_gen.runtime.transport.qos import History

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine

    from rosidl_py_gen.runtime.endpoints.header import ClientId
    from rosidl_py_gen.runtime.endpoints.introspection import IntrospectionState
    from rosidl_py_gen.runtime.endpoints.scope import Scope
    from rosidl_py_gen.runtime.endpoints.types import ServiceType
    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile

_PREFIX_BYTES = 12
"""The part of a GUID that all endpoints of a participant share."""
_FORGOTTEN_CALLS = 64
"""So many numbers of calls that were given up are kept before they are cleared away."""

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
        self._serves_fast_dds = False
        self._sending = threading.Lock()
        self._sent = 0
        self._sent_as: dict[int, int] = {}
        """Our numbers of requests to Fast DDS servers, by the middleware's."""
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
            ForeignServiceError: the only servers are on Fast DDS, and this machine's Cyclone DDS cannot talk to them.
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
            ForeignServiceError: the only servers are on Fast DDS, and this machine's Cyclone DDS cannot talk to them.
        """
        return await self._scope.wait_until(self._is_available, timeout_s, lambda: self._closed)

    def _is_available(self) -> bool:
        version = self._scope.graph.version
        refused = self._serves_fast_dds and self._scope.participant.fast_dds_refusal is not None
        if not self._available or refused or version != self._checked_version:
            self._available = self._find_server()
            self._checked_version = version
        return self._available

    def _find_server(self) -> bool:
        """Source: protocol.md 5.2; servers of Fast DDS have no ids, but both endpoints in one participant."""
        graph = self._scope.graph
        refusal = self._scope.participant.fast_dds_refusal
        # Matched but not reported yet: what the server keeps, and its id, are known a moment later.
        readers = [guid for guid in self._writer.matched_readers() if guid in graph.endpoints]
        writers = [guid for guid in self._reader.matched_writers() if guid in graph.endpoints]
        foreign = {guid[:_PREFIX_BYTES] for guid in readers if is_foreign(guid)}
        foreign &= {guid[:_PREFIX_BYTES] for guid in writers if is_foreign(guid)}
        readers = [guid for guid in readers if not is_foreign(guid)]
        ids = {graph.endpoints[guid].user_data.get("serviceid") for guid in readers} - {None}
        replying = {graph.endpoints[guid].user_data.get("serviceid") for guid in writers if not is_foreign(guid)}
        is_served = bool(readers and replying) and (not ids or not ids.isdisjoint(replying))
        if refusal is not None and not is_served:
            servers = graph.on_topic(self._request_topic, writers=False)
            if servers and all(is_foreign(server.info.guid) for server in servers):
                raise ForeignServiceError(foreign_words(graph, servers[0], self.name, "the server", refusal))
        self._serves_fast_dds = bool(foreign) and refusal is None
        self._burst = self._kept_by_servers()
        return is_served or self._serves_fast_dds

    def _kept_by_servers(self) -> int:
        """How many requests the server that keeps fewest keeps; 0 when all keep all."""
        endpoints = self._scope.graph.endpoints
        servers = (endpoints[guid].info.qos for guid in self._writer.matched_readers() if guid in endpoints)
        return min((qos.depth for qos in servers if qos.history is History.KEEP_LAST), default=0)

    # ------------------------------------------------------------------------------------------------------- calls

    async def call(self, request: RequestT, timeout_s: float | None = None) -> ResponseT:
        """Send a request and wait for its response; any number of calls may be under way.

        A server that is not there yet is waited for, as part of `timeout_s`; None waits for ever.

        Raises:
            CallTimeoutError: a `TimeoutError`.
            ForeignServiceError: the only servers are on Fast DDS, and this machine's Cyclone DDS cannot talk to them.
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
            while not future.done() and not self._send(encoded, sequence):
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
        if bridge.in_loop_thread() or current_loop() is not None:
            raise WouldDeadlockError(
                f"call_sync on {self.name} from inside the event loop would wait for ever; use "
                "'await client.call(...)' in an async function, or call it from another thread"
            )
        return self._run(self.call(request, timeout_s))

    def _send(self, encoded: bytes, sequence: int) -> bool:
        """Write a request; False when the servers are so far behind that it has to wait."""
        with self._sending:
            number = self._sent + 1
            client: ClientId = self._writer.handle
            shown = sequence
            if self._serves_fast_dds:
                client, shown = self._reader.guid, number
                self._note_number(number, sequence)
            try:
                sent = send(self._writer, encoded, client, shown)
            except RosidlError:
                raise
            except BaseException:
                self._sent = number  # it was written; what interrupted us came behind
                raise
            self._sent += sent
        return sent

    def _note_number(self, number: int, sequence: int) -> None:
        if len(self._sent_as) > 2 * len(self._pending) + _FORGOTTEN_CALLS:
            self._sent_as = {sent: known for sent, known in self._sent_as.items() if known in self._pending}
        self._sent_as[number] = sequence

    def _expire(self, sequence: int, timeout_s: float) -> None:
        future = self._pending.pop(sequence, None)
        if future is not None and not future.done():
            future.set_exception(
                CallTimeoutError(f"no response from {self.name} ({self.service_type}) in {timeout_s} s")
            )

    def _on_replies(self) -> None:
        """The sink of the reply reader. All clients of a service see all replies."""
        items = self._reader.queue.items
        while items:
            data, _, handle, _ = items.popleft()
            try:
                client, sequence, message = split_header(data)
            except DecodeError as err:
                if self._throttle.passes():
                    self._scope.logger.warning(f"dropped a reply on {self.name}: {err}")
                continue
            own = self._own_number(client, sequence, handle)
            if own is None:
                continue
            sequence = own
            future = self._pending.pop(sequence, None)
            if future is None or future.done():
                continue
            try:
                future.set_result(self._type.response.decode(message))
            except DecodeError as err:
                future.set_exception(err)
            except RuntimeError:
                continue  # the loop it was awaited on is closed

    def _own_number(self, client: ClientId, sequence: int, writer_handle: int) -> int | None:
        """Which of our requests a reply is for; None when it is for another client."""
        if isinstance(client, bytes):
            return self._sent_as.get(sequence) if client in (self._reader.guid, self._writer.guid) else None
        if client != self._writer.handle:
            return None
        writer = self._reader.writer_guid(writer_handle)
        return None if writer is not None and is_foreign(writer) else sequence

    # ------------------------------------------------------------------------------------------------------- state

    def configure_introspection(self, clock: Clock, qos: QoSLike, state: IntrospectionState) -> None:
        """Publish what passes on ``<service>/_service_event`` from now on; see `introspection.py`.

        Args:
            clock: stamps the events; usually the node's.
            qos: counts when introspection goes from OFF to something else.
        """
        self._scope.require_open(self._closed, f"the client of {self.name}")
        from rosidl_py_gen.runtime.endpoints.introspection import introspect

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
