"""The WebSocket server of the Foxglove SDK, which only this module knows.

Decides how the SDK's threads and our event loop meet. The SDK calls `_Listener` on threads of its own. What viewers
want is written into `wishes`, and the loop is told once to look. Only services and parameters are waited for, because
the SDK wants their answers from the call.

Methods of the SDK hold the GIL while they wait for its locks, and it calls the listener with two of these locks held:
that of the connection graph for its first and last subscriber, that of the parameters for the first and last one of
each name. So the graph may only be published while `own_viewer` is subscribed to it, and parameters only by the SDK
itself, as the answer to a viewer who sets them, which `own_viewer` can do, too.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from concurrent.futures import CancelledError, Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import suppress
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING, Any, TypeVar

import foxglove
from foxglove.websocket import Capability, ServerListener, StatusLevel

from rosidl_py_gen.errors import RosidlError, printable
from rosidl_py_gen.tools import ToolError
from rosidl_py_gen.tools.foxglove.wishes import Offer, Wishes

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Mapping

    from foxglove.websocket import ChannelView, Client, ClientChannel, WebSocketServer

T = TypeVar("T")

_PATIENCE_S = 12.0
"""For an answer of our own loop; what it asks of others has shorter limits."""
_GOODBYE_S = 1.0
_TURNS, _TURN_S = 8, 0.002
_STATUS_S = 1.0
"""The same trouble is reported so often at most."""


@dataclass(frozen=True, slots=True)
class Listening:
    """How a server is started.

    Attributes:
        queue: messages that may wait for a slow viewer.
        has_time: viewers are told the time, instead of using their own.
        is_read_only: viewers can neither publish nor call services, and setting parameters is refused.
    """

    host: str
    port: int
    queue: int
    has_time: bool
    is_read_only: bool


@dataclass(slots=True)
class Handlers:
    """What the server calls, on the loop.

    Attributes:
        look: `watchers` or `offers` have changed, or there are `messages`.
        get: values of the parameters with these names, all when there are none.
        set: wanted values; gives all of these parameters as they are then.
        refreshed: parameters that others have changed.
    """

    look: Callable[[], None]
    get: Callable[[list[str]], Coroutine[Any, Any, dict[str, Any]]]
    set: Callable[[dict[str, Any]], Coroutine[Any, Any, dict[str, Any]]]
    refreshed: Callable[[], Coroutine[Any, Any, dict[str, Any]]]


class Channel:
    """A topic as viewers see it."""

    def __init__(self, channel: foxglove.Channel) -> None:
        self._channel = channel
        self.id = channel.id()
        """As viewers call it."""

    def send(self, data: bytes, time_ns: int) -> None:
        """Queue a message for every viewer that watches; never waits, and drops a viewer's oldest when it is slow."""
        self._channel.log(data, log_time=time_ns)

    def close(self) -> None:
        """Take it away from viewers."""
        self._channel.close()


