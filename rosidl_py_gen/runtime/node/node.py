"""The node: a name, and the factory of everything that carries it.

Decides names (expansion and remapping through `NodeNames`), defaults and lifetime. What endpoints do is in their own
files, which never see the node. Nothing imports this file.
"""

from __future__ import annotations

import asyncio
import threading
import warnings
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

from rosidl_py_gen.cdr import Message, Service
from rosidl_py_gen.errors import ClosedError, RosidlError
from rosidl_py_gen.runtime.endpoints.client import Client
from rosidl_py_gen.runtime.endpoints.publisher import Publisher
from rosidl_py_gen.runtime.endpoints.scope import Scope
from rosidl_py_gen.runtime.endpoints.server import ServiceServer
from rosidl_py_gen.runtime.endpoints.subscription import Subscription
from rosidl_py_gen.runtime.endpoints.timer import Timer
from rosidl_py_gen.runtime.endpoints.types import Untyped, message_type, raw_type, service_type
from rosidl_py_gen.runtime.loop.bridge import current_loop
from rosidl_py_gen.runtime.names.remap import NodeNames
from rosidl_py_gen.runtime.names.rules import normalize_namespace, validate_node_name
from rosidl_py_gen.runtime.node.actions import NodeActions
from rosidl_py_gen.runtime.node.context import Context
from rosidl_py_gen.runtime.node.fork import mark_closed
from rosidl_py_gen.runtime.node.graph import NodeGraph
from rosidl_py_gen.runtime.node.parameters import NodeParameters
from rosidl_py_gen.runtime.node.rosout import RosoutPublisher
from rosidl_py_gen.runtime.time.clock import Clock, ClockType
from rosidl_py_gen.runtime.time.schedule import period_to_ns
from rosidl_py_gen.runtime.transport.qos import as_profile

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    from typing_extensions import Self

    from rosidl_py_gen.runtime.logs.loggers import RosLogger
    from rosidl_py_gen.runtime.transport.qos import QoSLike

MessageT = TypeVar("MessageT", bound=Message)
RequestT = TypeVar("RequestT", bound=Message)
ResponseT = TypeVar("ResponseT", bound=Message)

_DEFAULT_DEPTH = 10


