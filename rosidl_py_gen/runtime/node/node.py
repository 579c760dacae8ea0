"""The node: a name, and the factory of everything that carries it.

Decides names (expansion and remapping through `NodeNames`), defaults and lifetime. What endpoints do is in their own
files, which never see the node. Only lifecycle nodes, the runner and the pytest plugin import this file.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.msgs.rcl_interfaces.msg import Log
from rosidl_py_gen.runtime.entities.entity_scope import pluralize
from rosidl_py_gen.runtime.entities.message_types import DictMessage, message_type, raw_type
from rosidl_py_gen.runtime.entities.publisher import Publisher
from rosidl_py_gen.runtime.entities.subscription import Subscription
from rosidl_py_gen.runtime.graph.type_hashes import checked_mode
from rosidl_py_gen.runtime.logs.loggers import failure_listeners
from rosidl_py_gen.runtime.logs.rosout import shared_router
from rosidl_py_gen.runtime.loop.callback_failures import FailureGuard
from rosidl_py_gen.runtime.names.rclpy_hints import HINTS, unknown_attribute
from rosidl_py_gen.runtime.names.remapping import NodeNames
from rosidl_py_gen.runtime.names.validation import normalize_namespace, validate_node_name
from rosidl_py_gen.runtime.node.action_methods import ActionMethods
from rosidl_py_gen.runtime.node.arguments import NodeOptions, parse_node_arguments
from rosidl_py_gen.runtime.node.context import Context
from rosidl_py_gen.runtime.node.graph_methods import GraphMethods
from rosidl_py_gen.runtime.node.messages import MessageMethods
from rosidl_py_gen.runtime.node.parameter_methods import ParameterMethods
from rosidl_py_gen.runtime.node.service_methods import ServiceMethods
from rosidl_py_gen.runtime.node.time_methods import TimeMethods
from rosidl_py_gen.runtime.node.type_methods import TypeMethods
from rosidl_py_gen.runtime.transport.qos import ROSOUT, as_profile

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.runtime.entities.client import Client
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.server import ServiceServer
    from rosidl_py_gen.runtime.entities.timer import Timer
    from rosidl_py_gen.runtime.graph.endpoint_events import PublisherEventCallbacks, SubscriptionEventCallbacks
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.logs.loggers import RosLogger
    from rosidl_py_gen.runtime.logs.rosout import LogFields
    from rosidl_py_gen.runtime.loop.callback_failures import OnError
    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.transport.qos import QoSLike

MessageT = TypeVar("MessageT", bound=Message)

_DEFAULT_DEPTH = 10


class Node(GraphMethods, MessageMethods, ServiceMethods, TypeMethods, TimeMethods, ActionMethods, ParameterMethods):
    """A ROS 2 node.

    Callbacks run on the asyncio event loop. The loop is attached by the first use of the node inside it: ``async with
    node``, `spin`, `run`, creating or publishing something, awaiting something. What calls back but never had a loop is
    warned about when the node closes.

    A node lives until it is closed, by ``with``, `close` or its context. Nodes that are still open when the process
    ends are closed then, with a ResourceWarning.

    Args:
        name: may be overridden by ``-r __node:=...``.
        namespace: with or without a leading ``/``; may be overridden by ``-r __ns:=...``.
        context: None means the shared default one.
        enable_rosout: publish what `logger` logs on ``/rosout``.
        parameter_overrides: initial values of parameters; they win over those of the command line.
        allow_undeclared_parameters: parameters may be set without having been declared.
        automatically_declare_parameters_from_overrides: declare every parameter that has an initial value.
        start_services: serve the six parameter services.
        parameter_events: publish changes of parameters on ``/parameter_events``.
        logger_services: serve ``~/get_logger_levels`` and ``~/set_logger_levels``.
        time_source: declare the parameter `use_sim_time`, and follow ``/clock`` while it is true. Without it `clock`
            shows system time, or what the program makes it show.
        type_hash_check: what becomes of messages whose sender announces another definition of their type: ``"error"``
            withholds them, ``"warn"`` hands them out; both say so once for each topic and peer, ``"off"`` does not. It
            can be given for each endpoint, too.
        on_error: what an exception in a callback does. ``"log"``: it is logged, and all goes on. ``"raise"``: it also
            ends `run`, `spin`, ``async with node``, ``with node`` or the blocking call under way, which raises it.
            None: what the context says, else ``"log"``.
        cli_args: a command line for this node alone, such as ``["--ros-args", "-r", "chatter:=talk"]``: remap rules
            and parameters, which go before those of the context. What is not for ROS has no effect.
        use_global_arguments: remap rules and parameters of the context count for this node, too.

    Raises:
        InvalidNameError: for name or namespace.
        ClosedError: the context is closed.
        RosArgumentError: `cli_args` cannot be understood, or concern more than one node.
        ParameterError: an initial value does not fit, such as ``use_sim_time:=3``.
    """

    def __init__(
        self,
        name: str,
        namespace: str = "",
        *,
        context: Context | None = None,
        enable_rosout: bool = True,
        parameter_overrides: Mapping[str, object] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        start_services: bool = True,
        parameter_events: bool = True,
        logger_services: bool = False,
        time_source: bool = True,
        type_hash_check: TypeCheck = "error",
        on_error: OnError | None = None,
        cli_args: Sequence[str] | None = None,
        use_global_arguments: bool = True,
    ) -> None:
        if not (context is None or isinstance(context, Context)):
            raise TypeError(f"context must be a Context, such as Context(transport=...), got {context!r:.100}")
        validate_node_name(name)  # before a context is opened for it
        normalize_namespace(namespace)
        mode = checked_mode(type_hash_check)
        own = parse_node_arguments(cli_args)
        options = NodeOptions(
            arguments=own,
            use_global_arguments=use_global_arguments,
            enable_rosout=enable_rosout,
            parameter_overrides=parameter_overrides,
            allow_undeclared_parameters=allow_undeclared_parameters,
            automatically_declare_parameters_from_overrides=automatically_declare_parameters_from_overrides,
            start_services=start_services,
            parameter_events=parameter_events,
            logger_services=logger_services,
            time_source=time_source,
        )
        self.context = Context.default() if context is None else context
        core = self.context._core
        try:
            rules = own.remap_rules + (core.ros_arguments.remap_rules if use_global_arguments else ())
            self._names = NodeNames.create(name, namespace, rules)
            self._scope = core.open_scope(self._names, on_error)
            self._scope.type_hash_check = mode
        except BaseException:
            core.close_if_unused()
            raise
        self._made_on = id(current_loop())
        self._guards: list[FailureGuard] = []
        self.clock = self._scope.make_clock()
        """ROS time; system time until simulated time is switched on."""
        core.adopt(self)
        for sentence in own.warnings:
            self.logger.warning(sentence)
        try:
            self._open(options)
        except BaseException:
            self.close()
            raise

    def _open(self, options: NodeOptions) -> None:
        """Bring up what every node has; subclasses add to it. The node is closed when this fails."""
        self.context._core.bridge.adopt_running_loop()
        if options.enable_rosout and self.context._core.ros_arguments.logs.rosout:
            _start_rosout(self._scope)
        self._open_parameters(options)

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
        return self._scope.logger

    def get_name(self) -> str:
        """Return `name`; the name in rclpy."""
        return self.name

    def get_namespace(self) -> str:
        """Return `namespace`; the name in rclpy."""
        return self.namespace

    def get_fully_qualified_name(self) -> str:
        """Return `fully_qualified_name`; the name in rclpy."""
        return self.fully_qualified_name

    def get_logger(self) -> RosLogger:
        """Return `logger`; the name in rclpy."""
        return self.logger

    def get_clock(self) -> Clock:
        """Return `clock`; the name in rclpy."""
        return self.clock

    def resolve_topic_name(self, topic: str) -> str:
        """Expand and remap a topic name as written; raises `InvalidNameError`."""
        return self._names.resolve_topic(topic)

    def resolve_service_name(self, service: str) -> str:
        """Expand and remap a service name as written; raises `InvalidNameError`."""
        return self._names.resolve_service(service)

    # ------------------------------------------------------------------------------------------------------- topics

    @overload
    def create_publisher(
        self,
        msg_type: type[MessageT],
        topic: str,
        qos: QoSLike = _DEFAULT_DEPTH,
        *,
        type_hash_check: TypeCheck | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> Publisher[MessageT]: ...
    @overload
    def create_publisher(
        self,
        msg_type: str,
        topic: str,
        qos: QoSLike = _DEFAULT_DEPTH,
        *,
        type_hash_check: TypeCheck | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> Publisher[DictMessage]: ...
    def create_publisher(
        self,
        msg_type: type[Message] | str,
        topic: str,
        qos: QoSLike = _DEFAULT_DEPTH,
        *,
        type_hash_check: TypeCheck | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> Publisher[Any]:
        """Publish on `topic`. A type given as text makes the messages dicts.

        Args:
            type_hash_check: that of `Node`, for this publisher: it warns of subscriptions with another definition.
            event_callbacks: are told when subscriptions come and go, do not fit, and so on.

        Raises:
            InvalidNameError, InvalidQoSError, TypeNotFoundError, UnsupportedEventError, ClosedError: as they say.
        """
        self._require_open()
        name = self._names.resolve_topic(topic)
        known, profile = message_type(msg_type), as_profile(qos)
        return Publisher(
            self._scope, known, name, profile, type_hash_check=type_hash_check, event_callbacks=event_callbacks
        )

    @overload
    def create_subscription(
        self,
        msg_type: type[MessageT],
        topic: str,
        callback: Callable[[MessageT], object] | None = None,
        qos: QoSLike = _DEFAULT_DEPTH,
        *,
        raw: Literal[False] = False,
        arrays: bool = False,
        ignore_local: bool = False,
        type_hash_check: TypeCheck | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        concurrency: int = 1,
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
        type_hash_check: TypeCheck | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        concurrency: int = 1,
    ) -> Subscription[bytes]: ...
    @overload
    def create_subscription(
        self,
        msg_type: str,
        topic: str,
        callback: Callable[[DictMessage], object] | None = None,
        qos: QoSLike = _DEFAULT_DEPTH,
        *,
        raw: Literal[False] = False,
        ignore_local: bool = False,
        type_hash_check: TypeCheck | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        concurrency: int = 1,
    ) -> Subscription[DictMessage]: ...
    def create_subscription(
        self,
        msg_type: type[Message] | str,
        topic: str,
        callback: Callable[[Any], object] | None = None,
        qos: QoSLike = _DEFAULT_DEPTH,
        *,
        raw: bool = False,
        arrays: bool = False,
        ignore_local: bool = False,
        type_hash_check: TypeCheck | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        concurrency: int = 1,
    ) -> Subscription[Any]:
        """Receive from `topic`: iterate over the result, or give a callback (plain or async function).

        Args:
            raw: messages stay bytes, 4-byte encapsulation header included.
            arrays: sequences of fixed-size messages are structured arrays, as in `decode`; not with `raw` or text.
            ignore_local: nothing from publishers of this context.
            type_hash_check: that of `Node`, for this subscription.
            event_callbacks: are told when publishers come and go, do not fit, are late, and so on.
            concurrency: how many calls of an async callback may be under way at once. They begin in order.

        Raises:
            InvalidNameError, InvalidQoSError, TypeNotFoundError, UnsupportedEventError, ClosedError: as they say.
        """
        self._require_open()
        if arrays and raw:
            raise TypeError("arrays=True needs messages that are decoded, raw=True leaves bytes")
        known = message_type(msg_type, arrays=arrays)
        subscription: Subscription[Any] = Subscription(
            self._scope,
            raw_type(known) if raw else known,
            self._names.resolve_topic(topic),
            callback,
            as_profile(qos),
            ignore_local=ignore_local,
            type_hash_check=type_hash_check,
            event_callbacks=event_callbacks,
            concurrency=concurrency,
        )
        if callback is not None:
            self._scope.with_callbacks[id(subscription)] = subscription
        return subscription

    # ----------------------------------------------------------------------------------------------------- lifetime

    def _require_open(self) -> None:
        self._scope.require_open(False, "the node")
        self.context._core.bridge.adopt_running_loop()

    @property
    def is_closed(self) -> bool:
        """True after `close`, and in a forked child."""
        return self._scope.closed

    def __enter__(self) -> Self:
        self._require_open()
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.close()
        if error is None:
            self._scope.failures.raise_kept()

    async def __aenter__(self) -> Self:
        """Raises `ClosedError`, and `WrongEventLoopError`: then a node that was made in here is closed."""
        try:
            self._require_open()
            self.context._core.bridge.running_loop()
        except RosidlError:
            if self._made_on == id(asyncio.get_running_loop()):  # else it may be in use elsewhere
                self.close()
            raise
        self._guards.append(guard := FailureGuard(lambda failures: failures is self._scope.failures))
        guard.__enter__()
        return self

    async def __aexit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self.close()
        finally:
            self._guards.pop().__exit__(kind, error, trace)

    def close(self) -> None:
        """Close all endpoints, then withdraw the node; may be called twice. Whoever waits on them is woken."""
        if self._scope.closed:
            return
        if (unserved := self.context._core.unserved(self._scope)) is not None:
            self.logger.warning(str(unserved))
            for hear in failure_listeners:
                hear("", unserved)
        self._scope.close()
        self.context._core.release(self)

    def destroy_node(self) -> None:
        """Do the same as `close`; the name in rclpy."""
        self.close()

    def destroy_publisher(self, publisher: Publisher[Any]) -> bool:
        """Close a publisher and return True; the same as `publisher.close()`, as in rclpy."""
        publisher.close()
        return True

    def destroy_subscription(self, subscription: Subscription[Any]) -> bool:
        """Close a subscription and return True; the same as `subscription.close()`, as in rclpy."""
        subscription.close()
        return True

    def destroy_service(self, service: ServiceServer[Any, Any]) -> bool:
        """Close a service and return True; the same as `service.close()`, as in rclpy."""
        service.close()
        return True

    def destroy_client(self, client: Client[Any, Any]) -> bool:
        """Close a client and return True; the same as `client.close()`, as in rclpy."""
        client.close()
        return True

    def destroy_timer(self, timer: Timer) -> bool:
        """Close a timer and return True; the same as `timer.close()`, as in rclpy."""
        timer.close()
        return True

    if not TYPE_CHECKING:  # type checkers report unknown attributes themselves

        def __getattr__(self, name: str) -> object:
            if name in HINTS:
                raise AttributeError(unknown_attribute(repr(type(self).__name__) + " object", name))
            # A property of a subclass may have failed with an AttributeError of its own: it is raised again.
            return object.__getattribute__(self, name)

    def __repr__(self) -> str:
        others = pluralize(max(0, len(self._scope.graph.nodes()) - 1), "other node")
        state = "closed" if self.is_closed else f"domain {self.context.domain_id}, {others}"
        return f"{type(self).__name__}({self.fully_qualified_name}, {state})"


def _start_rosout(scope: EntityScope) -> None:
    """Publish what is logged as this node on ``/rosout`` until it closes.

    Source: docs/internals/protocol.md 9.7.
    """
    publisher: Publisher[Log] = Publisher(scope, message_type(Log), "/rosout", ROSOUT)

    def publish(fields: LogFields) -> None:
        sec, nanosec = sec_nanosec(fields.stamp_ns)
        publisher._publish_without_waiting(
            Log(
                stamp=Time(sec=sec, nanosec=nanosec),
                level=fields.level,
                name=fields.name,
                msg=fields.msg,
                file=fields.file,
                function=fields.function,
                line=fields.line,
            )
        )

    scope.register(shared_router().register(scope.logger.name, publish))
