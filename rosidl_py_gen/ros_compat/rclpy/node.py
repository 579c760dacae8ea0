"""Nodes. Most of the names that programs import from this module are defined in the modules of the node's parts."""

from __future__ import annotations

import math
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple, Type, TypeVar, Union

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterType
from rcl_interfaces.srv import ListParameters

from rclpy._classes import checked_attribute
from rclpy._rclpy_pybind11 import NodeNameNonExistentError, RCLError
from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.client import Client, SrvType, SrvTypeRequest, SrvTypeResponse
from rclpy.clock import BaseClock, Clock, ROSClock
from rclpy.constants import S_TO_NS
from rclpy.context import Context, invalid_arguments_error
from rclpy.endpoint_info import EndpointTypeEnum, ServiceEndpointInfo, TopicEndpointInfo
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.exceptions import (
    InvalidHandle,
    InvalidTopicNameException,
    NameValidationException,
    NotInitializedException,
)
from rclpy.executors import Executor
from rclpy.expand_topic_name import expand_topic_name
from rclpy.guard_condition import GuardCondition
from rclpy.handles import ContextHandle, Handle, denied_as_rcl_error
from rclpy.logging import get_logger
from rclpy.logging_service import LoggingService
from rclpy.node_parameters import *
from rclpy.node_parameters import NodeParameters
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.publisher import MsgType, Publisher
from rclpy.qos import HistoryPolicy, QoSProfile, qos_profile_rosout_default, qos_profile_services_default
from rclpy.qos_overriding_options import QoSOverridingOptions, _declare_qos_parameters
from rclpy.service import Service
from rclpy.subscription import BaseSubscription, Subscription
from rclpy.subscription_content_filter_options import ContentFilterOptions
from rclpy.time_source import TimeSource
from rclpy.timer import Rate, Timer
from rclpy.type_description_service import TypeDescriptionService
from rclpy.type_support import check_is_valid_msg_type, check_is_valid_srv_type, message_class
from rclpy.utilities import get_default_context, resolve_context
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name
from rclpy.validate_topic_name import validate_topic_name
from rclpy.waitable import Waitable
from rosidl_py_gen import runtime
from rosidl_py_gen.runtime._rclpy_support import service_endpoints, start_rosout, wire_topics_of_node

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self

    from rclpy.impl.rcutils_logger import RcutilsLogger

HIDDEN_NODE_PREFIX = "_"
_E = TypeVar("_E", Publisher, Subscription, Client, Service, Timer, GuardCondition)
_KINDS = ("publishers", "subscriptions", "clients", "services", "timers", "guards")
_NamesAndTypes = list[tuple[str, list[str]]]
_ACTION_TOPIC_SUFFIX = "/_action/feedback"
_ACTION_TYPE_SUFFIX = "_FeedbackMessage"


def _actions_of_topics(topics: _NamesAndTypes) -> _NamesAndTypes:
    """Return the actions whose feedback topics are among the given topics, with their types."""
    return [
        (
            name.removesuffix(_ACTION_TOPIC_SUFFIX),
            [type_.removesuffix(_ACTION_TYPE_SUFFIX) for type_ in types if type_.endswith(_ACTION_TYPE_SUFFIX)],
        )
        for name, types in topics
        if name.endswith(_ACTION_TOPIC_SUFFIX)
    ]


def _forget_entity(node: weakref.ref[Node], kind: str, entity: Any) -> None:
    """Remove an entity from the lists of its node, because the program itself has destroyed the entity."""
    if (owner := node()) is not None:
        owner._rosidl_forget(entity, kind)


