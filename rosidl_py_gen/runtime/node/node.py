"""Public class for nodes, `Node`, which creates entities and inherits the other methods from mixin classes.

Entities do not know their node. Only lifecycle nodes, the runner and the pytest plugin import this module. Methods of
services and actions have the names and defaults of rclpy. Action clients and servers are imported when they are first
used, because most nodes have none.
"""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.base.waiters import current_loop
from rosidl_py_gen.cdr import Message, Service
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.msgs.rcl_interfaces.msg import Log
from rosidl_py_gen.runtime.entities.entity_scope import Entity
from rosidl_py_gen.runtime.entities.message_types import DictMessage, message_type, raw_type, service_type
from rosidl_py_gen.runtime.entities.services import Client, ServiceServer
from rosidl_py_gen.runtime.entities.topics import Publisher, Subscription
from rosidl_py_gen.runtime.graph import checked_mode
from rosidl_py_gen.runtime.logs import failure_listeners, message_text, ros_level, shared_router
from rosidl_py_gen.runtime.loop.callbacks import FailureGuard
from rosidl_py_gen.runtime.names import NodeNames, normalize_namespace, validate_node_name
from rosidl_py_gen.runtime.node.adaptive_subscription import MessageMethods
from rosidl_py_gen.runtime.node.context import Context, NodeBase, core_of, reserve_default_context
from rosidl_py_gen.runtime.node.graph_methods import GraphMethods, TypeMethods
from rosidl_py_gen.runtime.node.parameter_methods import ParameterMethods
from rosidl_py_gen.runtime.node.settings import parse_node_arguments
from rosidl_py_gen.runtime.node.timers import TimeMethods
from rosidl_py_gen.runtime.transport.latch import Latch
from rosidl_py_gen.runtime.transport.qos import ROSOUT, as_profile

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.client import ActionClient
    from rosidl_py_gen.runtime.actions.server import ActionServer
    from rosidl_py_gen.runtime.actions.server_goal import GoalResult, ServerGoal
    from rosidl_py_gen.runtime.actions.types import (
        ActionClass,
        ActionT,
        FeedbackT,
        GoalT,
        Policy,
        ResultT,
        UntypedAction,
    )
    from rosidl_py_gen.runtime.clocks import Clock
    from rosidl_py_gen.runtime.entities.endpoint_events import PublisherEventCallbacks, SubscriptionEventCallbacks
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.graph import TypeCheck
    from rosidl_py_gen.runtime.logs import RosLogger
    from rosidl_py_gen.runtime.loop.callbacks import OnError
    from rosidl_py_gen.runtime.node.timers import Timer
    from rosidl_py_gen.runtime.transport.qos import QoSLike, QoSProfile

RequestT = TypeVar("RequestT", bound=Message)
ResponseT = TypeVar("ResponseT", bound=Message)