class Server:
    """What viewers connect to, from `start` to `stop`; to be used on the loop."""

    def __init__(self) -> None:
        _silence()
        self._loop = asyncio.get_running_loop()
        self._context = foxglove.Context()
        self._server: WebSocketServer | None = None
        self._has_time = False
        self._said: dict[str, float] = {}
        self._turn = asyncio.Lock()
        self._turns = 0
        self._waits = _Waits(self._loop)
        self.wishes = Wishes()

    def start(self, listening: Listening, handlers: Handlers, token: str) -> int:
        """Listen; gives the port.

        Args:
            token: whoever sets parameters with this request id is our own viewer.

        Raises:
            ToolError: the address cannot be used.
        """
        encodings = [] if listening.is_read_only else ["cdr", "json"]
        capabilities = [Capability.Parameters, Capability.ConnectionGraph]
        if listening.has_time:
            capabilities.append(Capability.Time)
        if not listening.is_read_only:
            capabilities += [Capability.ClientPublish, Capability.Services]
        self._has_time = listening.has_time
        host = f"[{listening.host}]" if ":" in listening.host else listening.host
        try:
            self._server = foxglove.start_server(
                name="rosidl-py",
                host=host,
                port=listening.port,
                capabilities=capabilities,
                server_listener=_Listener(self._loop, self._waits, self.wishes, handlers, token),
                supported_encodings=encodings,
                context=self._context,
                message_backlog_size=listening.queue,
            )
        except RuntimeError as error:
            reason = str(error).removeprefix("FoxgloveError: ")
            raise ToolError(f"cannot listen on {host}:{listening.port}: {reason}; --port takes another one") from None
        return self._server.port

    async def stop(self) -> None:
        """Say good-bye to viewers; one that reads nothing would keep the SDK waiting for ever."""
        self._waits.end()
        server = self._server
        if server is None:
            return
        stopped = asyncio.Event()

        def stop() -> None:
            server.stop()
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(stopped.set)

        threading.Thread(target=stop, daemon=True).start()
        with suppress(asyncio.TimeoutError):
            await asyncio.wait_for(stopped.wait(), _GOODBYE_S)

    async def turn(self) -> None:
        """To be awaited before viewers are told of a topic or service more or less.

        A viewer for which too much of this waits is disconnected by the SDK, however quickly it reads.
        """
        async with self._turn:
            self._turns += 1
            if self._turns % _TURNS == 0:
                await asyncio.sleep(_TURN_S)

    def open_channel(self, topic: str, type_name: str, definition: str) -> Channel:
        """Show viewers a topic whose messages are CDR; an empty definition says that nobody knows it."""
        schema = foxglove.Schema(name=type_name, encoding="ros2msg", data=definition.encode())
        made = foxglove.Channel(topic, message_encoding="cdr", schema=schema, context=self._context)
        return Channel(made)

    def add_service(
        self, name: str, type_name: str, texts: tuple[str, str], call: Callable[[bytes], Coroutine[Any, Any, bytes]]
    ) -> None:
        """Show viewers a service.

        Args:
            texts: definitions of request and response.
            call: gets the request and gives the response, both CDR; what it raises is told the viewer.
        """
        assert self._server is not None

        def handle(request: foxglove.ServiceRequest) -> bytes:
            return self._waits.wait(call(bytes(request.payload)))

        schemas = [
            foxglove.MessageSchema(
                encoding="cdr", schema=foxglove.Schema(name=type_name + part, encoding="ros2msg", data=text.encode())
            )
            for part, text in zip(("_Request", "_Response"), texts, strict=True)
        ]
        schema = foxglove.ServiceSchema(type_name, request=schemas[0], response=schemas[1])
        self._server.add_services([foxglove.Service(name, schema=schema, handler=handle)])

    def remove_services(self, names: list[str]) -> None:
        """Take services away from viewers."""
        assert self._server is not None
        self._server.remove_services(names)

    def publish_graph(
        self, published: Mapping[str, list[str]], subscribed: Mapping[str, list[str]], served: Mapping[str, list[str]]
    ) -> None:
        """Tell which nodes publish and subscribe to topics, and serve services; see the head of this file."""
        assert self._server is not None
        graph = foxglove.ConnectionGraph()
        for put, names in (
            (graph.set_published_topic, published),
            (graph.set_subscribed_topic, subscribed),
            (graph.set_advertised_service, served),
        ):
            for name, nodes in names.items():
                put(name, nodes)
        self._server.publish_connection_graph(graph)

    def tell_time(self, time_ns: int) -> None:
        """Tell viewers what time it is, if they were promised that."""
        if self._server is not None and self._has_time:
            self._server.broadcast_time(time_ns)

    def tell(self, about: str, text: str) -> None:
        """Warn viewers, all of them because the SDK cannot single one out; at most once a second `about` a thing."""
        now = monotonic()
        if self._server is None or now < self._said.get(about, 0.0) + _STATUS_S:
            return
        self._said = {key: at for key, at in self._said.items() if now < at + _STATUS_S}
        self._said[about] = now
        self._server.publish_status(printable(text), StatusLevel.Warning)


