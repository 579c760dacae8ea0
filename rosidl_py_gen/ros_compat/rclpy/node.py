"""Nodes. Most of the names that programs import from here come from the modules of the node's parts."""

from __future__ import annotations

import math
import time
import weakref
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Tuple, Type, Union

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterType
from rcl_interfaces.srv import ListParameters

from rclpy._rclpy_pybind11 import NodeNameNonExistentError, RCLError
from rclpy.client import SrvType, SrvTypeRequest, SrvTypeResponse
from rclpy.clock import Clock, ROSClock
from rclpy.context import Context, invalid_arguments_error
from rclpy.exceptions import InvalidTopicNameException, NameValidationException, NotInitializedException
from rclpy.executors import Executor
from rclpy.expand_topic_name import expand_topic_name
from rclpy.handles import Handle
from rclpy.impl._fields import value_or_default
from rclpy.logging import get_logger
from rclpy.logging_service import LoggingService
from rclpy.node_entities import *
from rclpy.node_entities import NodeEntities
from rclpy.node_parameters import *
from rclpy.node_parameters import NodeParameters
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.publisher import MsgType
from rclpy.time_source import TimeSource
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.type_description_service import TypeDescriptionService
from rclpy.utilities import get_default_context
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name
from rclpy.validate_topic_name import validate_topic_name
from rclpy.waitable import Waitable
from rosidl_py_gen import runtime
from rosidl_py_gen.runtime._rclpy_support import wire_topics_of_node

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

HIDDEN_NODE_PREFIX = "_"
_NamesAndTypes = list[tuple[str, list[str]]]


