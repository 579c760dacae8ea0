"""Services of a node for parameters and logger levels, ``/parameter_events``, and values as messages of rcl_interfaces.

An unknown type number of a parameter becomes NOT_SET in a response of a peer, and an error in a request. Logger levels
apply to the whole process.
Source: docs/internals/protocol.md 9.1 to 9.5.
"""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.msgs.rcl_interfaces import msg, srv
from rosidl_py_gen.runtime.entities.message_types import lazy_message_type, lazy_service_type, service_type
from rosidl_py_gen.runtime.entities.services import ServiceServer
from rosidl_py_gen.runtime.entities.topics import Publisher
from rosidl_py_gen.runtime.logs import LogLevelError, get_logger_level, set_logger_level
from rosidl_py_gen.runtime.loop.queues import DeferredSender
from rosidl_py_gen.runtime.parameters.store import CallbackAnswerError
from rosidl_py_gen.runtime.parameters.values import (
    FloatRange,
    IntRange,
    InvalidParameterValueError,
    Parameter,
    ParameterDescriptor,
    ParameterEvent,
    ParameterType,
    ParameterValue,
    SetResult,
)
from rosidl_py_gen.runtime.transport.qos import PARAMETER_EVENTS, PARAMETERS, SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rosidl_py_gen.cdr import Service
    from rosidl_py_gen.runtime.clocks import Clock
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.names import NodeNames
    from rosidl_py_gen.runtime.parameters.store import ParameterStore


class ParameterEventPublisher(Publisher[msg.ParameterEvent]):
    """Publisher of one ParameterEvent for each atomic set and each declaration with a value.

    The event has the time of the change, and is sent after the reply to the request that caused the change: publishing
    the event first would make up a fifth of the time that the client waits.
    """

    def __init__(self, scope: EntityScope, names: NodeNames, clock: Clock) -> None:
        self._node = names.fully_qualified_name
        self._clock = clock
        self._sender = DeferredSender(scope.loop_binding, self._send)
        message_type = lazy_message_type("rcl_interfaces/msg/ParameterEvent")
        super().__init__(scope, message_type, names.resolve_topic("/parameter_events"), PARAMETER_EVENTS)
        scope.register(self._sender)

    def publish_event(self, event: ParameterEvent) -> None:
        """Publish an event if subscriptions exist; later subscriptions do not receive it (the topic is volatile)."""
        if event and self.has_subscriptions:
            self._sender.add((event, self._clock.now_ns()))

    def _send(self, item: tuple[ParameterEvent, int]) -> None:
        event, stamp_ns = item
        try:
            self.publish(event_to_message(event, self._node, stamp_ns))
        except Exception:
            self._scope.report_failure("publishing a parameter event")


class ParameterService(NamedTuple):
    """Parameter service of a node as a function, for a program that serves it; from `Node.parameter_services`.

    Attributes:
        name: name such as ``get_parameters``; the node itself serves ``~/get_parameters``.
        srv_type: class of the service.
        handler: takes a request and returns the response, in any thread. Exceptions of parameter callbacks refuse the
            set and are logged. Raises `ClosedError` if the node is closed.
    """

    name: str
    srv_type: type[Service[Any, Any]]
    handler: Callable[[Any], Any]