class BaseNode(NodeParameters):
    """Base class of `Node` and `rclpy.experimental.AsyncNode`: names, parameters, logging and the graph.

    Subclasses create the entities, and must create the clock before they call the constructor.
    """

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: list[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        rosout_qos_profile: QoSProfile | int = qos_profile_rosout_default,
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        self._rosidl_context = self._context = resolve_context(context)
        context_handle = self._rosidl_context.handle
        if context_handle is None or not context_handle.ok():
            raise NotInitializedException("cannot create node")
        validate_node_name(node_name)
        full_namespace = "/" + (namespace or "").removeprefix("/")
        validate_namespace(full_namespace)
        rosout_profile = self._rosidl_to_profile(rosout_qos_profile)
        has_default_rosout = rosout_profile == qos_profile_rosout_default
        try:
            node = runtime.Node(
                node_name,
                full_namespace,
                context=context_handle.runtime,
                enable_rosout=enable_rosout and has_default_rosout,
                start_services=False,
                parameter_events=False,
                automatically_declare_parameters_from_overrides=True,
                time_source=False,
                type_hash_check="warn",
                cli_args=cli_args,
                use_global_arguments=use_global_arguments,
            )
        except runtime.RosArgumentError as error:
            raise invalid_arguments_error(error) from error
        except (runtime.ClosedError, runtime.SecurityError) as error:
            raise RCLError(str(error)) from error
        if enable_rosout and not has_default_rosout:
            try:
                start_rosout(node, rosout_profile.get_c_qos_profile())
            except Exception as error:
                node.close()
                raise RCLError(f"failed to create the publisher of /rosout: {error}") from error
        logger_name = node.fully_qualified_name[1:].replace("/", ".")
        self._rosidl_node: Handle[runtime.Node] = Handle(context_handle, node, context_handle, logger_name=logger_name)
        self._logger = get_logger(logger_name)
        self._rosidl_init_parameters(
            parameter_overrides, allow_undeclared_parameters, automatically_declare_parameters_from_overrides
        )
        self._time_source = source = TimeSource(node=self)
        source.attach_clock(self._clock)
        if start_parameter_services:
            self._parameter_service = ParameterService(self)
        if enable_logger_service:
            self._logger_service = LoggingService(self)
        self._type_description_service = TypeDescriptionService(self)

    @staticmethod
    def _rosidl_min_depth(content_filter_options: ContentFilterOptions | None) -> int:
        """Return the minimum queue depth of a subscription with a content filter; 0 without a filter."""
        if content_filter_options is None or not content_filter_options.filter_expression:
            return 0
        from rclpy.impl.content_filter import MIN_DEPTH

        return MIN_DEPTH

    def get_clock(self) -> Any:
        """Return the clock of ROS time, which may be simulated."""
        raise NotImplementedError

    def create_publisher(self, msg_type: type[Any], topic: str, qos_profile: QoSProfile | int) -> Any:
        """Create a publisher; implemented by subclasses."""
        raise NotImplementedError

    def create_subscription(
        self, msg_type: type[Any], topic: str, callback: Callable[..., Any], qos_profile: QoSProfile | int
    ) -> Any:
        """Create a subscription; implemented by subclasses."""
        raise NotImplementedError

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
    ) -> Any:
        """Create a service; implemented by subclasses."""
        raise NotImplementedError

    @property
    def context(self) -> Context:
        return self._context

    @property
    def handle(self) -> Handle[runtime.Node]:
        return self._rosidl_node

    @handle.setter
    def handle(self, value: object) -> None:
        raise AttributeError("handle cannot be modified after node creation")

    def get_name(self) -> str:
        """Return the name of the node after remapping, without namespace."""
        with self.handle as handle:
            return handle.entity.name

    def get_namespace(self) -> str:
        """Return the namespace of the node after remapping: ``/`` or ``/ns``."""
        with self.handle as handle:
            return handle.entity.namespace

    def get_fully_qualified_name(self) -> str:
        """Return namespace and name of the node: ``/ns/name``."""
        with self.handle as handle:
            return handle.entity.fully_qualified_name

    def get_logger(self) -> RcutilsLogger:
        """Return the logger with the node's name."""
        return checked_attribute("_logger", self._logger, "info")

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        """Return the full name of a topic, remapped unless `only_expand`; raise RCLError for an invalid name."""
        return self._rosidl_resolve_or_rcl_error(topic, only_expand, is_service=False)

    def resolve_service_name(self, service: str, *, only_expand: bool = False) -> str:
        """Return the full name of a service, remapped unless `only_expand`; raise RCLError for an invalid name."""
        return self._rosidl_resolve_or_rcl_error(service, only_expand, is_service=True)

    def _rosidl_resolve_or_rcl_error(self, name: str, only_expand: bool, *, is_service: bool) -> str:
        with self.handle:
            try:
                return self._rosidl_resolve_name(name, only_expand, is_service=is_service)
            except NameValidationException as error:
                raise RCLError(f"failed to resolve name: {error}") from error

    def _rosidl_resolve_name(self, name: str, only_expand: bool = False, *, is_service: bool) -> str:
        validate_topic_name(name, is_service=is_service)
        full_name = self._rosidl_full_name(name, is_service=is_service)
        if only_expand:
            return full_name
        with self.handle as handle:
            return handle.entity.resolve_service_name(name) if is_service else handle.entity.resolve_topic_name(name)

    def _validate_topic_or_service_name(self, topic_or_service_name: str, *, is_service: bool = False) -> None:
        self._rosidl_resolve_name(topic_or_service_name, True, is_service=is_service)

    @staticmethod
    def _rosidl_to_profile(qos_or_depth: QoSProfile | int) -> QoSProfile:
        if isinstance(qos_or_depth, QoSProfile):
            return qos_or_depth
        if not isinstance(qos_or_depth, int):
            raise TypeError(f"Expected QoSProfile or int, but received {type(qos_or_depth)!r}")
        if qos_or_depth < 0:
            raise ValueError("history depth must be greater than or equal to zero")
        return QoSProfile(depth=qos_or_depth)

    _validate_qos_or_depth_parameter = _rosidl_to_profile

    def _rosidl_require_ok(self) -> tuple[ContextHandle, runtime.Node]:
        handle = self.handle
        if not handle.context.ok():
            raise RCLError("failed to create an entity: the node's context is shut down")
        return handle.context, handle.entity

    def _rosidl_create_on_topic(
        self,
        entity_class: type[Publisher] | type[Subscription],
        msg_type: type[Any],
        topic: str,
        profile: QoSProfile,
        options: QoSOverridingOptions | None,
        callbacks: PublisherEventCallbacks | SubscriptionEventCallbacks | None,
        create: Callable[..., Any],
        min_depth: int = 0,
    ) -> Handle[Any]:
        """Check the arguments of a publisher or subscription, call `create`, and return the handle of the created
        endpoint.

        Parameters may override the QoS profile. Without callbacks, the runtime logs incompatible peers. The endpoint
        retains at least `min_depth` messages.
        """
        full = self._rosidl_resolve_name(topic, is_service=False)
        options = QoSOverridingOptions([]) if options is None else options
        _declare_qos_parameters(entity_class, self, full, profile, options)
        check_is_valid_msg_type(msg_type)
        with self.handle:
            context, _ = self._rosidl_require_ok()
            queues, runtime_callbacks = ({}, None) if callbacks is None else callbacks.rosidl_queues(context)
            qos: Any = profile.get_c_qos_profile()
            if qos.depth < min_depth and profile.history != HistoryPolicy.KEEP_ALL:
                qos = qos.keep_last(min_depth)
            try:
                with context.creation_lock, denied_as_rcl_error():
                    endpoint = create(qos=qos, event_callbacks=runtime_callbacks)
                    handle = self.handle.create_endpoint_handle(endpoint, "subscriptions")
            except runtime.UnsupportedEventError as error:
                raise UnsupportedEventTypeError(str(error)) from error
            handle.events = queues
            if callbacks is not None:
                context.add_topic_handle(handle)
        return handle

    def _rosidl_create_on_service(self, role: str, srv_type: Any, srv_name: str, profile: QoSProfile) -> Handle[Any]:
        """Check the arguments of a ``client`` or ``service``, create it, and return its handle."""
        check_is_valid_srv_type(srv_type)
        self._rosidl_resolve_name(srv_name, is_service=True)
        with self.handle, denied_as_rcl_error():
            _, node = self._rosidl_require_ok()
            create = node.create_client if role == "client" else node.create_service
            return self.handle.create_endpoint_handle(
                create(srv_type, srv_name, qos=profile.get_c_qos_profile()), f"{role}s"
            )

    def get_node_names(self) -> list[str]:
        """Return the names of all nodes in the graph, without namespaces."""
        return [name for name, _ in self.get_node_names_and_namespaces()]

    def get_fully_qualified_node_names(self) -> list[str]:
        """Return the names of all nodes in the graph, with namespaces."""
        return [f"{'' if ns == '/' else ns}/{name}" for name, ns in self.get_node_names_and_namespaces()]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(name, namespace) for name, namespace, _ in self.get_node_names_and_namespaces_with_enclaves()]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        with self.handle.in_use() as node:
            return [(info.name, info.namespace, info.enclave) for info in node.get_nodes()]

    def _rosidl_names_of_node(
        self, kind: str, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> _NamesAndTypes:
        with self.handle.in_use() as node:
            namespace = node_namespace if node_namespace.startswith("/") else f"/{node_namespace}"
            if not any((info.name, info.namespace) == (node_name, namespace) for info in node.get_nodes()):
                raise NodeNameNonExistentError(
                    f"cannot get {kind} names and types for nonexistent node: {node_name}, in namespace {namespace}"
                )
            if no_demangle and self.handle.context.runtime.middleware == "DDS":
                return wire_topics_of_node(node, node_name, namespace, writers=kind == "publisher")
            names: _NamesAndTypes = getattr(node, f"get_{kind}_names_and_types_by_node")(node_name, namespace)
            return names

    def get_publisher_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> _NamesAndTypes:
        """Return the topics that a node publishes; with `no_demangle` all DDS topics that it writes.

        Raises:
            NodeNameNonExistentError: the node is not in the graph.
        """
        return self._rosidl_names_of_node("publisher", node_name, node_namespace, no_demangle)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> _NamesAndTypes:
        """Return the topics that a node subscribes to; with `no_demangle` all DDS topics that it reads.

        Raises:
            NodeNameNonExistentError: the node is not in the graph.
        """
        return self._rosidl_names_of_node("subscriber", node_name, node_namespace, no_demangle)

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> _NamesAndTypes:
        """Return the services that a node serves; raise NodeNameNonExistentError if it is not in the graph."""
        return self._rosidl_names_of_node("service", node_name, node_namespace)

    def get_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> _NamesAndTypes:
        """Return the services that a node has clients of; raise NodeNameNonExistentError if it is not in the graph."""
        return self._rosidl_names_of_node("client", node_name, node_namespace)

    def get_topic_names_and_types(self, no_demangle: bool = False) -> _NamesAndTypes:
        """Return all topics with their types; with `no_demangle` all DDS topics, including the topics of services."""
        with self.handle.in_use() as node:
            return node.get_topic_names_and_types(no_demangle=no_demangle)

    def get_service_names_and_types(self) -> _NamesAndTypes:
        with self.handle.in_use() as node:
            return node.get_service_names_and_types()

    def _rosidl_full_name(self, name: str, *, is_service: bool = False) -> str:
        full = expand_topic_name(name, self.get_name(), self.get_namespace())
        validate_full_topic_name(full, is_service=is_service)
        return full

    def _rosidl_count(self, kind: str, name: str) -> int:
        full = self._rosidl_full_name(name, is_service=kind in ("clients", "services"))
        with self.handle.in_use() as node, self.handle.context.creation_lock:
            count: int = getattr(node, f"count_{kind}")(full)
            return count

    def count_publishers(self, topic_name: str) -> int:
        return self._rosidl_count("publishers", topic_name)

    def count_subscribers(self, topic_name: str) -> int:
        return self._rosidl_count("subscribers", topic_name)

    def count_clients(self, service_name: str) -> int:
        return self._rosidl_count("clients", service_name)

    def count_services(self, service_name: str) -> int:
        return self._rosidl_count("services", service_name)

    def _rosidl_endpoint_infos(self, kind: str, name: str, no_mangle: bool) -> list[TopicEndpointInfo]:
        topic = name if no_mangle else self._rosidl_full_name(name)
        with self.handle.in_use() as node:
            infos: list[Any] = getattr(node, f"get_{kind}_info_by_topic")(topic, no_mangle=no_mangle)
            return [TopicEndpointInfo.rosidl_from_runtime(info) for info in infos]

    def get_publishers_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Return information on each publisher of a topic; with `no_mangle`, `topic_name` is a DDS topic."""
        return self._rosidl_endpoint_infos("publishers", topic_name, no_mangle)

    def get_subscriptions_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Return information on each subscription of a topic; with `no_mangle`, `topic_name` is a DDS topic."""
        return self._rosidl_endpoint_infos("subscriptions", topic_name, no_mangle)

    def _rosidl_service_infos(self, name: str, no_mangle: bool, kind: EndpointTypeEnum) -> list[ServiceEndpointInfo]:
        is_dds = self.handle.context.runtime.middleware == "DDS"
        if no_mangle and is_dds:
            raise RCLError(
                "no_mangle: got True for a service; DDS has no services, only topics; use "
                "get_publishers_info_by_topic or get_subscriptions_info_by_topic with no_mangle"
            )
        full_name = name if no_mangle else self._rosidl_full_name(name, is_service=True)
        with self.handle.in_use() as node:
            service = name if no_mangle else node.resolve_service_name(full_name)
            infos = service_endpoints(
                node, service, servers=kind is EndpointTypeEnum.SERVER, has_one_endpoint=not is_dds
            )
            return [ServiceEndpointInfo.rosidl_from_runtime(info, kind) for info in infos]

    def get_clients_info_by_service(self, service_name: str, no_mangle: bool = False) -> list[ServiceEndpointInfo]:
        """Return information on each client of a service, whose name is expanded and remapped unless `no_mangle`.

        Raises:
            RCLError: `no_mangle` is true on DDS.
        """
        return self._rosidl_service_infos(service_name, no_mangle, EndpointTypeEnum.CLIENT)

    def get_servers_info_by_service(self, service_name: str, no_mangle: bool = False) -> list[ServiceEndpointInfo]:
        """Return information on each server of a service, whose name is expanded and remapped unless `no_mangle`.

        Raises:
            RCLError: `no_mangle` is true on DDS.
        """
        return self._rosidl_service_infos(service_name, no_mangle, EndpointTypeEnum.SERVER)

    def get_action_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> _NamesAndTypes:
        """Return the actions that a node has clients of, as ``('/turn', ['pkg/action/Turn'])``.

        Raises:
            NodeNameNonExistentError: the node is not in the graph.
        """
        return _actions_of_topics(self.get_subscriber_names_and_types_by_node(node_name, node_namespace))

    def get_action_server_names_and_types_by_node(self, node_name: str, node_namespace: str) -> _NamesAndTypes:
        """Return the actions that a node serves, as ``('/turn', ['pkg/action/Turn'])``.

        Raises:
            NodeNameNonExistentError: the node is not in the graph.
        """
        return _actions_of_topics(self.get_publisher_names_and_types_by_node(node_name, node_namespace))

    def get_action_names_and_types(self) -> _NamesAndTypes:
        """Return the actions of all clients and servers in the graph, as ``('/turn', ['pkg/action/Turn'])``."""
        return _actions_of_topics(self.get_topic_names_and_types())

    def rosidl_destroy_subscription(self, subscription: BaseSubscription) -> None:
        subscription.destroy()

    def destroy_node(self) -> None:
        """Destroy the node; later uses raise InvalidHandle, except for a further call of this method."""
        self._parameter_event_publisher = None
        self._rosidl_node.destroy_when_not_in_use()


class Node(BaseNode):
    """Member of the ROS graph, with publishers, subscriptions, services, clients, timers and parameters.

    Args:
        node_name: name, which ``-r __node:=...`` overrides.
        context: an open context. [default: the default context]
        cli_args: command line of this node alone, with ``--ros-args``.
        namespace: namespace, with or without a leading ``/``.
        use_global_arguments: apply the arguments of the context as well.
        enable_rosout: publish log records on ``/rosout``.
        rosout_qos_profile: profile or depth of the publisher on ``/rosout``.
        start_parameter_services: let other nodes read and set parameters.
        parameter_overrides: initial values, which take precedence over values of command lines.
        allow_undeclared_parameters: allow parameters to be set without a declaration.
        automatically_declare_parameters_from_overrides: declare each parameter that has an initial value.
        enable_logger_service: let other nodes read and set the levels of loggers.

    Raises:
        NotInitializedException: the context is not open.
        InvalidNodeNameException, InvalidNamespaceException, UnknownROSArgsError, RCLInvalidROSArgsError: see the
            classes.
    """

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: list[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        rosout_qos_profile: QoSProfile | int = qos_profile_rosout_default,
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        self._rosidl_executor: weakref.ref[Executor] | None = None
        self._clock: Clock = ROSClock()
        # Programs read rclpy's lists (`_timers`), or store lists of their own under these names. So each list is stored
        # twice; the code here uses `rosidl_entity_lists`.
        self.rosidl_entity_lists: dict[str, list[Any]] = {kind: [] for kind in (*_KINDS, "waitables")}
        for kind in _KINDS:
            setattr(self, f"_{kind}", self.rosidl_entity_lists[kind])
        self._default_callback_group: CallbackGroup = MutuallyExclusiveCallbackGroup()
        self._rate_group: CallbackGroup = ReentrantCallbackGroup()
        super().__init__(
            node_name,
            context=context,
            cli_args=cli_args,
            namespace=namespace,
            use_global_arguments=use_global_arguments,
            enable_rosout=enable_rosout,
            rosout_qos_profile=rosout_qos_profile,
            start_parameter_services=start_parameter_services,
            parameter_overrides=parameter_overrides,
            allow_undeclared_parameters=allow_undeclared_parameters,
            automatically_declare_parameters_from_overrides=automatically_declare_parameters_from_overrides,
            enable_logger_service=enable_logger_service,
        )

    @property
    def executor(self) -> Executor | None:
        """Executor that serves the node; setting it removes the node from the previous one."""
        return None if self._rosidl_executor is None else self._rosidl_executor()

    @executor.setter
    def executor(self, new_executor: Executor | None) -> None:
        current = self.executor
        if current is new_executor:
            return
        if current is not None:
            current.remove_node(self)
        if new_executor is None:
            self._rosidl_executor = None
        else:
            new_executor.add_node(self)
            self._rosidl_executor = weakref.ref(new_executor)

    def get_clock(self) -> Clock:
        """Return the clock of ROS time, which may be simulated."""
        return checked_attribute("_clock", self._clock, "now")

    @property
    def publishers(self) -> Iterator[Publisher]:
        """Publishers of the node; the properties `subscriptions`, `clients` and so on are analogous."""
        yield from tuple(self.rosidl_entity_lists["publishers"])

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        yield from tuple(self.rosidl_entity_lists["subscriptions"])

    @property
    def clients(self) -> Iterator[Client]:
        yield from tuple(self.rosidl_entity_lists["clients"])

    @property
    def services(self) -> Iterator[Service]:
        yield from tuple(self.rosidl_entity_lists["services"])

    @property
    def timers(self) -> Iterator[Timer]:
        yield from tuple(self.rosidl_entity_lists["timers"])

    @property
    def guards(self) -> Iterator[GuardCondition]:
        yield from tuple(self.rosidl_entity_lists["guards"])

    @property
    def waitables(self) -> Iterator[Waitable]:
        yield from tuple(self.rosidl_entity_lists["waitables"])

    @property
    def default_callback_group(self) -> CallbackGroup:
        """Group of the entities that are created without a group: it runs one callback at a time."""
        return checked_attribute("_default_callback_group", self._default_callback_group, "can_execute")

    def _rosidl_register(self, entity: _E, group: CallbackGroup | None, kind: str) -> _E:
        if group is not None:
            group.add_entity(entity)
        for entities in self._rosidl_lists_of_kind(kind):
            entities.append(entity)
        if not isinstance(entity, GuardCondition):
            entity.rosidl_on_destroy = partial(_forget_entity, weakref.ref(self), kind)
        self.rosidl_entity_lists["waitables"] += getattr(entity, "event_handlers", ())
        self._rosidl_wake_executor()
        return entity

    def _rosidl_lists_of_kind(self, kind: str) -> list[list[Any]]:
        """Return two lists of a kind of entities: the node's own, and the one that the program has stored in rclpy's
        attribute instead.
        """
        own_list, program_list = self.rosidl_entity_lists[kind], getattr(self, f"_{kind}", None)
        if isinstance(program_list, list) and program_list is not own_list:
            return [own_list, program_list]
        return [own_list]

    def _rosidl_wake_executor(self) -> None:
        self.handle.context.notify()

    _wake_executor = _rosidl_wake_executor

    def create_publisher(
        self,
        msg_type: type[Any],
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
        publisher_class: type[Publisher] = Publisher,
    ) -> Publisher:
        """Create a publisher; `qos_profile` may be a depth.

        Raises:
            InvalidTopicNameException: the name of the topic is invalid.
            NoTypeSupportImportedException: `msg_type` is not the class of a message.
            UnsupportedEventTypeError: the middleware does not report a requested event.
            TypeError, ValueError: `qos_profile` is not a profile or depth.
            RCLError: the context is shut down.
        """
        profile = self._rosidl_to_profile(qos_profile)
        group = callback_group or self.default_callback_group
        callbacks = PublisherEventCallbacks() if event_callbacks is None else event_callbacks
        create = partial(self.handle.entity.create_publisher, message_class(msg_type), topic)
        handle = self._rosidl_create_on_topic(
            Publisher, msg_type, topic, profile, qos_overriding_options, callbacks, create
        )
        publisher = publisher_class(
            handle,
            msg_type,
            topic,
            profile,
            event_callbacks=callbacks.create_event_handlers(group, handle, topic),
            callback_group=group,
        )
        return self._rosidl_register(publisher, None, "publishers")

    def create_subscription(
        self,
        msg_type: type[Any],
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
        raw: bool = False,
        content_filter_options: ContentFilterOptions | None = None,
        acceptable_buffer_backends: str | None = None,
    ) -> Subscription:
        """Create a subscription; `qos_profile` may be a depth.

        The callback is called with the message (bytes if `raw`), and with a dict of times and sequence numbers if it
        takes two arguments.

        Args:
            content_filter_options: filter of the messages, see `Subscription.set_content_filter`.
            acceptable_buffer_backends: without effect; buffers are received in the memory of the process.

        Raises:
            InvalidTopicNameException: the name of the topic is invalid.
            NoTypeSupportImportedException: `msg_type` is not the class of a message.
            UnsupportedEventTypeError: the middleware does not report a requested event.
            TypeError, ValueError: `qos_profile` is not a profile or depth.
            RCLError: the context is shut down.
            RuntimeError: the callback does not take one or two arguments.
        """
        profile = self._rosidl_to_profile(qos_profile)
        group = callback_group or self.default_callback_group
        callbacks = SubscriptionEventCallbacks() if event_callbacks is None else event_callbacks
        create: Callable[..., Any] = partial(
            self.handle.entity.create_subscription, message_class(msg_type), topic, raw=raw
        )
        handle = self._rosidl_create_on_topic(
            Subscription,
            msg_type,
            topic,
            profile,
            qos_overriding_options,
            callbacks,
            create,
            self._rosidl_min_depth(content_filter_options),
        )
        handlers = callbacks.create_event_handlers(group, handle, topic)
        try:
            subscription = Subscription(
                handle, msg_type, topic, callback, group, profile, raw, event_callbacks=handlers
            )
            if content_filter_options is not None:
                subscription.set_content_filter(*content_filter_options)
        except Exception:
            handle.destroy_when_not_in_use()
            raise
        return self._rosidl_register(subscription, group, "subscriptions")

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        """Create a client; raise InvalidServiceNameException, NoTypeSupportImportedException or RCLError."""
        group = self.default_callback_group if callback_group is None else callback_group
        handle = self._rosidl_create_on_service("client", srv_type, srv_name, qos_profile)
        client = Client(self._rosidl_context, handle, srv_type, srv_name, qos_profile, group)
        return self._rosidl_register(client, group, "clients")

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Create a service whose callback takes a request and an empty response, and returns the response.

        Raises:
            InvalidServiceNameException: the name of the service is invalid.
            NoTypeSupportImportedException: `srv_type` is not the class of a service.
            RCLError: the context is shut down.
        """
        group = self.default_callback_group if callback_group is None else callback_group
        handle = self._rosidl_create_on_service("service", srv_type, srv_name, qos_profile)
        service = Service(handle, srv_type, srv_name, callback, group, qos_profile)
        return self._rosidl_register(service, group, "services")

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Call a function every `timer_period_sec` seconds of the node's clock, or of `clock`.

        Missed periods are skipped. Without `autostart`, the timer starts with `Timer.reset`.
        """
        period_ns = int(float(timer_period_sec) * S_TO_NS)
        group = self.default_callback_group if callback_group is None else callback_group
        self._rosidl_require_ok()
        with self.handle:
            clock = checked_attribute("_clock", self._clock, "now") if clock is None else clock
            timer = Timer(callback, group, period_ns, clock, context=self._rosidl_context, autostart=autostart)
        return self._rosidl_register(timer, group, "timers")

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Create a guard condition: its callback is called after `GuardCondition.trigger`."""
        group = self.default_callback_group if callback_group is None else callback_group
        self._rosidl_require_ok()
        with self.handle:
            guard = GuardCondition(callback, group, context=self._rosidl_context)
        return self._rosidl_register(guard, group, "guards")

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """Create a rate, whose ``sleep`` keeps a loop at a frequency in hertz while another thread spins the node.

        Raises:
            ValueError: the frequency is not positive.
        """
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        group = checked_attribute("_rate_group", self._rate_group, "can_execute")
        return Rate(self.create_timer(1.0 / frequency, None, group, clock), context=self._rosidl_context)

    def add_waitable(self, waitable: Waitable) -> None:
        """Make the executor wait for a `Waitable` of the program, and execute it when it is ready."""
        self.rosidl_entity_lists["waitables"].append(waitable)
        self._rosidl_wake_executor()

    def remove_waitable(self, waitable: Waitable) -> None:
        """Make the executor no longer wait for a `Waitable`."""
        self.rosidl_entity_lists["waitables"].remove(waitable)
        self._rosidl_wake_executor()

    def _rosidl_forget(self, entity: Any, kind: str) -> bool:
        """Remove an entity from the node's lists.

        Returns False if the entity does not belong to the node, or no longer.
        """
        own_list, *other_lists = self._rosidl_lists_of_kind(kind)
        if entity not in own_list:
            return False
        for entities in (own_list, *other_lists):
            if entity in entities:
                entities.remove(entity)
        for handler in getattr(entity, "event_handlers", ()):
            self.rosidl_entity_lists["waitables"].remove(handler)
        if not isinstance(entity, GuardCondition):
            entity.rosidl_on_destroy = None
        return True

    def _rosidl_destroy(self, entity: Any, kind: str) -> bool:
        if not self._rosidl_forget(entity, kind):
            return False
        try:
            entity.destroy()
        except InvalidHandle:
            return False
        self._rosidl_wake_executor()
        return True

    def destroy_publisher(self, publisher: Publisher) -> bool:
        """Destroy a publisher when its current uses end.

        Returns False if it does not belong to this node, or no longer.
        """
        return self._rosidl_destroy(publisher, "publishers")

    def destroy_subscription(self, subscription: Subscription) -> bool:
        return self._rosidl_destroy(subscription, "subscriptions")

    def rosidl_destroy_subscription(self, subscription: BaseSubscription) -> None:
        self._rosidl_destroy(subscription, "subscriptions")

    def destroy_client(self, client: Client) -> bool:
        return self._rosidl_destroy(client, "clients")

    def destroy_service(self, service: Service) -> bool:
        return self._rosidl_destroy(service, "services")

    def destroy_timer(self, timer: Timer) -> bool:
        return self._rosidl_destroy(timer, "timers")

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        return self._rosidl_destroy(guard, "guards")

    def destroy_rate(self, rate: Rate) -> bool:
        """Destroy a rate and wake up threads that sleep with it; return False if the rate is not of this node."""
        was_destroyed = self.destroy_timer(rate._timer)
        rate.destroy()
        return was_destroyed

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait until a node is in the graph; return False after `timeout` seconds. No executor is needed."""
        name = "/" + fully_qualified_node_name.lstrip("/")
        with self.handle as handle:
            return handle.context.wait(lambda: name in self.get_fully_qualified_node_names(), timeout)

    def destroy_node(self) -> None:
        """Destroy the node and its entities; later uses raise InvalidHandle, except for this method."""
        self._parameter_event_publisher = None
        for kind in _KINDS:
            while entities := self.rosidl_entity_lists[kind]:
                self._rosidl_destroy(entities[0], kind)
        super().destroy_node()
        self._rosidl_wake_executor()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exc_tb: TracebackType | None
    ) -> None:
        self.destroy_node()