class Node(NodeEntities, NodeParameters):
    """Member of the ROS graph, with publishers, subscriptions, services, clients, timers and parameters.

    Args:
        node_name: name, which ``-r __node:=...`` overrides.
        context: an open context. [default: the default context]
        cli_args: command line of this node alone, with ``--ros-args``.
        namespace: namespace, with or without a leading ``/``.
        use_global_arguments: apply the arguments of the context as well.
        enable_rosout: publish log records on ``/rosout``.
        start_parameter_services: let other nodes read and set parameters.
        parameter_overrides: initial values, which take precedence over those of command lines.
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
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        self._rosidl_context = self._context = get_default_context() if context is None else context
        self._rosidl_executor: weakref.ref[Executor] | None = None
        context_handle = self._rosidl_context.handle
        if context_handle is None or not context_handle.ok():
            raise NotInitializedException("cannot create node")
        validate_node_name(node_name)
        full_namespace = "/" + (namespace or "").removeprefix("/")
        validate_namespace(full_namespace)
        try:
            node = runtime.Node(
                node_name,
                full_namespace,
                context=context_handle.runtime,
                enable_rosout=enable_rosout,
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
        logger_name = node.fully_qualified_name[1:].replace("/", ".")
        self._rosidl_node: Handle[runtime.Node] = Handle(context_handle, node, context_handle, logger_name=logger_name)
        self._rosidl_logger = self._logger = get_logger(logger_name)
        self._rosidl_clock = self._clock = ROSClock()
        self._rosidl_init_entities()
        self._rosidl_init_parameters(
            parameter_overrides, allow_undeclared_parameters, automatically_declare_parameters_from_overrides
        )
        self._time_source = source = TimeSource(node=self)
        source.attach_clock(self._rosidl_clock)
        if start_parameter_services:
            self._parameter_service = ParameterService(self)
        if enable_logger_service:
            self._logger_service = LoggingService(self)
        self._type_description_service = TypeDescriptionService(self)

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

    @property
    def context(self) -> Context:
        return value_or_default(self._context, Context, self._rosidl_context)

    @property
    def handle(self) -> Handle[runtime.Node]:
        return self._rosidl_node

    @handle.setter
    def handle(self, value: object) -> None:
        raise AttributeError("handle cannot be modified after node creation")

    def get_name(self) -> str:
        """Return the name after remapping, without namespace."""
        with self.handle as handle:
            return handle.entity.name

    def get_namespace(self) -> str:
        """Return ``/`` or ``/ns``, after remapping."""
        with self.handle as handle:
            return handle.entity.namespace

    def get_fully_qualified_name(self) -> str:
        """Return the namespace and name, ``/ns/name``."""
        with self.handle as handle:
            return handle.entity.fully_qualified_name

    def get_clock(self) -> Clock:
        """Return the clock of ROS time, which may be simulated."""
        clock = self._clock
        return clock if hasattr(clock, "now") else self._rosidl_clock

    def _rosidl_own_clock(self) -> Clock:
        return value_or_default(self._clock, Clock, self._rosidl_clock)

    def get_logger(self) -> RcutilsLogger:
        """Return the logger with the node's name."""
        logger = self._logger
        return logger if hasattr(logger, "info") else self._rosidl_logger

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

    def get_node_names(self) -> list[str]:
        """Return the names of all nodes, without namespaces."""
        return [name for name, _ in self.get_node_names_and_namespaces()]

    def get_fully_qualified_node_names(self) -> list[str]:
        """Return the names of all nodes, with namespaces."""
        return [f"{'' if ns == '/' else ns}/{name}" for name, ns in self.get_node_names_and_namespaces()]

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [(name, namespace) for name, namespace, _ in self.get_node_names_and_namespaces_with_enclaves()]

    def get_node_names_and_namespaces_with_enclaves(self) -> list[tuple[str, str, str]]:
        with self.handle.in_use() as node:
            return [(info.name, info.namespace, info.enclave) for info in node.get_nodes()]

    def wait_for_node(self, fully_qualified_node_name: str, timeout: float) -> bool:
        """Wait until a node is in the graph, or `timeout` seconds have passed; no executor is needed."""
        name = "/" + fully_qualified_node_name.lstrip("/")
        with self.handle as handle:
            return handle.context.wait(lambda: name in self.get_fully_qualified_node_names(), timeout)

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
        """Return the topics a node publishes; with `no_demangle` all DDS topics it writes.

        Raises:
            NodeNameNonExistentError: the node is not in the graph.
        """
        return self._rosidl_names_of_node("publisher", node_name, node_namespace, no_demangle)

    def get_subscriber_names_and_types_by_node(
        self, node_name: str, node_namespace: str, no_demangle: bool = False
    ) -> _NamesAndTypes:
        """Return the topics a node subscribes to; with `no_demangle` all DDS topics it reads.

        Raises:
            NodeNameNonExistentError: the node is not in the graph.
        """
        return self._rosidl_names_of_node("subscriber", node_name, node_namespace, no_demangle)

    def get_service_names_and_types_by_node(self, node_name: str, node_namespace: str) -> _NamesAndTypes:
        """Return the services of a node; raise NodeNameNonExistentError if it is not in the graph."""
        return self._rosidl_names_of_node("service", node_name, node_namespace)

    def get_client_names_and_types_by_node(self, node_name: str, node_namespace: str) -> _NamesAndTypes:
        """Return the services a node has clients of; raise NodeNameNonExistentError if it is not in the graph."""
        return self._rosidl_names_of_node("client", node_name, node_namespace)

    def get_topic_names_and_types(self, no_demangle: bool = False) -> _NamesAndTypes:
        """Return all topics; with `no_demangle` all DDS topics, which include those of services."""
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
            return [TopicEndpointInfo._rosidl_from_runtime(info) for info in infos]

    def get_publishers_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Return the publishers of a topic; with `no_mangle`, `topic_name` is a DDS topic."""
        return self._rosidl_endpoint_infos("publishers", topic_name, no_mangle)

    def get_subscriptions_info_by_topic(self, topic_name: str, no_mangle: bool = False) -> list[TopicEndpointInfo]:
        """Return the subscriptions of a topic; with `no_mangle`, `topic_name` is a DDS topic."""
        return self._rosidl_endpoint_infos("subscriptions", topic_name, no_mangle)

    def destroy_node(self) -> None:
        """Destroy the node and its entities; later uses raise InvalidHandle, except for this method."""
        self._parameter_event_publisher = None
        self._rosidl_destroy_entities()
        self._rosidl_node.destroy_when_not_in_use()
        self._rosidl_wake_executor()