class ParameterServices:
    """Handlers of the six parameter services of one node.

    Args:
        on_listed: called on the thread of the event loop after a peer has requested the list of parameters.
    """

    def __init__(self, scope: EntityScope, store: ParameterStore, on_listed: Callable[[ParameterStore], None]) -> None:
        self._on_listed = on_listed
        self._scope = scope
        self._store = store
        self._table: list[tuple[str, str, Callable[[Any], Any]]] = [
            ("describe_parameters", "DescribeParameters", self._describe),
            ("get_parameters", "GetParameters", self._get),
            ("get_parameter_types", "GetParameterTypes", self._types),
            ("list_parameters", "ListParameters", self._list),
            ("set_parameters", "SetParameters", self._set),
            ("set_parameters_atomically", "SetParametersAtomically", self._set_atomically),
        ]

    def serve(self, names: NodeNames) -> None:
        """Serve the six services until the node closes, which owns them."""
        for name, title, handler in self._table:
            service_type = lazy_service_type(f"rcl_interfaces/srv/{title}")
            ServiceServer(self._scope, service_type, names.resolve_service(f"~/{name}"), handler, PARAMETERS)

    def handlers(self) -> list[ParameterService]:
        """Return the six services as functions, for programs that serve them."""
        return [
            ParameterService(name, getattr(srv, title), self._while_open(handler))
            for name, title, handler in self._table
        ]

    def _while_open(self, handler: Callable[[Any], Any]) -> Callable[[Any], Any]:
        def handle(request: Any) -> Any:
            self._scope.require_open(False, "the node")
            return handler(request)

        return handle

    def _describe(self, request: srv.DescribeParameters_Request) -> srv.DescribeParameters_Response:
        descriptors = self._store.describe_all(request.names)
        return srv.DescribeParameters_Response(descriptors=[descriptor_to_message(item) for item in descriptors])

    def _get(self, request: srv.GetParameters_Request) -> srv.GetParameters_Response:
        return srv.GetParameters_Response(
            values=[value_to_message(item) for item in self._store.get_all(request.names)]
        )

    def _types(self, request: srv.GetParameterTypes_Request) -> srv.GetParameterTypes_Response:
        return srv.GetParameterTypes_Response(types=bytes(self._store.types(request.names)))

    def _list(self, request: srv.ListParameters_Request) -> srv.ListParameters_Response:
        self._scope.loop_binding.call_soon(partial(self._on_listed, self._store))
        listing = self._store.listing(request.prefixes, request.depth)
        result = msg.ListParametersResult(names=list(listing.names), prefixes=list(listing.prefixes))
        return srv.ListParameters_Response(result=result)

    def _set(self, request: srv.SetParameters_Request) -> srv.SetParameters_Response:
        return srv.SetParameters_Response(results=[self._set_all([item]) for item in request.parameters])

    def _set_atomically(self, request: srv.SetParametersAtomically_Request) -> srv.SetParametersAtomically_Response:
        return srv.SetParametersAtomically_Response(result=self._set_all(request.parameters))

    def _set_all(self, parameters: Sequence[msg.Parameter]) -> msg.SetParametersResult:
        """Set all parameters of a request or none.

        If a callback raises, refuse the request, so that the client gets a reply.
        """
        try:
            return result_to_message(self._store.set_atomically([requested_parameter(item) for item in parameters]))
        except InvalidParameterValueError as error:
            return result_to_message(SetResult(False, str(error)))
        except Exception as error:
            self._scope.report_failure("setting a parameter for another node")
            text = str(error) if isinstance(error, CallbackAnswerError) else f"{type(error).__name__}: {error}"
            return result_to_message(SetResult(False, text))


# -------------------------------------------------------------------------------------------------------- logger levels


def start_logger_services(scope: EntityScope, names: NodeNames) -> None:
    """Serve ``~/get_logger_levels`` and ``~/set_logger_levels`` of a node until it closes."""
    services: tuple[tuple[type[Service[Any, Any]], str, Callable[[Any], Any]], ...] = (
        (srv.GetLoggerLevels, "~/get_logger_levels", _get_logger_levels),
        (srv.SetLoggerLevels, "~/set_logger_levels", _set_logger_levels),
    )
    for cls, name, handler in services:
        ServiceServer(scope, service_type(cls), names.resolve_service(name), handler, SERVICES_DEFAULT)


def _get_logger_levels(request: srv.GetLoggerLevels_Request) -> srv.GetLoggerLevels_Response:
    return srv.GetLoggerLevels_Response(
        levels=[msg.LoggerLevel(name=name, level=get_logger_level(name)) for name in request.names]
    )


def _set_logger_levels(request: srv.SetLoggerLevels_Request) -> srv.SetLoggerLevels_Response:
    return srv.SetLoggerLevels_Response(results=[_set_logger_level(level) for level in request.levels])


def _set_logger_level(level: msg.LoggerLevel) -> msg.SetLoggerLevelsResult:
    try:
        set_logger_level(level.name, level.level)
    except LogLevelError as error:
        return msg.SetLoggerLevelsResult(successful=False, reason=str(error))
    return msg.SetLoggerLevelsResult(successful=True)


# ------------------------------------------------------------------------------------------------------------- messages

_KINDS = tuple(ParameterType)
_UNSET = ParameterValue()
# Values of the unused members: immutable or empty, so that messages can share them.
_DEFAULTS = (0, False, 0, 0.0, "", *(np.zeros(0, kind) for kind in (np.uint8, np.bool_, np.int64, np.float64)))
_SCALARS = ("bool", "integer", "double", "string")
_MEMBERS = ("", *(f"{name}_value" for name in (*_SCALARS, "byte_array", *(f"{name}_array" for name in _SCALARS))))
"""Names of the fields of rcl_interfaces/ParameterValue that contain the value, by type number."""
_BYTE_ARRAY = 5


def parameter_type(number: int) -> ParameterType:
    """Return the `ParameterType` with a number; NOT_SET for unknown numbers."""
    return _KINDS[number] if 0 <= number < len(_KINDS) else ParameterType.NOT_SET


