"""Conversion of parameter values, descriptors and events to and from rcl_interfaces messages.

An unknown type number becomes NOT_SET in a response of a peer, and an error in a request.
Source: docs/internals/protocol.md 9.2.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.msgs.builtin_interfaces.msg import Time
from rosidl_py_gen.msgs.rcl_interfaces import msg
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


def to_message(parameter: Parameter) -> msg.Parameter:
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
    return from_message(message)


def from_message(message: msg.Parameter) -> Parameter:
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
        new_parameters=[to_message(p) for p in event.new],
        changed_parameters=[to_message(p) for p in event.changed],
        deleted_parameters=[to_message(p) for p in event.deleted],
    )


def event_from_message(message: msg.ParameterEvent) -> ParameterEvent:
    """Convert a rcl_interfaces/ParameterEvent to an event, without the message's node and stamp."""
    lists = (message.new_parameters, message.changed_parameters, message.deleted_parameters)
    return ParameterEvent(*(tuple(map(from_message, parameters)) for parameters in lists))


def result_to_message(result: SetResult) -> msg.SetParametersResult:
    """Convert a result to a rcl_interfaces/SetParametersResult; characters that UTF-8 cannot encode become ``?``."""
    reason = result.reason
    if not reason.isascii():
        reason = reason.encode("utf-8", "replace").decode()
    return msg.SetParametersResult(successful=result.successful, reason=reason)


def result_from_message(message: msg.SetParametersResult) -> SetResult:
    """Convert a rcl_interfaces/SetParametersResult to a result."""
    return SetResult(message.successful, message.reason)