class ServiceMethods(NodeBase):
    """Service and action methods of `Node`."""

    @overload
    def create_service(
        self, srv_type: type[Service[RequestT, ResponseT]], name: str,
        handler: Callable[[RequestT], ResponseT | Awaitable[ResponseT]] | None = None, qos: QoSLike = 10, *,
        arrays: bool = False, type_hash_check: TypeCheck | None = None,
    ) -> ServiceServer[RequestT, ResponseT]: ...  # fmt: skip
    @overload
    def create_service(
        self, srv_type: str, name: str,
        handler: Callable[[DictMessage], DictMessage | Awaitable[DictMessage]] | None = None, qos: QoSLike = 10, *,
        type_hash_check: TypeCheck | None = None,
    ) -> ServiceServer[DictMessage, DictMessage]: ...  # fmt: skip
    def create_service(
        self,
        srv_type: type[Service[Any, Any]] | str,
        name: str,
        handler: Callable[[Any], Any] | None = None,
        qos: QoSLike = 10,
        *,
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> ServiceServer[Any, Any]:
        """Create a server of a service.

        Args:
            srv_type: service class, or its name such as ``"std_srvs/srv/Trigger"``: then messages are dicts.
            name: service name, which is expanded and remapped.
            handler: plain or async function that gets the request and returns the response; None to iterate or `take`.
            qos: profile, or depth.
            arrays: decode sequences of fixed-size messages as structured arrays; not with a type name.
            type_hash_check: like `type_hash_check` of `Node`.

        Raises:
            InvalidNameError: the name is invalid.
            InvalidQoSError: the profile is invalid.
            TypeNotFoundError: `srv_type` names no known type.
            CallbackSignatureError: `handler` cannot be called with a request.
            TypeError, ValueError: an argument is invalid.
            ClosedError: the node is closed.
        """
        self._require_open()
        server: ServiceServer[Any, Any] = ServiceServer(
            self._scope,
            service_type(srv_type, arrays=arrays),
            self._names.resolve_service(name),
            handler,
            as_profile(qos),
            type_hash_check=type_hash_check,
        )
        if handler is not None:
            self._scope.with_callbacks[id(server)] = server
        return server

    @overload
    def create_client(
        self, srv_type: type[Service[RequestT, ResponseT]], name: str, qos: QoSLike = 10, *, arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> Client[RequestT, ResponseT]: ...  # fmt: skip
    @overload
    def create_client(
        self, srv_type: str, name: str, qos: QoSLike = 10, *, type_hash_check: TypeCheck | None = None
    ) -> Client[DictMessage, DictMessage]: ...
    def create_client(
        self,
        srv_type: type[Service[Any, Any]] | str,
        name: str,
        qos: QoSLike = 10,
        *,
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> Client[Any, Any]:
        """Create a client of a service.

        Args:
            srv_type: service class, or its name such as ``"std_srvs/srv/Trigger"``: then messages are dicts.
            name: service name, which is expanded and remapped.
            qos: profile, or depth.
            arrays: decode sequences of fixed-size messages as structured arrays; not with a type name.
            type_hash_check: like `type_hash_check` of `Node`.

        Raises:
            InvalidNameError: the name is invalid.
            InvalidQoSError: the profile is invalid.
            TypeNotFoundError: `srv_type` names no known type.
            TypeError, ValueError: an argument is invalid.
            ClosedError: the node is closed.
        """
        self._require_open()
        return Client(
            self._scope,
            service_type(srv_type, arrays=arrays),
            self._names.resolve_service(name),
            as_profile(qos),
            type_hash_check=type_hash_check,
        )

    @overload
    def create_action_server(
        self, action: ActionClass[ActionT, GoalT, ResultT, FeedbackT], name: str,
        execute: Callable[[ServerGoal[ActionT]], ResultT | GoalResult | Awaitable[ResultT | GoalResult | None] | None]
        | None = None, *, goal_callback: Callable[[GoalT], object] | None = None,
        cancel_callback: Callable[[ServerGoal[ActionT]], object] | bool = True, result_timeout_s: float = 900.0,
        goal_policy: Policy = "parallel", arrays: bool = False, type_hash_check: TypeCheck | None = None,
    ) -> ActionServer[ActionT]: ...  # fmt: skip
    @overload
    def create_action_server(
        self, action: str, name: str,
        execute: Callable[
            [ServerGoal[UntypedAction]], DictMessage | GoalResult | Awaitable[DictMessage | GoalResult | None] | None
        ] | None = None, *, goal_callback: Callable[[DictMessage], object] | None = None,
        cancel_callback: Callable[[ServerGoal[UntypedAction]], object] | bool = True, result_timeout_s: float = 900.0,
        goal_policy: Policy = "parallel", type_hash_check: TypeCheck | None = None,
    ) -> ActionServer[UntypedAction]: ...  # fmt: skip
    def create_action_server(
        self,
        action: object,
        name: str,
        execute: Callable[[ServerGoal[Any]], Any] | None = None,
        *,
        goal_callback: Callable[[Any], object] | None = None,
        cancel_callback: Callable[[ServerGoal[Any]], object] | bool = True,
        result_timeout_s: float = 900.0,
        goal_policy: Policy = "parallel",
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> ActionServer[Any]:
        """Create a server of an action; callbacks may be plain or async functions.

        Goals that have not started (queued, or deferred) end as CANCELED when a cancel request is accepted.

        Args:
            action: action class, or its name: then goals, results and feedback are dicts.
            name: action name, which is expanded and remapped.
            execute: gets a `ServerGoal` and returns the result (SUCCEEDED), or ends the goal with `succeed`, `abort` or
                `canceled`, with the result as argument or as return value. An exception, or returning None without
                having ended the goal, is ABORTED. A plain function runs in a thread for each goal; it must check
                `goal.is_cancel_requested`, which is also true when the node closes. None: iterate over the requests.
            goal_callback: gets the goal; returns a `GoalDecision` (DEFER: `goal.execute()` later), or a true value or
                None to accept, another false value to reject.
            cancel_callback: True accepts every cancel request, False refuses; a function gets the `ServerGoal`, and
                refuses with a false value other than None. A handler that does not check `goal.is_cancel_requested`
                runs to its end.
            result_timeout_s: time for which a result is retained after the end of its goal, or after `execute` returns
                the result of a goal that it has ended before; `math.inf` forever.
            goal_policy: ``"parallel"`` runs all goals concurrently. The others run one goal at a time: ``"reject"``
                rejects further ones, ``"queue"`` runs them later, ``"preempt"`` cancels the running one. A deferred
                goal is queued when `execute` is called; `goal.started()` waits for its start.
            arrays: decode sequences of fixed-size messages in goals as structured arrays; not with a type name.
            type_hash_check: like `type_hash_check` of `Node`, for the services and topics of this action.

        Raises:
            InvalidNameError: the action name is invalid.
            TypeNotFoundError: `action` names no known type.
            TypeError, ActionArgumentError, ValueError: an argument is invalid, or `goal_callback` is given without
                `execute`.
            ClosedError: the node is closed.
        """
        from rosidl_py_gen.runtime.actions.server import ActionServer
        from rosidl_py_gen.runtime.actions.types import ActionNames, action_type

        self._scope.require_open(False, "the node")
        server: ActionServer[Any] = ActionServer(
            self._scope,
            self.clock,
            action_type(action, arrays=arrays),
            ActionNames.resolve(self._names, name),
            execute,
            goal_callback=goal_callback,
            cancel_callback=cancel_callback,
            result_timeout_s=result_timeout_s,
            goal_policy=goal_policy,
            type_hash_check=type_hash_check,
        )
        if execute is not None:
            self._scope.with_callbacks[id(server)] = server
        return server

    @overload
    def create_action_client(
        self, action: type[ActionT], name: str, *, feedback_depth: int = 100, server_lost_timeout_s: float = 5.0,
        arrays: bool = False, type_hash_check: TypeCheck | None = None,
    ) -> ActionClient[ActionT]: ...  # fmt: skip
    @overload
    def create_action_client(
        self, action: str, name: str, *, feedback_depth: int = 100, server_lost_timeout_s: float = 5.0,
        type_hash_check: TypeCheck | None = None,
    ) -> ActionClient[UntypedAction]: ...  # fmt: skip
    def create_action_client(
        self,
        action: type[Action[Any, Any, Any]] | str,
        name: str,
        *,
        feedback_depth: int = 100,
        server_lost_timeout_s: float = 5.0,
        arrays: bool = False,
        type_hash_check: TypeCheck | None = None,
    ) -> ActionClient[Any]:
        """Create a client of an action.

        Args:
            action: action class, or its name: then goals, results and feedback are dicts.
            name: action name, which is expanded and remapped.
            feedback_depth: number of feedback messages that a goal retains for iteration, at least 1; older ones are
                dropped, and counted in `goal.feedback_dropped`.
            server_lost_timeout_s: time without server after which goals end with `ActionServerLostError`; `math.inf`
                forever.
            arrays: decode sequences of fixed-size messages in results and feedback as structured arrays.
            type_hash_check: like `type_hash_check` of `Node`, for the services and topics of this action.

        Raises:
            InvalidNameError: the action name is invalid.
            TypeNotFoundError: `action` names no known type.
            TypeError, ActionArgumentError, ValueError: an argument is invalid.
            ClosedError: the node is closed.
        """
        from rosidl_py_gen.runtime.actions.client import ActionClient
        from rosidl_py_gen.runtime.actions.types import ActionNames, action_type

        self._scope.require_open(False, "the node")
        return ActionClient(
            self._scope,
            action_type(action, arrays=arrays),
            ActionNames.resolve(self._names, name),
            feedback_depth=feedback_depth,
            server_lost_timeout_s=server_lost_timeout_s,
            type_hash_check=type_hash_check,
        )


MessageT = TypeVar("MessageT", bound=Message)


class Node(GraphMethods, MessageMethods, ServiceMethods, TypeMethods, TimeMethods, ParameterMethods):
    """ROS 2 node.

    Callbacks run on the asyncio event loop. The first use of the node inside a loop attaches that loop: ``async with
    node``, `spin`, `run`, creating or publishing something, awaiting something. If a node has callbacks and never had a
    loop, a warning is logged when it closes.

    A node is open until ``with``, `close` or its context closes it. Nodes that are open at the end of the process are
    closed with a ResourceWarning.

    Args:
        name: may be overridden by ``-r __node:=...``.
        namespace: with or without a leading ``/``; may be overridden by ``-r __ns:=...``.
        context: None uses the default context.
        enable_rosout: publish the log records of `logger` on ``/rosout``.
        parameter_overrides: initial values of parameters; they override initial values from the command line.
        allow_undeclared_parameters: parameters may be set without a declaration.
        automatically_declare_parameters_from_overrides: declare every parameter that has an initial value.
        start_services: serve the six parameter services. The initial value False of the parameter
            ``start_type_description_service`` turns off ``~/get_type_description``.
        parameter_events: publish changes of parameters on ``/parameter_events``.
        logger_services: serve ``~/get_logger_levels`` and ``~/set_logger_levels``.
        time_source: declare the parameter `use_sim_time`, and follow ``/clock`` while it is true. Without it, `clock`
            returns system time, or the time that the program sets.
        type_hash_check: treatment of messages whose sender has another definition of their type. ``"error"`` drops
            them, ``"warn"`` delivers them unless it is the definition of another ROS distribution, ``"off"`` delivers
            them silently. Others than ``"off"`` warn once for each topic and peer. Default of the entities' parameter
            of this name.
        on_error: effect of an exception in a callback. ``"log"`` logs it. ``"raise"`` also raises it from `run`,
            `spin`, ``async with node``, ``with node`` or the current blocking call. None uses the context's `on_error`,
            which is ``"log"`` by default.
        cli_args: command line for this node alone, such as ``["--ros-args", "-r", "chatter:=talk"]``: remap rules and
            parameters, which precede the rules and parameters of the context. Other arguments have no effect.
        use_global_arguments: apply the remap rules and parameters of the context to this node, too.

    Raises:
        InvalidNameError: name or namespace is invalid.
        ClosedError: the context is closed.
        RosArgumentError: `cli_args` cannot be parsed, or concern more than one node.
        ParameterError: an initial value is invalid, such as ``use_sim_time:=3``.
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
        own_arguments = parse_node_arguments(cli_args)
        # A reservation retains the default context, which another thread may close with its last node.
        self.context = reserve_default_context() if context is None else context
        core = core_of(self.context)
        try:
            rules = (*own_arguments.remap_rules, *(core.ros_arguments.remap_rules if use_global_arguments else ()))
            self._names = NodeNames.create(name, namespace, rules)
            self._scope = core.open_scope(self._names, on_error)
            self._scope.type_hash_check = mode
        except BaseException:
            core.close_if_unused(is_reserved=context is None)
            raise
        self._creation_loop_id = id(current_loop())
        self._guards: list[FailureGuard] = []
        self._close_latch = Latch()
        self.clock: Clock = self._scope.make_clock()
        """Clock of ROS time, which is system time until simulated time is switched on."""
        core.adopt(self, is_reserved=context is None)
        for sentence in own_arguments.warnings:
            self.logger.warning(sentence)
        try:
            core.loop_binding.adopt_running_loop()
            if enable_rosout:
                self._start_rosout(ROSOUT)
            self._open_parameters(
                own_arguments.parameters,
                parameter_overrides or {},
                use_global_arguments=use_global_arguments,
                allow_undeclared=allow_undeclared_parameters,
                declares_overrides=automatically_declare_parameters_from_overrides,
                start_services=start_services,
                parameter_events=parameter_events,
                logger_services=logger_services,
                time_source=time_source,
            )
            self._finish_open()
        except BaseException:
            self.close()
            raise

    def _start_rosout(self, qos: QoSProfile) -> None:
        """Publish log records of the node on ``/rosout``, unless the command line disables it."""
        if core_of(self.context).ros_arguments.logs.rosout:
            _start_rosout(self._scope, qos)

    def _finish_open(self) -> None:
        """Hook for subclasses, which start their additions here; if the method raises, the node is closed."""

    @property
    def name(self) -> str:
        """Name of the node without namespace, after remapping."""
        return self._names.name

    @property
    def namespace(self) -> str:
        """Namespace of the node after remapping: ``/`` or ``/ns``."""
        return self._names.namespace

    @property
    def fully_qualified_name(self) -> str:
        """Namespace and name after remapping: ``/ns/name``."""
        return self._names.fully_qualified_name

    @property
    def logger(self) -> RosLogger:
        """Logger of the node, with the ROS name ``ns.name``."""
        return self._scope.logger

    def get_name(self) -> str:
        """Return `name`; for compatibility with rclpy."""
        return self.name

    def get_namespace(self) -> str:
        """Return `namespace`; for compatibility with rclpy."""
        return self.namespace

    def get_fully_qualified_name(self) -> str:
        """Return `fully_qualified_name`; for compatibility with rclpy."""
        return self.fully_qualified_name

    def get_logger(self) -> RosLogger:
        """Return `logger`; for compatibility with rclpy."""
        return self.logger

    def get_clock(self) -> Clock:
        """Return `clock`; for compatibility with rclpy."""
        return self.clock

    def resolve_topic_name(self, topic: str) -> str:
        """Return the expanded and remapped name of a topic; raise `InvalidNameError` if it is invalid."""
        return self._names.resolve_topic(topic)

    def resolve_service_name(self, service: str) -> str:
        """Return the expanded and remapped name of a service; raise `InvalidNameError` if it is invalid."""
        return self._names.resolve_service(service)

    @overload
    def create_publisher(
        self, msg_type: type[MessageT], topic: str, qos: QoSLike = 10, *, type_hash_check: TypeCheck | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> Publisher[MessageT]: ...  # fmt: skip
    @overload
    def create_publisher(
        self, msg_type: str, topic: str, qos: QoSLike = 10, *, type_hash_check: TypeCheck | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> Publisher[DictMessage]: ...  # fmt: skip
    def create_publisher(
        self,
        msg_type: type[Message] | str,
        topic: str,
        qos: QoSLike = 10,
        *,
        type_hash_check: TypeCheck | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
    ) -> Publisher[Any]:
        """Create a publisher of a topic.

        Args:
            msg_type: message class, or its name such as ``"std_msgs/msg/String"``: then messages are dicts.
            topic: topic name, which is expanded and remapped.
            qos: profile, or depth.
            type_hash_check: like `type_hash_check` of `Node`; "off" does not warn of subscriptions with another
                definition.
            event_callbacks: called for matched and incompatible subscriptions, missed deadlines and others.

        Raises:
            InvalidNameError: the topic name is invalid.
            InvalidQoSError: the profile is invalid.
            TypeNotFoundError: `msg_type` names no known type.
            UnsupportedEventError: the transport does not report a requested event.
            ClosedError: the node is closed.
        """
        self._require_open()
        return Publisher(
            self._scope,
            message_type(msg_type),
            self._names.resolve_topic(topic),
            as_profile(qos),
            type_hash_check=type_hash_check,
            event_callbacks=event_callbacks,
        )

    @overload
    def create_subscription(
        self, msg_type: type[MessageT], topic: str, callback: Callable[[MessageT], object] | None = None,
        qos: QoSLike = 10, *, raw: Literal[False] = False, arrays: bool = False, ignore_local: bool = False,
        type_hash_check: TypeCheck | None = None, event_callbacks: SubscriptionEventCallbacks | None = None,
        concurrency: int = 1,
    ) -> Subscription[MessageT]: ...  # fmt: skip
    @overload
    def create_subscription(
        self, msg_type: type[Message] | str, topic: str, callback: Callable[[bytes], object] | None = None,
        qos: QoSLike = 10, *, raw: Literal[True], ignore_local: bool = False, type_hash_check: TypeCheck | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None, concurrency: int = 1,
    ) -> Subscription[bytes]: ...  # fmt: skip
    @overload
    def create_subscription(
        self, msg_type: str, topic: str, callback: Callable[[DictMessage], object] | None = None, qos: QoSLike = 10, *,
        raw: Literal[False] = False, ignore_local: bool = False, type_hash_check: TypeCheck | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None, concurrency: int = 1,
    ) -> Subscription[DictMessage]: ...  # fmt: skip
    def create_subscription(
        self,
        msg_type: type[Message] | str,
        topic: str,
        callback: Callable[[Any], object] | None = None,
        qos: QoSLike = 10,
        *,
        raw: bool = False,
        arrays: bool = False,
        ignore_local: bool = False,
        type_hash_check: TypeCheck | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        concurrency: int = 1,
    ) -> Subscription[Any]:
        """Create a subscription to a topic, with a callback, or to iterate over its messages.

        Args:
            msg_type: message class, or its name such as ``"std_msgs/msg/String"``: then messages are dicts.
            topic: topic name, which is expanded and remapped.
            callback: plain or async function that gets each message; None to iterate, `receive` or `take`.
            qos: profile, or depth.
            raw: do not decode messages; they begin with the 4-byte encapsulation header.
            arrays: decode sequences of fixed-size messages as structured arrays; not with `raw` or a type name.
            ignore_local: ignore publishers of this context.
            type_hash_check: like `type_hash_check` of `Node`.
            event_callbacks: called for matched and incompatible publishers, missed deadlines and others.
            concurrency: maximum number of concurrent calls of an async callback; they start in order.

        Raises:
            InvalidNameError: the topic name is invalid.
            InvalidQoSError: the profile is invalid.
            TypeNotFoundError: `msg_type` names no known type.
            CallbackSignatureError: `callback` cannot be called with a message.
            UnsupportedEventError: the transport does not report a requested event.
            TypeError, ValueError: an argument is invalid.
            ClosedError: the node is closed.
        """
        self._require_open()
        if arrays and raw:
            raise TypeError("arrays=True decodes messages and raw=True does not; pass only one of them")
        resolved_type = message_type(msg_type, arrays=arrays)
        subscription: Subscription[Any] = Subscription(
            self._scope,
            raw_type(resolved_type) if raw else resolved_type,
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
            self._scope.failures.raise_pending()

    async def __aenter__(self) -> Self:
        """Attach the running event loop.

        Raises:
            ClosedError: the node is closed.
            WrongEventLoopError: another event loop serves the context.
        """
        try:
            self._require_open()
            core_of(self.context).loop_binding.running_loop()
        except RosidlError:
            if self._creation_loop_id == id(asyncio.get_running_loop()):  # else it may be in use elsewhere
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
        """Close all entities, wake up the tasks that wait for them, and withdraw the node; may be called twice."""
        if self._scope.closed or not self._close_latch.set():
            return
        if (error := core_of(self.context).take_never_ran_error(self._scope)) is not None:
            self.logger.warning(str(error))
            for listener in failure_listeners:
                listener("", error)
        self._scope.close()
        core_of(self.context).release(self)

    def destroy_node(self) -> None:
        """Do the same as `close`; for compatibility with rclpy."""
        self.close()

    def destroy_publisher(self, publisher: Publisher[Any]) -> bool:
        """Close a publisher and return True; for compatibility with rclpy."""
        publisher.close()
        return True

    def destroy_subscription(self, subscription: Subscription[Any]) -> bool:
        """Close a subscription and return True; for compatibility with rclpy."""
        subscription.close()
        return True

    def destroy_service(self, service: ServiceServer[Any, Any]) -> bool:
        """Close a service and return True; for compatibility with rclpy."""
        service.close()
        return True

    def destroy_client(self, client: Client[Any, Any]) -> bool:
        """Close a client and return True; for compatibility with rclpy."""
        client.close()
        return True

    def destroy_timer(self, timer: Timer) -> bool:
        """Close a timer and return True; for compatibility with rclpy."""
        timer.close()
        return True

    @property
    def entities(self) -> list[Entity]:
        """Open publishers, subscriptions, clients, servers, timers and actions, oldest first, also internal ones."""
        return [one for one in list(self._scope.owned.values()) if isinstance(one, Entity)]

    def __repr__(self) -> str:
        others = pluralize(max(0, len(self._scope.graph.nodes()) - 1), "other node")
        state = "closed" if self.is_closed else f"domain {self.context.domain_id}, {others}"
        return f"{type(self).__name__}({self.fully_qualified_name}, {state})"


def _start_rosout(scope: EntityScope, qos: QoSProfile) -> None:
    """Publish the node's log records on ``/rosout`` until it closes (docs/internals/protocol.md 9.7)."""
    publisher: Publisher[Log] = Publisher(scope, message_type(Log), "/rosout", qos)

    def publish(record: logging.LogRecord) -> None:
        publisher._publish_without_waiting(log_message(record))

    scope.register(shared_router().register(scope.logger.name, publish))


def log_message(record: logging.LogRecord) -> Log:
    """Convert a log record to a ``rcl_interfaces/msg/Log``; its stamp is system time, also with simulated time."""
    sec, nanosec = sec_nanosec(round(record.created * NS_PER_S))
    return Log(
        stamp=Time(sec=sec, nanosec=nanosec),
        level=ros_level(record.levelno),
        name=record.name,
        msg=message_text(record),
        file=record.pathname,
        function=record.funcName or "",
        line=record.lineno,
    )