def _silence() -> None:
    """No logs of the SDK: it would wait for the GIL with locks held, and what matters is told viewers anyway.

    It would also set up the root logger, unless that has a handler.
    """
    root, nothing = logging.getLogger(), logging.NullHandler()
    root.addHandler(nothing)
    foxglove.set_log_level(logging.CRITICAL)
    root.removeHandler(nothing)


class _Waits:
    """Threads of the SDK that wait for our loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._lock = threading.Lock()
        self._futures: set[Future[Any]] = set()
        self._has_ended = False

    def wait(self, coroutine: Coroutine[Any, Any, T]) -> T:
        """Its result.

        Raises:
            ToolError: it took too long, or the server ends; and whatever it raises.
        """
        with self._lock:
            if self._has_ended:
                coroutine.close()
                raise ToolError("the server ends")
            future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
            self._futures.add(future)
        try:
            return future.result(_PATIENCE_S)
        except RosidlError:  # some are timeouts, too, and say more
            raise
        except FutureTimeoutError:
            future.cancel()
            raise ToolError(f"no answer in {_PATIENCE_S:g} s") from None
        except CancelledError:  # not the one of asyncio
            raise ToolError("the server ends") from None
        finally:
            with self._lock:
                self._futures.discard(future)

    def end(self) -> None:
        """Let all go that wait, and none begin."""
        with self._lock:
            self._has_ended = True
            futures = list(self._futures)
        for future in futures:
            future.cancel()


class _Listener(ServerListener):
    """Called by the SDK, on its threads."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, waits: _Waits, wishes: Wishes, handlers: Handlers, token: str
    ) -> None:
        self._loop = loop
        self._waits = waits
        self._wishes = wishes
        self._handlers = handlers
        self._token = token
        self._is_told = False

    def _tell_loop(self) -> None:
        """Have the loop look soon; with the lock held."""
        if not self._is_told and not self._loop.is_closed():
            self._is_told = True
            self._loop.call_soon_threadsafe(self._look)

    def _look(self) -> None:
        with self._wishes.lock:
            self._is_told = False
        self._handlers.look()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        with self._wishes.lock:
            self._wishes.watchers.setdefault(channel.id, set()).add(client.id)
            self._tell_loop()

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        with self._wishes.lock:
            self._wishes.unwatch(channel.id, client.id)
            self._tell_loop()

    def on_client_advertise(self, client: Client, channel: ClientChannel) -> None:
        known = channel.schema_encoding or "", channel.schema or b""
        offer = Offer(channel.topic, channel.encoding, channel.schema_name, *known)
        with self._wishes.lock:
            self._wishes.offer((client.id, channel.id), offer)
            self._tell_loop()

    def on_client_unadvertise(self, client: Client, client_channel_id: int) -> None:
        with self._wishes.lock:
            self._wishes.offers.pop((client.id, client_channel_id), None)
            self._tell_loop()

    def on_message_data(self, client: Client, client_channel_id: int, data: bytes) -> None:
        with self._wishes.lock:
            self._wishes.put_message((client.id, client_channel_id), data)
            self._tell_loop()

    def on_get_parameters(
        self, client: Client, param_names: list[str], request_id: str | None = None
    ) -> list[foxglove.Parameter]:
        return self._answer(self._handlers.get(param_names))

    def on_set_parameters(
        self, client: Client, parameters: list[foxglove.Parameter], request_id: str | None = None
    ) -> list[foxglove.Parameter]:
        if request_id == self._token:
            return self._answer(self._handlers.refreshed())
        wanted: dict[str, Any] = {}
        for one in parameters:
            with suppress(ValueError):  # not the base64 it is said to be, which the SDK tells the viewer
                wanted[one.name] = one.get_value()
        return self._answer(self._handlers.set(wanted))

    def _answer(self, coroutine: Coroutine[Any, Any, dict[str, Any]]) -> list[foxglove.Parameter]:
        try:
            return _parameters(self._waits.wait(coroutine))
        except RosidlError:
            return []


def _parameters(values: Mapping[str, Any]) -> list[foxglove.Parameter]:
    """Unset ones are left out by the SDK."""
    return [
        foxglove.Parameter(name, value=list(value) if isinstance(value, tuple) else value)
        for name, value in values.items()
    ]
