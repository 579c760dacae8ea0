"""Nodes."""

from __future__ import annotations

import math  # noqa: F401
import time  # noqa: F401
import warnings  # noqa: F401
import weakref
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterator, List, Optional, Sequence, Tuple, Type, TypeVar, Union  # noqa: F401, UP035

from rcl_interfaces.msg import FloatingPointRange as FloatingPointRange
from rcl_interfaces.msg import IntegerRange as IntegerRange
from rcl_interfaces.msg import ListParametersResult as ListParametersResult
from rcl_interfaces.msg import Parameter as ParameterMsg  # noqa: F401  imported from here by programs
from rcl_interfaces.msg import ParameterDescriptor as ParameterDescriptor
from rcl_interfaces.msg import ParameterEvent as ParameterEvent
from rcl_interfaces.msg import ParameterType as ParameterType
from rcl_interfaces.msg import ParameterValue as ParameterValue
from rcl_interfaces.msg import SetParametersResult as SetParametersResult
from rcl_interfaces.srv import ListParameters as ListParameters

from rclpy._rclpy_pybind11 import NodeNameNonExistentError as NodeNameNonExistentError
from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import CallbackGroup as CallbackGroup
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup as MutuallyExclusiveCallbackGroup
from rclpy.callback_groups import ReentrantCallbackGroup as ReentrantCallbackGroup
from rclpy.client import Client as Client
from rclpy.client import SrvType as SrvType
from rclpy.client import SrvTypeRequest as SrvTypeRequest
from rclpy.client import SrvTypeResponse as SrvTypeResponse
from rclpy.clock import Clock as Clock
from rclpy.clock import ROSClock as ROSClock
from rclpy.constants import S_TO_NS as S_TO_NS
from rclpy.context import Context as Context
from rclpy.context import invalid_arguments_error
from rclpy.event_handler import PublisherEventCallbacks as PublisherEventCallbacks
from rclpy.event_handler import SubscriptionEventCallbacks as SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle as InvalidHandle
from rclpy.exceptions import InvalidParameterTypeException as InvalidParameterTypeException
from rclpy.exceptions import InvalidParameterValueException as InvalidParameterValueException
from rclpy.exceptions import InvalidTopicNameException as InvalidTopicNameException
from rclpy.exceptions import NameValidationException
from rclpy.exceptions import NotInitializedException as NotInitializedException
from rclpy.exceptions import ParameterAlreadyDeclaredException as ParameterAlreadyDeclaredException
from rclpy.exceptions import ParameterImmutableException as ParameterImmutableException
from rclpy.exceptions import ParameterNotDeclaredException as ParameterNotDeclaredException
from rclpy.exceptions import ParameterUninitializedException as ParameterUninitializedException
from rclpy.executors import Executor as Executor
from rclpy.expand_topic_name import expand_topic_name as expand_topic_name
from rclpy.guard_condition import GuardCondition as GuardCondition
from rclpy.handles import Handle
from rclpy.impl._fields import value_or_default
from rclpy.logging import get_logger as get_logger
from rclpy.logging_service import LoggingService as LoggingService
from rclpy.node_entities import NodeEntities
from rclpy.node_graph import NodeGraph
from rclpy.node_parameters import NodeParameters
from rclpy.parameter import PARAMETER_SEPARATOR_STRING as PARAMETER_SEPARATOR_STRING
from rclpy.parameter import Parameter as Parameter
from rclpy.parameter_service import ParameterService as ParameterService
from rclpy.publisher import MsgType as MsgType
from rclpy.publisher import Publisher as Publisher
from rclpy.qos import QoSProfile as QoSProfile
from rclpy.qos import qos_profile_parameter_events as qos_profile_parameter_events
from rclpy.qos import qos_profile_services_default as qos_profile_services_default
from rclpy.qos_overriding_options import QoSOverridingOptions as QoSOverridingOptions
from rclpy.service import Service as Service
from rclpy.subscription import Subscription as Subscription
from rclpy.time_source import TimeSource as TimeSource
from rclpy.timer import Rate as Rate
from rclpy.timer import Timer as Timer
from rclpy.topic_endpoint_info import TopicEndpointInfo as TopicEndpointInfo
from rclpy.type_description_service import TypeDescriptionService as TypeDescriptionService
from rclpy.type_support import check_is_valid_msg_type as check_is_valid_msg_type
from rclpy.type_support import check_is_valid_srv_type as check_is_valid_srv_type
from rclpy.utilities import get_default_context as get_default_context
from rclpy.validate_full_topic_name import validate_full_topic_name as validate_full_topic_name
from rclpy.validate_namespace import validate_namespace as validate_namespace
from rclpy.validate_node_name import validate_node_name as validate_node_name
from rclpy.validate_parameter_name import validate_parameter_name as validate_parameter_name
from rclpy.validate_topic_name import validate_topic_name as validate_topic_name
from rclpy.waitable import Waitable as Waitable
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

HIDDEN_NODE_PREFIX = "_"


class Node(NodeEntities, NodeGraph, NodeParameters):
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
        with self.handle as handle:
            node = handle.entity
            full_name = expand_topic_name(name, node.name, node.namespace)
            validate_full_topic_name(full_name, is_service=is_service)
            if only_expand:
                return full_name
            return node.resolve_service_name(name) if is_service else node.resolve_topic_name(name)

    def _validate_topic_or_service_name(self, topic_or_service_name: str, *, is_service: bool = False) -> None:
        self._rosidl_resolve_name(topic_or_service_name, True, is_service=is_service)

    def destroy_node(self) -> None:
        """Destroy the node and its entities; later uses raise InvalidHandle, except for this method."""
        self._parameter_event_publisher = None
        self._rosidl_destroy_entities()
        self._rosidl_node.destroy_when_not_in_use()
        self._rosidl_wake_executor()