class Node(NodeGraph, NodeActions, NodeParameters):
    """A ROS 2 node.

    Callbacks run on the asyncio event loop. The loop is attached by the first use of the node inside it: ``async with
    node``, `spin`, `run`, creating or publishing something, awaiting something. What calls back but never had a loop is
    warned about when the node closes.

    A node lives until it is closed, by ``with``, `close` or its context. A forgotten one is closed by the garbage
    collector with a ResourceWarning; but its own callbacks keep it alive, when they are its methods or otherwise refer
    to it, so that a node that is made for its callbacks need not be held.

    Args:
        name: may be overridden by ``-r __node:=...``.
        namespace: with or without a leading ``/``; may be overridden by ``-r __ns:=...``.
        context: None means the shared default one.
        enable_rosout: publish what `logger` logs on ``/rosout``.
        overrides: initial values of parameters; they win over those of the command line.
        allow_undeclared: parameters may be set without having been declared.
        declare_overrides: declare every parameter that has an initial value.
        start_services: serve the six parameter services.
        logger_services: serve ``~/get_logger_levels`` and ``~/set_logger_levels``.

    Raises:
        InvalidNameError: for name or namespace.
        ClosedError: the context is closed.
        ParameterError: an initial value does not fit, such as ``use_sim_time:=3``.
    """

    def __init__(
        self,
        name: str,
        namespace: str = "",
        *,
        context: Context | None = None,
        enable_rosout: bool = True,
        overrides: Mapping[str, object] | None = None,
        allow_undeclared: bool = False,
        declare_overrides: bool = False,
        start_services: bool = True,
        logger_services: bool = False,
    ) -> None:
        self._closed = True  # until there is something to close
        if not (context is None or isinstance(context, Context)):
            raise TypeError(f"context must be a Context, such as Context(transport=...), got {context!r:.100}")
        validate_node_name(name)  # before a context is opened for it
        normalize_namespace(namespace)
        shared = Context.default() if context is None else context
        self.context = shared
        try:
            self._names = NodeNames.create(name, namespace, shared.ros_arguments.remap_rules)
            shared.adopt(self)
        except BaseException:
            shared.close_if_unused()
            raise
        self._closed = False
        self._made_on = id(current_loop())
        shared.bridge.adopt_running_loop()
        number = shared.discovery.add_node(self._names.name, self._names.namespace)
        self.scope = Scope(shared, number, self._names.fully_qualified_name)
        """What endpoint modules outside this file build on."""
        self._graph = self.scope.graph
        self._discovery = self.scope.discovery
        self.clock = Clock(ClockType.ROS_TIME)
        """ROS time; system time until simulated time is switched on."""
        try:
            if enable_rosout and shared.ros_arguments.rosout_logs:
                self.scope.own(RosoutPublisher(self.scope))
            self._open_parameters(
                overrides=overrides,
                allow_undeclared=allow_undeclared,
                declare_overrides=declare_overrides,
                start_services=start_services,
                logger_services=logger_services,
            )
        except BaseException:
            self.close()
            raise

    # -------------------------------------------------------------------------------------------------------- names

    @property
    def name(self) -> str:
        """Without namespace, after remapping."""
        return self._names.name

    @property
    def namespace(self) -> str:
        """``/`` or ``/ns``, after remapping."""
        return self._names.namespace

    @property
    def fully_qualified_name(self) -> str:
        """``/ns/name``."""
        return self._names.fully_qualified_name

    @property
    def logger(self) -> RosLogger:
        """The logger of ROS name ``ns.name``."""
        return self.scope.logger

    def resolve_topic_name(self, topic: str) -> str:
        """Expand and remap a topic name as written; raises `InvalidNameError`."""
        return self._names.resolve_topic(topic)

    def resolve_service_name(self, service: str) -> str:
        """Expand and remap a service name as written; raises `InvalidNameError`."""
        return self._names.resolve_service(service)

    # ------------------------------------------------------------------------------------------------------- topics

    @overload
    def create_publisher(
        self, msg_type: type[MessageT], topic: str, qos: QoSLike = _DEFAULT_DEPTH
    ) -> Publisher[MessageT]: ...
    @overload
    def create_publisher(self, msg_type: str, topic: str, qos: QoSLike = _DEFAULT_DEPTH) -> Publisher[Untyped]: ...
    def create_publisher(
        self, msg_type: type[Message] | str, topic: str, qos: QoSLike = _DEFAULT_DEPTH
    ) -> Publisher[Any]:
        """Publish on `topic`. A type given as text makes the messages dicts.

        Raises:
            InvalidNameError, InvalidQoSError, TypeNotFoundError, ClosedError.
        """
        self._require_open()
        publisher = Publisher(self.scope, message_type(msg_type), self._names.resolve_topic(topic), as_profile(qos))
        self.scope.own(publisher)
        return publisher

    @overload
    def create_subscription(
        self,
        msg_type: type[MessageT],
        topic: str,
        callback: Callable[[MessageT], object] | None = None,
        qos: QoSLike = _DEFAULT_DEPTH,
        *,
        raw: Literal[False] = False,
        ignore_local: bool = False,
    ) -> Subscription[MessageT]: ...
    @overload
    def create_subscription(
        self,
        msg_type: type[Message] | str,
        topic: str,
        callback: Callable[[bytes], object] | None = None,
        qos: QoSLike = _DEFAULT_DEPTH,
        *,
        raw: Literal[True],
        ignore_local: bool = False,
    ) -> Subscription[bytes]: ...
    @overload
    def create_subscription(
        self,
        msg_type: str,
        topic: str,
        callback: Callable[[Untyped], object] | None = None,
        qos: QoSLike = _DEFAULT_DEPTH,
        *,
        raw: Literal[False] = False,
        ignore_local: bool = False,
    ) -> Subscription[Untyped]: ...
    def create_subscription(
        self,
        msg_type: type[Message] | str,
        topic: str,
        callback: Callable[[Any], object] | None = None,
        qos: QoSLike = _DEFAULT_DEPTH,
        *,
        raw: bool = False,
        ignore_local: bool = False,
    ) -> Subscription[Any]:
        """Receive from `topic`: iterate over the result, or give a callback (plain or async function).

        Args:
            raw: messages stay bytes, 4-byte encapsulation header included.
            ignore_local: nothing from publishers of this context.

        Raises:
            InvalidNameError, InvalidQoSError, TypeNotFoundError, ClosedError.
        """
        self._require_open()
        known = message_type(msg_type)
        subscription: Subscription[Any] = Subscription(
            self.scope,
            raw_type(known) if raw else known,
            self._names.resolve_topic(topic),
            callback,
            as_profile(qos),
            ignore_local=ignore_local,
        )
        self.scope.own(subscription)
        return subscription

    # ----------------------------------------------------------------------------------------------------- services

    @overload
    def create_service(
        self,
        srv_type: type[Service[RequestT, ResponseT]],
        name: str,
        handler: Callable[[RequestT], ResponseT | Awaitable[ResponseT]] | None = None,
        qos: QoSLike = _DEFAULT_DEPTH,
    ) -> ServiceServer[RequestT, ResponseT]: ...
    @overload
    def create_service(
        self,
        srv_type: str,
        name: str,
        handler: Callable[[Untyped], Untyped | Awaitable[Untyped]] | None = None,
        qos: QoSLike = _DEFAULT_DEPTH,
    ) -> ServiceServer[Untyped, Untyped]: ...
    def create_service(
        self,
        srv_type: type[Service[Any, Any]] | str,
        name: str,
        handler: Callable[[Any], Any] | None = None,
        qos: QoSLike = _DEFAULT_DEPTH,
    ) -> ServiceServer[Any, Any]:
        """Serve `name`: with a handler ``(request) -> response``, plain or async; without, iterate over the requests.

        Raises:
            InvalidNameError, InvalidQoSError, TypeNotFoundError, ClosedError.
        """
        self._require_open()
        known = service_type(srv_type)
        server = ServiceServer(self.scope, known, self._names.resolve_service(name), handler, as_profile(qos))
        self.scope.own(server)
        return server

    @overload
    def create_client(
        self, srv_type: type[Service[RequestT, ResponseT]], name: str, qos: QoSLike = _DEFAULT_DEPTH
    ) -> Client[RequestT, ResponseT]: ...
    @overload
    def create_client(self, srv_type: str, name: str, qos: QoSLike = _DEFAULT_DEPTH) -> Client[Untyped, Untyped]: ...
    def create_client(
        self, srv_type: type[Service[Any, Any]] | str, name: str, qos: QoSLike = _DEFAULT_DEPTH
    ) -> Client[Any, Any]:
        """Call the service `name`.

        Raises:
            InvalidNameError, InvalidQoSError, TypeNotFoundError, ClosedError.
        """
        self._require_open()
        known = service_type(srv_type)
        run = self.context.run_until_complete
        client = Client(self.scope, known, self._names.resolve_service(name), as_profile(qos), run)
        self.scope.own(client)
        return client

    # ------------------------------------------------------------------------------------------------------- timers

    def create_timer(
        self, period_s: float, callback: Callable[[], object] | None = None, *, clock: Clock | None = None
    ) -> Timer:
        """Every `period_s` seconds of this node's clock, which may be simulated, or of `clock`.

        Raises:
            TypeError: no number, function or clock. TimeRangeError: a negative period. ClosedError.
        """
        self._require_open()
        timer = Timer(self.scope, period_to_ns(period_s), callback, self.clock if clock is None else clock)
        self.scope.own(timer)
        return timer

    def create_wall_timer(self, period_s: float, callback: Callable[[], object] | None = None) -> Timer:
        """Every `period_s` seconds of the steady clock, which nothing can turn back."""
        return self.create_timer(period_s, callback, clock=Clock(ClockType.STEADY_TIME))

    # ----------------------------------------------------------------------------------------------------- lifetime

    def _require_open(self) -> None:
        if self._closed:
            raise ClosedError(f"node {self.scope.node_name} is closed")
        self.context.bridge.adopt_running_loop()

    @property
    def is_closed(self) -> bool:
        """True after `close`."""
        return self._closed

    def __enter__(self) -> Self:
        self._require_open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        """Raises `ClosedError`, and `LoopMismatchError`: then a node that was made in here is closed."""
        try:
            self._require_open()
            self.context.bridge.running_loop()
        except RosidlError:
            if self._made_on == id(asyncio.get_running_loop()):  # else it may be in use elsewhere
                self.close()
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all endpoints, then withdraw the node; may be called twice. Whoever waits on them is woken."""
        if self._closed:
            return
        owned = list(self.scope.owned.values())
        if not self.context.had_loop and any(_calls_back(endpoint) for endpoint in owned):
            self.logger.warning(
                f"the callbacks of {self.fully_qualified_name} never ran, because no event loop was running: "
                "use `async with` on the node, spin(node) or run(main)"
            )
        self._closed = True
        self.scope.cancel_tasks()
        # One graph message at the end, not one per endpoint; what another thread is making just now closes itself.
        self.scope.closed = True
        for endpoint in reversed(list(self.scope.owned.values())):
            endpoint.close()
        self.scope.owned.clear()
        self._discovery.remove_node(self.scope.number)
        self.context.release(self)

    def abandon(self, words: str) -> None:
        """See `context.AdoptedNode`."""
        self._closed = True
        if hasattr(self, "scope"):  # else it was just being made
            self.scope.closed = True
            self.scope.node_name += f" ({words})"
            mark_closed(self.scope.owned.values())
            self.scope.owned.clear()

    def __del__(self) -> None:
        if not getattr(self, "_closed", True):
            warnings.warn(f"node {self.fully_qualified_name} was never closed", ResourceWarning, stacklevel=2)
            # The garbage collector may run anywhere, also where a lock is held; the loop has a better moment for this.
            if self.context.bridge.is_running:
                self.context.bridge.call_soon(self.close)
            elif any(thread.ident == threading.get_ident() for thread in threading.enumerate()):
                self.close()
            else:  # a thread of the middleware's, which cannot wait for the middleware
                threading.Thread(target=self.close, name="rosidl-py-gen closer").start()

    def __repr__(self) -> str:
        return f"Node({self.fully_qualified_name!r}{', closed' if self._closed else ''})"


def _calls_back(endpoint: object) -> bool:
    """Whether an endpoint has a function of the user to call."""
    return any(getattr(endpoint, name, None) is not None for name in ("_callback", "_handler", "_execute", "_accept"))