def value_to_message(value: ParameterValue) -> msg.ParameterValue:
    """Convert a parameter value to a message, in which only the field of its type differs from the default."""
    number = int(value.type)
    members: list[Any] = [*_DEFAULTS, []]
    members[0] = number
    if number:
        content: Any = value.value
        if isinstance(content, bytes):
            content = np.frombuffer(content, np.uint8)
        elif isinstance(content, tuple):
            content = list(content)
        members[number] = content  # members and type numbers have the same order
    return msg.ParameterValue(*members)


def value_from_message(message: msg.ParameterValue) -> ParameterValue:
    """Convert a message to a parameter value: the content of the field that the message's `type` selects."""
    number = message.type
    if not 0 < number < len(_KINDS):
        return _UNSET
    content = getattr(message, _MEMBERS[number])
    if number >= _BYTE_ARRAY:
        plain = content.tolist() if isinstance(content, np.ndarray) else content
        content = bytes(plain) if number == _BYTE_ARRAY else tuple(plain)
    return ParameterValue(_KINDS[number], content)


def parameter_to_message(parameter: Parameter) -> msg.Parameter:
    """Convert a parameter to a rcl_interfaces/Parameter."""
    return msg.Parameter(parameter.name, value_to_message(parameter.value))


def requested_parameter(message: msg.Parameter) -> Parameter:
    """Convert a message of a request to set parameters to a parameter.

    Other conversions replace an unknown type number by NOT_SET, which would undeclare the parameter here. rclpy and
    rclcpp raise an error that ends the server.

    Raises:
        InvalidParameterValueError: the type number is unknown.
    """
    number = message.value.type
    if number >= len(_KINDS):
        raise InvalidParameterValueError(f"parameter {message.name!r} cannot be set: {number} is not a parameter type")
    return parameter_from_message(message)


def parameter_from_message(message: msg.Parameter) -> Parameter:
    """Convert a rcl_interfaces/Parameter to a parameter."""
    return Parameter(message.name, value_from_message(message.value))


def descriptor_to_message(descriptor: ParameterDescriptor) -> msg.ParameterDescriptor:
    """Convert a descriptor to a rcl_interfaces/ParameterDescriptor, in which a range is a list of one element."""
    floats, ints = descriptor.floating_point_range, descriptor.integer_range
    return msg.ParameterDescriptor(
        name=descriptor.name,
        type=int(descriptor.type),
        description=descriptor.description,
        additional_constraints=descriptor.additional_constraints,
        read_only=descriptor.read_only,
        dynamic_typing=descriptor.dynamic_typing,
        floating_point_range=[msg.FloatingPointRange(**asdict(floats))] if floats else [],
        integer_range=[msg.IntegerRange(**asdict(ints))] if ints else [],
    )


def descriptor_from_message(message: msg.ParameterDescriptor) -> ParameterDescriptor:
    """Convert a rcl_interfaces/ParameterDescriptor to a descriptor."""
    floats = [FloatRange(r.from_value, r.to_value, r.step) for r in message.floating_point_range]
    ints = [IntRange(r.from_value, r.to_value, r.step) for r in message.integer_range]
    return ParameterDescriptor(
        message.name,
        parameter_type(message.type),
        message.description,
        message.additional_constraints,
        message.read_only,
        message.dynamic_typing,
        floats[0] if floats else None,
        ints[0] if ints else None,
    )


def event_to_message(event: ParameterEvent, node: str, stamp_ns: int) -> msg.ParameterEvent:
    """Convert an event to a rcl_interfaces/ParameterEvent; `node` is the fully qualified name of the node."""
    sec, nanosec = sec_nanosec(stamp_ns)
    return msg.ParameterEvent(
        stamp=Time(sec=sec, nanosec=nanosec),
        node=node,
        new_parameters=[parameter_to_message(p) for p in event.new],
        changed_parameters=[parameter_to_message(p) for p in event.changed],
        deleted_parameters=[parameter_to_message(p) for p in event.deleted],
    )


def event_from_message(message: msg.ParameterEvent) -> ParameterEvent:
    """Convert a rcl_interfaces/ParameterEvent to an event, without the message's node and stamp."""
    lists = (message.new_parameters, message.changed_parameters, message.deleted_parameters)
    return ParameterEvent(*(tuple(map(parameter_from_message, parameters)) for parameters in lists))


def result_to_message(result: SetResult) -> msg.SetParametersResult:
    """Convert a result to a rcl_interfaces/SetParametersResult; characters that UTF-8 cannot encode become ``?``."""
    reason = result.reason
    if not reason.isascii():
        reason = reason.encode("utf-8", "replace").decode()
    return msg.SetParametersResult(successful=result.successful, reason=reason)


def result_from_message(message: msg.SetParametersResult) -> SetResult:
    """Convert a rcl_interfaces/SetParametersResult to a result."""
    return SetResult(message.successful, message.reason)
